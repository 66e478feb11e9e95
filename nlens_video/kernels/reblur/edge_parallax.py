"""Parallax of a defocused plate at the object's blurred edge.

Plain alpha compositing assumes that every aperture sample sees the same background. The samples
that the object leaves free lie on one side of the aperture and see an out-of-focus plate displaced
by half its CoC times their mean position.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np
from numba import njit

from nlens_video.core.layers import Float32
from nlens_video.kernels.scatter.extend import Band, bands
from nlens_video.kernels.thread_pool import parallel_for

BAND_ROWS = 32
"""Rows of one work item."""
STEPS = 256
_LEAST = 1.0 / 255.0  # coverage, or what it leaves free, below this changes no sample


@lru_cache(maxsize=1)
def free_table() -> Float32:
    """For coverage 0 to 1 in `STEPS` steps: by how much the free points' mean exceeds the slope.

    A straight edge across a disc: from the coverage follows the chord t at which the edge cuts it,
    coverage = (acos t - t sqrt(1 - t^2)) / pi. The slope of the coverage by a move of the disc's
    radius is 2 / pi sqrt(1 - t^2), the first moment of what is free 2 / (3 pi) (1 - t^2)^(3/2).
    """
    chord = np.cos(np.linspace(0.0, math.pi, 4096))
    coverage = (np.arccos(chord) - chord * np.sqrt(1.0 - chord * chord)) / math.pi
    cut = np.interp(np.linspace(0.0, 1.0, STEPS + 2), coverage, chord)
    return np.asarray((1.0 - cut * cut) / 3.0, dtype=np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _alpha(rgba: Float32, y: int, x: int) -> float:
    """Coverage, at the border that of the nearest pixel."""
    v = min(max(y, 0), rgba.shape[0] - 1)
    u = min(max(x, 0), rgba.shape[1] - 1)
    return float(rgba[v, u, 3])


@njit(cache=True, nogil=True, error_model="numpy")
def _slope(rgba: Float32, y: int, x: int) -> tuple[float, float]:
    """Slope of the coverage along columns and rows (Sobel) [1 / px]."""
    along = down = 0.0
    for j in range(-1, 2):
        weight = 0.125 * (2 - abs(j))
        along += weight * (_alpha(rgba, y + j, x + 1) - _alpha(rgba, y + j, x - 1))
        down += weight * (_alpha(rgba, y + 1, x + j) - _alpha(rgba, y - 1, x + j))
    return along, down


@njit(cache=True, nogil=True, error_model="numpy")
def _add_displaced(
    plate: Float32, y: float, x: float, here: tuple[int, int], part: float, out: Float32
) -> None:
    """Add a part of what the plate shows at a place more than here, between four pixels."""
    y = min(max(y, 0.0), plate.shape[0] - 1.0)
    x = min(max(x, 0.0), plate.shape[1] - 1.0)
    j, i = int(y), int(x)
    down, along = y - j, x - i
    j1, i1 = min(j + 1, plate.shape[0] - 1), min(i + 1, plate.shape[1] - 1)
    for c in range(3):
        above = plate[j, i, c] + along * (plate[j, i1, c] - plate[j, i, c])
        below = plate[j1, i, c] + along * (plate[j1, i1, c] - plate[j1, i, c])
        out[c] += part * (above + down * (below - above) - plate[here[0], here[1], c])


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(
    rgba: Float32, plate: Float32, cocs: tuple[Float32, Float32], trust: Float32, table: Float32,
    numbers: tuple[int, float, float], out: Float32, band: Band,
) -> None:  # fmt: skip
    """Rows `band[0]` to `band[1]` of the result."""
    margin, aspect, least = numbers
    object_coc, plate_coc = cocs
    for y in range(band[0], band[1]):
        for x in range(rgba.shape[1]):
            alpha = rgba[y, x, 3]
            free = 1.0 - alpha
            if alpha < least or free < least or trust[y, x] <= 0.0:
                continue
            place = alpha * (table.shape[0] - 2)
            entry = int(place)
            scale = table[entry] + (place - entry) * (table[entry + 1] - table[entry])
            along, down = _slope(rgba, y, x)
            scale *= 0.5 * object_coc[y, x] / free
            u, v = scale * along, scale * down * aspect
            length = math.sqrt(u * u + v * v)
            if length > 1.0:
                u, v = u / length, v / length
            moved = 0.5 * plate_coc[y, x]
            here = (y + margin, x + margin)
            _add_displaced(
                plate, here[0] - moved * v * aspect, here[1] - moved * u, here,
                free * trust[y, x], out[y, x],
            )  # fmt: skip


def edge_parallax_layer(
    rgba: Float32,
    plate: Float32,
    object_coc_px: Float32,
    plate_coc_px: Float32,
    trust: Float32,
    *,
    margin: int,
    pixel_aspect: float = 1.0,
    threads: int | None = None,
) -> Float32:
    """The blurred layer, corrected for what the unoccluded part of the aperture sees.

    Args:
        rgba: the layer, premultiplied scene-linear (h, w, 4).
        plate: scene-linear RGB (h + 2 margin, w + 2 margin, 3), larger on every side.
        object_coc_px: signed CoC diameter of the object's nearest part (h, w) [px, columns].
        plate_coc_px: that of what is seen behind it (h, w) [px, columns].
        trust: how far that is known (h, w), 0 to 1 [1].
        margin: of the plate [px].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: maximum number of threads; default: one per processor.

    Returns:
        The layer (h, w, 4) of the same coverage; its light, perhaps below 0, makes up for the
        plate's when it is laid over this very plate.
    """
    out = rgba.copy()
    numbers = (margin, pixel_aspect, _LEAST)
    work = partial(
        _rows, rgba, plate, (object_coc_px, plate_coc_px), trust, free_table(), numbers, out
    )
    parallel_for(work, bands(rgba.shape[0], BAND_ROWS), threads)
    return out
