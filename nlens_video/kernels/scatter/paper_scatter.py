"""The classical renderer of the paper's reblur: every pixel scatters, nothing hides anything.

After BokehMe (Peng et al. 2022), which the paper adopts: a pixel of radius r gives the pixel at
distance d the weight (0.5 + 0.5 tanh(4 (r - d))) / (r^2 + 0.2), and the sum is divided by all
weights that arrive. It is kept as they state it, faults included: it is what the paper's method
costs and gives. `scatter` is what the other presets use.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numba import njit

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.thread_pool import Band, bands, parallel_for

BAND_ROWS = 16
"""Rows of the result that a thread takes at a time."""

_RIM_PX, _STEPS = 2.0, 1024  # tanh(8) is 1 to seven digits


def _rim() -> Float32:
    """0.5 + 0.5 tanh(4 t) for t from -_RIM_PX to _RIM_PX in steps of 1 / _STEPS."""
    t = np.arange(int(2 * _RIM_PX * _STEPS) + 1) / _STEPS - _RIM_PX
    return np.asarray(0.5 + 0.5 * np.tanh(4.0 * t), dtype=np.float32)


@njit(cache=True, nogil=True)
def _spread(
    colour: Float32,
    place: tuple[int, int],
    r: float,
    rim: Float32,
    sums: Float64,
    dilated: Float32,
    top: int,
) -> None:
    """Add one pixel's disc to the rows of `sums` (n, w, 4), the first of which is row `top`."""
    sy, sx = place
    rows, width = sums.shape[:2]
    k = int(r) + 1
    scale = 1.0 / (r * r + 0.2)
    for y in range(max(0, sy - k - top), min(rows, sy + k + 1 - top)):
        for x in range(max(0, sx - k), min(width, sx + k + 1)):
            dy, dx = y + top - sy, x - sx
            inside = r - math.sqrt(dx * dx + dy * dy)
            if inside <= -_RIM_PX:
                continue
            weight = scale
            if inside < _RIM_PX:
                weight *= rim[int((inside + _RIM_PX) * _STEPS + 0.5)]
            if inside >= 0.0:
                dilated[y + top, x] = max(dilated[y + top, x], r)
            sums[y, x, 0] += weight * colour[0]
            sums[y, x, 1] += weight * colour[1]
            sums[y, x, 2] += weight * colour[2]
            sums[y, x, 3] += weight


@njit(cache=True, nogil=True)
def _rows(
    light: Float32,
    radius: Float32,
    rim: Float32,
    out: Float32,
    dilated: Float32,
    band: Band,
) -> None:
    """Rows `band[0]` to `band[1]` of the result."""
    height, width = radius.shape
    top, bottom = band
    reach = int(radius.max()) + 1
    sums = np.zeros((bottom - top, width, 4))
    for y in range(max(0, top - reach), min(height, bottom + reach)):
        for x in range(width):
            _spread(light[y, x], (y, x), float(radius[y, x]), rim, sums, dilated, top)
    for y in range(top, bottom):
        for x in range(width):
            for c in range(3):
                out[y, x, c] = sums[y - top, x, c] / sums[y - top, x, 3]


def paper_scatter(
    light: Float32, radius_px: Float32, *, threads: int | None = None
) -> tuple[Float32, Float32]:
    """Scatter a whole picture by its radii.

    Args:
        light: scene-linear RGB (h, w, 3).
        radius_px: radius of each pixel's disc (h, w), >= 0 [px].
        threads: how many threads share the rows at most; default: one a processor. The result
            does not depend on it.

    Returns:
        The blurred picture (h, w, 3), and the largest radius whose disc covers each pixel (h, w).

    Raises:
        ValueError: shapes that do not belong together, radii that are negative or not finite.
    """
    if light.shape != (*radius_px.shape, 3):
        raise ValueError(f"{light.shape = } must be (h, w, 3) and {radius_px.shape = } its (h, w)")
    if not (np.isfinite(radius_px).all() and (radius_px >= 0.0).all()):
        raise ValueError("radii must be finite and not negative")
    out, dilated = np.zeros_like(light), np.zeros_like(radius_px)
    work = partial(_rows, light, radius_px, _rim(), out, dilated)
    parallel_for(work, bands(light.shape[0], BAND_ROWS), threads)
    return out, dilated
