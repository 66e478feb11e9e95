"""How much of each pixel a disc of confusion covers, in closed form, and tables of it.

A pixel may be oblong (sample aspect ratio), so the disc is an ellipse with half axes `rx` columns
and `ry` rows. Its weights are areas divided by its own area: they sum to 1 whatever the radius.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from nlens_video.frames import Float32, Float64

MAX_COC_PX = 512.0
"""Largest diameter that is told apart; a larger CoC is treated as this one [px]."""
STAMP_STEPS = 64
"""Table entries per pixel of radius; kernels interpolate linearly between them."""
SPAN_STEPS = 16
FADE_START = 3.0
FADE_STOP = 4.0
"""Discs go over from exact stamps to row spans between these radii [px]."""
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


class DiscTables(NamedTuple):
    """Tables a kernel needs for discs up to one size.

    Attributes:
        stamps: weight of pixel (|dy|, |dx|) by nominal radius in columns, (K, rows, columns).
        spans: mean half chord of row |dy| as a share of the disc's half axis along the row, by
            nominal radius in rows, (rows, K).
    """

    stamps: Float32
    spans: Float32


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
    """`coverage` at offsets 0..rows-1 by 0..columns-1 from the centre, (rows, columns)."""
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


def _spans(largest: int) -> Float32:
    rows = largest + 1
    radii = fitted_radii(np.arange(largest * SPAN_STEPS + 2) / SPAN_STEPS)
    edges = np.concatenate([[0.0], np.arange(rows) + 0.5])
    t = np.minimum(edges[:, None] / radii[None, :], 1.0)
    mean = np.diff(_segment(t, np.ones_like(t)), axis=0) * radii
    mean[0] *= 2.0
    return np.ascontiguousarray(mean, dtype=np.float32)


def _stamps(pixel_aspect: float) -> Float32:
    rows = reach(FADE_STOP * pixel_aspect) + 1
    columns = reach(FADE_STOP) + 1
    table = np.zeros((int(FADE_STOP * STAMP_STEPS) + 2, rows, columns), dtype=np.float32)
    for index in range(table.shape[0]):
        radius = index / STAMP_STEPS
        rx, ry = fitted_radius(radius), fitted_radius(radius * pixel_aspect)
        table[index] = quarter_coverage(rx, ry, rows, columns)
    return table


@lru_cache(maxsize=8)
def _cached_tables(largest: int, pixel_aspect: float) -> DiscTables:
    return DiscTables(stamps=_stamps(pixel_aspect), spans=_spans(largest))


def tables(radius_px: float, pixel_aspect: float) -> DiscTables:
    """Tables for discs up to a radius; kept for later calls, sizes grow in powers of two.

    Args:
        radius_px: largest radius in columns [px].
        pixel_aspect: width of a pixel by its height, > 0 [1].
    """
    rows = max(16.0, radius_px * pixel_aspect)
    return _cached_tables(2 ** math.ceil(math.log2(rows)), pixel_aspect)
