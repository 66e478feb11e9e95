"""How much of each pixel a disc of confusion covers, in closed form.

A pixel may be oblong (sample aspect ratio), so the disc is an ellipse with half axes `rx` columns
and `ry` rows. Its weights are areas divided by its own area: they sum to 1 whatever the radius.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Float64

MAX_COC_PX = 512.0
"""Largest diameter that is told apart; a larger CoC is treated as this one [px]."""
# The disc whose pixel areas, applied to pictures that are themselves samples of pixel areas, come
# closest to the true disc: least squares over straight edges of every position and angle, by
# brute force. Below about half a pixel the nominal disc would lie in its own pixel and do nothing.
_NOMINAL = (
    0.0,
    0.1,
    0.2,
    0.3,
    0.4,
    0.5,
    0.6,
    0.7,
    0.8,
    0.9,
    1.0,
    1.1,
    1.2,
    1.3,
    1.4,
    1.5,
    1.7,
    2.0,
)
_FITTED = (
    *(0.5, 0.51, 0.53, 0.55, 0.58, 0.61, 0.65, 0.69, 0.73, 0.79),
    *(0.85, 0.93, 1.02, 1.13, 1.27, 1.43, 1.67, 1.93),
)
SURPLUS = 4.0 - 1.93**2
"""By how much the square of a larger disc's radius exceeds the fitted one's [px^2]."""


def fitted_radii(radius_px: Float64) -> Float64:
    """The discs whose `coverage` does to a sampled picture what those of `radius_px` do to light.

    0.5, the identity, at 0; steadily larger; below the nominal radius by 1 / (7 r) from 2 px on.
    """
    fitted = np.sqrt(np.maximum(radius_px * radius_px - SURPLUS, 0.0))
    small = radius_px < _NOMINAL[-1]
    fitted[small] = np.interp(radius_px[small], _NOMINAL, _FITTED)
    return np.asarray(fitted)


def fitted_radius(radius_px: float) -> float:
    """`fitted_radii` of one disc [px]."""
    return float(fitted_radii(np.array([radius_px]))[0])


def _segment(t: Float64, radius: Float64) -> Float64:
    """Integral of sqrt(radius^2 - t^2) from 0 to t, 0 <= t <= radius."""
    inner = np.sqrt(np.maximum(radius * radius - t * t, 0.0))
    return np.asarray(
        0.5 * (t * inner + radius * radius * np.arcsin(np.clip(t / radius, 0.0, 1.0)))
    )


def _corner_area(x: Float64, y: Float64, radius: Float64) -> Float64:
    """Area of a centred circle within [0, x] by [0, y], both >= 0."""
    x = np.minimum(x, radius)
    y = np.minimum(y, radius)
    flat = np.minimum(np.sqrt(np.maximum(radius * radius - y * y, 0.0)), x)
    return np.asarray(y * flat + _segment(x, radius) - _segment(flat, radius))


def coverage(rx: float, ry: float) -> Float64:
    """Weights of an ellipse at a pixel's centre: exact areas over its own area.

    Args:
        rx: half axis in columns, > 0 [px].
        ry: half axis in rows, > 0 [px].

    Returns:
        Weights (2 * ceil(ry - 0.5) + 1, 2 * ceil(rx - 0.5) + 1), their sum is 1.
    """
    quarter = quarter_coverage(rx, ry, reach(ry) + 1, reach(rx) + 1)
    top = np.concatenate([quarter[:0:-1], quarter])
    return np.concatenate([top[:, :0:-1], top], axis=1)


def quarter_coverage(rx: float, ry: float, rows: int, columns: int) -> Float64:
    """Weights of an ellipse at a pixel's centre: exact areas over its own area.

    Args:
        rx: half axis in columns, > 0 [px].
        ry: half axis in rows, > 0 [px].
        rows: how many rows from the pixel's own downwards.
        columns: how many columns from the pixel's own to the right.

    Returns:
        Weights (rows, columns) of one quarter of the plane, the pixel's own row and column whole.
    """
    # Scaled to a unit circle. Edges run from the centre, so the middle pixel is cut in half.
    x = np.concatenate([[0.0], np.arange(columns) + 0.5]) / rx
    y = np.concatenate([[0.0], np.arange(rows) + 0.5]) / ry
    one = np.ones((1, 1))
    area = np.diff(np.diff(_corner_area(x[None, :], y[:, None], one), axis=0), axis=1) / math.pi
    area[0] *= 2.0
    area[:, 0] *= 2.0
    return np.maximum(area, 0.0)


def reach(half_axis: float) -> int:
    """Whole pixels beyond its own that a disc at a pixel's centre touches."""
    return max(0, math.ceil(half_axis - 0.5))


def half_chords(radii: Float64, rows: int) -> Float64:
    """Mean half chord of circles in each row of pixels from the middle one, (rows, K) [px].

    Args:
        radii: the circles' (K,), > 0 [px].
        rows: how many rows from the middle one downwards.
    """
    edges = np.concatenate([[0.0], np.arange(rows) + 0.5])
    t = np.minimum(edges[:, None] / radii[None, :], 1.0)
    mean = np.diff(_segment(t, np.ones_like(t)), axis=0) * radii * radii
    mean[0] *= 2.0
    return np.asarray(mean)
