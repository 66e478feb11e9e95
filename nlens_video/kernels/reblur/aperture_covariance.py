"""Covariance over the aperture of a near layer's coverage and the light of the layer behind it.

Compositing two blurred layers assumes that both are independent over the aperture. But the aperture
samples that a near edge leaves free lie on one side and see the back from there. The error is the
covariance of coverage and light; it is small where either is smooth, so few samples suffice.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit

from nlens_video.core.layers import Bool, Float32
from nlens_video.kernels.simd import load_row4, splat, store4
from nlens_video.kernels.thread_pool import parallel_for

BAND_ROWS = 8
"""Rows of one work item."""


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
                first, beside = j * columns + i, min(i + 1, columns - 1) - i
                below = (min(j + 1, rows - 1) - j) * columns
                above = load_row4(light, first)
                above = above + along * (load_row4(light, first + beside) - above)
                under = load_row4(light, first + below)
                under = under + along * (load_row4(light, first + below + beside) - under)
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
        bands = [
            (top, min(top + BAND_ROWS, int(rows[-1]) + 1))
            for top in range(int(rows[0]), int(rows[-1]) + 1, BAND_ROWS)
        ]
        light = np.ascontiguousarray(back[0], dtype=np.float32)
        work = partial(_rows, near, (light, back[1]), points, pixel_aspect, wanted, out)
        parallel_for(work, bands, threads)
    return out
