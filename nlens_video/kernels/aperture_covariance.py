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

from nlens_video.core.layers import Bool, Float32
from nlens_video.kernels.thread_pool import bands, parallel_for
from nlens_video.native import kernels

_COVARIANCE_ROWS, _PARALLAX_ROWS = 8, 32  # of one work item
STEPS = 256
"""Entries of `free_table`."""
_LEAST = 1.0 / 255.0  # coverage, or what it leaves free, below this changes no sample


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
        work = partial(
            kernels.aperture_covariance, (_plain(near[0]), _plain(near[1])),
            (_plain(back[0]), _plain(back[1])), _plain(points), pixel_aspect,
            np.ascontiguousarray(wanted), out,
        )  # fmt: skip
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


def edge_parallax_layer(
    rgba: Float32,
    plate: Float32,
    object_coc_px: Float32,
    plate_coc_px: Float32,
    trust: Float32,
    *,
    corner: tuple[int, int],
    pixel_aspect: float = 1.0,
    threads: int | None = None,
) -> Float32:
    """The blurred layer, corrected for what the unoccluded part of the aperture sees.

    Args:
        rgba: the layer, premultiplied scene-linear (h, w, 4).
        plate: scene-linear RGB (H, W, 3) behind and around it; beyond its border as there.
        object_coc_px: signed CoC diameter of the object's nearest part (h, w) [px, columns].
        plate_coc_px: that of what is seen behind it (h, w) [px, columns].
        trust: how far that is known (h, w), 0 to 1 [1].
        corner: row and column of the plate behind the layer's first pixel [px].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: maximum number of threads; default: one per processor.

    Returns:
        The layer (h, w, 4) of the same coverage; its light, perhaps below 0, makes up for the
        plate's when it is laid over this very plate.
    """
    out = rgba.copy()
    work = partial(
        kernels.edge_parallax, _plain(rgba), _plain(plate),
        (_plain(object_coc_px), _plain(plate_coc_px)), _plain(trust), free_table(),
        (*corner, pixel_aspect, _LEAST), out,
    )  # fmt: skip
    parallel_for(work, bands(rgba.shape[0], _PARALLAX_ROWS), threads)
    return out


def _plain(values: Float32) -> Float32:
    """Values as kernels take them."""
    return np.ascontiguousarray(values, np.float32)
