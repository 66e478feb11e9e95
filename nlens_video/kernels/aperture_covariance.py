"""Corrections of alpha compositing where coverage and light are not independent over the aperture.

Compositing two blurred layers assumes that every aperture sample sees the same background. But the
samples that a near edge leaves free lie on one side of the aperture and see the back from there.

Between two layers of the object the error is the covariance of the near one's coverage and the
light of the one behind it; it is small where either is smooth, so few samples suffice. Before an
out-of-focus plate (parallax at the object's blurred edge) the free samples see it displaced by half
its CoC times their mean position.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np
from numba import njit

from nlens_video.core.layers import Bool, Float32
from nlens_video.kernels.simd import load4, splat, store4
from nlens_video.kernels.thread_pool import Band, bands, parallel_for

_COVARIANCE_ROWS, _PARALLAX_ROWS = 8, 32  # of one work item
STEPS = 256
"""Entries of `free_table`."""
_LEAST = 1.0 / 255.0  # coverage, or what it leaves free, below this changes no sample


@njit(cache=True, nogil=True)
def _seen(
    coc: Float32, place: tuple[int, int], ux: np.float32, uy: np.float32, rounds: int
) -> tuple[np.float32, np.float32]:
    """The surface point p that appears at a place (x, y) from the point u of the aperture.

    It solves p + coc(p) / 2 * u = (x, y) by a few rounds of fixed-point search.
    """
    last_x, last_y = np.float32(coc.shape[1] - 1), np.float32(coc.shape[0] - 1)
    x, y = np.float32(place[0]), np.float32(place[1])
    zero, half = np.float32(0.0), np.float32(0.5)
    here = coc[place[1], place[0]]
    for _ in range(rounds):
        i = np.int32(min(max(x - here * ux + half, zero), last_x))
        j = np.int32(min(max(y - here * uy + half, zero), last_y))
        here = coc[j, i]
    return min(max(x - here * ux, zero), last_x), min(max(y - here * uy, zero), last_y)


@njit(cache=True, nogil=True)
def _cover(cover: Float32, px: np.float32, py: np.float32) -> np.float32:
    """Coverage between four pixels."""
    i, j = np.int32(px), np.int32(py)
    along, down = px - np.float32(i), py - np.float32(j)
    i1, j1 = min(i + 1, cover.shape[1] - 1), min(j + 1, cover.shape[0] - 1)
    above = cover[j, i] + along * (cover[j, i1] - cover[j, i])
    below = cover[j1, i] + along * (cover[j1, i1] - cover[j1, i])
    return np.float32(above + down * (below - above))


@njit(cache=True, nogil=True)
def _rows(
    near: tuple[Float32, Float32],
    back: tuple[Float32, Float32],
    points: Float32,
    aspect: float,
    wanted: Bool,
    out: Float32,
    band: tuple[int, int],
) -> None:
    """Rows `band[0]` to `band[1]` of the result."""
    light, columns, rows = back[0], back[0].shape[1], back[0].shape[0]
    half, tall = np.float32(0.5), np.float32(0.5 * aspect)
    scale = np.float32(1.0 / points.shape[0])
    for y in range(band[0], band[1]):
        for x in range(wanted.shape[1]):
            if not wanted[y, x]:
                continue
            total = both = splat(np.float32(0.0))  # light, and its product with the coverage
            covered = np.float32(0.0)
            for k in range(points.shape[0]):
                ux, uy = half * points[k, 0], tall * points[k, 1]
                px, py = _seen(near[1], (x, y), ux, uy, 2)
                a = _cover(near[0], px, py)
                px, py = _seen(back[1], (x, y), ux, uy, 1)
                i, j = np.int32(px), np.int32(py)
                along, down = splat(px - np.float32(i)), splat(py - np.float32(j))
                first, beside = 4 * (j * columns + i), 4 * (min(i + 1, columns - 1) - i)
                below = 4 * columns * (min(j + 1, rows - 1) - j)
                above = load4(light, first)
                above = above + along * (load4(light, first + beside) - above)
                under = load4(light, first + below)
                under = under + along * (load4(light, first + below + beside) - under)
                seen = above + down * (under - above)
                total, both = total + seen, both + splat(a) * seen
                covered += a
            found = splat(scale) * (both - splat(scale * covered) * total)
            store4(out, 4 * (y * columns + x), found)


def aperture_covariance(
    near: tuple[Float32, Float32],
    back: tuple[Float32, Float32],
    wanted: Bool,
    points: Float32,
    *,
    pixel_aspect: float = 1.0,
    threads: int | None = None,
) -> Float32:
    """Covariance over the aperture of the near layer's coverage and the back layer's light.

    Args:
        near: coverage (h, w) and signed CoC diameter (h, w) of the near layer; the CoC also where
            the layer is not, extended from its border [1, px].
        back: premultiplied colour and alpha (h, w, 4) and CoC (h, w) of the back layer, likewise.
        wanted: pixels to do (h, w).
        points: of the aperture, of equal share and with their mean at 0 (n, 2): columns, rows.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: maximum number of threads; default: one per processor.

    Returns:
        The covariance (h, w, 4), 0 where it is not wanted.
    """
    out = np.zeros((*wanted.shape, 4), dtype=np.float32)
    rows = np.flatnonzero(wanted.any(axis=1))
    if rows.size:
        top, bottom = int(rows[0]), int(rows[-1]) + 1
        parts = [(top + a, top + b) for a, b in bands(bottom - top, _COVARIANCE_ROWS)]
        light = np.ascontiguousarray(back[0], dtype=np.float32)
        work = partial(_rows, near, (light, back[1]), points, pixel_aspect, wanted, out)
        parallel_for(work, parts, threads)
    return out


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
def _parallax_rows(
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
    cocs, numbers = (object_coc_px, plate_coc_px), (margin, pixel_aspect, _LEAST)
    work = partial(_parallax_rows, rgba, plate, cocs, trust, free_table(), numbers, out)
    parallel_for(work, bands(rgba.shape[0], _PARALLAX_ROWS), threads)
    return out
