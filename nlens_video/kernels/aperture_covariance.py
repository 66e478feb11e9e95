"""How what a near edge covers and what is seen behind it go together across the aperture.

Two blurred layers laid over one another suppose that every point of the aperture sees the same: the
part of the lens that the near edge leaves free sees the back from its own side only. What that
changes is the covariance, over the aperture, of the near layer's coverage and the back layer's
light. It is small where either is smooth, so a few points of the aperture suffice.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import njit

from nlens_video.frames import Bool, Float32, Float64
from nlens_video.kernels.pool import share

BAND_ROWS = 8
"""Rows that a thread takes at a time."""


@njit(cache=True, nogil=True)
def _seen(coc: Float32, x: int, y: int, ux: float, uy: float, rounds: int) -> tuple[float, float]:
    """The surface point p that appears at (x, y) from the point u of the aperture.

    It solves p + coc(p) / 2 * u = (x, y) by a few rounds of fixed-point search.
    """
    last_x, last_y = coc.shape[1] - 1, coc.shape[0] - 1
    here = coc[y, x]
    for _ in range(rounds):
        i = min(max(int(x - here * ux + 0.5), 0), last_x)
        j = min(max(int(y - here * uy + 0.5), 0), last_y)
        here = coc[j, i]
    px = min(max(x - here * ux, 0.0), float(last_x))
    py = min(max(y - here * uy, 0.0), float(last_y))
    return px, py


@njit(cache=True, nogil=True)
def _cover(cover: Float32, px: float, py: float) -> float:
    """Coverage between four pixels."""
    i, j = int(px), int(py)
    along, down = px - i, py - j
    i1, j1 = min(i + 1, cover.shape[1] - 1), min(j + 1, cover.shape[0] - 1)
    above = cover[j, i] + along * (cover[j, i1] - cover[j, i])
    below = cover[j1, i] + along * (cover[j1, i1] - cover[j1, i])
    return float(above + down * (below - above))


@njit(cache=True, nogil=True)
def _add_light(light: Float32, px: float, py: float, a: float, sums: Float64) -> None:
    """Add the light between four pixels, and its product with the coverage (2, 4)."""
    i, j = int(px), int(py)
    along, down = px - i, py - j
    i1, j1 = min(i + 1, light.shape[1] - 1), min(j + 1, light.shape[0] - 1)
    w00, w01 = (1.0 - down) * (1.0 - along), (1.0 - down) * along
    w10, w11 = down * (1.0 - along), down * along
    for c in range(4):
        b = w00 * light[j, i, c] + w01 * light[j, i1, c]
        b += w10 * light[j1, i, c] + w11 * light[j1, i1, c]
        sums[0, c] += b
        sums[1, c] += a * b


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
    sums = np.zeros((2, 4))
    scale = 1.0 / points.shape[0]
    for y in range(band[0], band[1]):
        for x in range(wanted.shape[1]):
            if not wanted[y, x]:
                continue
            sums[:] = 0.0
            covered = 0.0
            for k in range(points.shape[0]):
                ux, uy = 0.5 * points[k, 0], 0.5 * points[k, 1] * aspect
                px, py = _seen(near[1], x, y, ux, uy, 2)
                a = _cover(near[0], px, py)
                px, py = _seen(back[1], x, y, ux, uy, 1)
                _add_light(back[0], px, py, a, sums)
                covered += a
            for c in range(4):
                out[y, x, c] = scale * (sums[1, c] - scale * covered * sums[0, c])


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
            the layer is not, carried on from its border [1, px].
        back: premultiplied colour and alpha (h, w, 4) and CoC (h, w) of the back layer, likewise.
        wanted: pixels to do (h, w).
        points: of the aperture, of equal share and with their mean at 0 (n, 2): columns, rows.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: how many share the rows at most; default: one a processor.

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
        work = partial(_rows, near, back, points, pixel_aspect, wanted, out)
        share(work, bands, threads)
    return out
