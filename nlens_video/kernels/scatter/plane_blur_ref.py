"""Definition of `plane_blur` in NumPy, one pixel after the other."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.kernels.scatter.disc import fitted_radius
from nlens_video.kernels.scatter.plane_blur import PlaneCoc


def blur_plane_ref(
    values: Float32, coc: PlaneCoc, target: Box, pixel_aspect: float = 1.0
) -> Float64:
    """What a round lens makes of values on a plane, of which there are none beyond the array.

    Args:
        values: (h, w, 3).
        coc: of the plane, in their pixels.
        target: where the result lies, in pixels of the array; may reach beyond it.
        pixel_aspect: width of a pixel by its height, > 0 [1].

    Returns:
        Each pixel's mean over a disc of its own CoC, on the target (h, w, 3).
    """
    out = np.zeros((target.height, target.width, 3))
    height, width = values.shape[:2]
    rows, columns = np.arange(height) - 0.5, np.arange(width) - 0.5  # first edges
    for y, x in np.ndindex(out.shape[:2]):
        row, column = y + target.y0, x + target.x0
        radius = fitted_radius(0.5 * abs(float(coc.at(row, column))))
        weights = row_by_row(rows - row, columns - column, radius, radius * pixel_aspect)
        out[y, x] = np.tensordot(weights, values, axes=2)
    return out


def row_by_row(rows: Float64, columns: Float64, rx: float, ry: float) -> Float64:
    """Weights of an ellipse (h, w), each row of pixels by its mean chord; in all of them 1.

    Args:
        rows: first edges of the rows, from the middle of the ellipse (h,) [px].
        columns: likewise of the columns (w,) [px].
        rx: half axis in columns, > 0 [px].
        ry: half axis in rows, > 0 [px].
    """
    fine = np.linspace(0.0, 1.0, 2001)[:-1] + 0.5 / 2000
    heights = (rows[:, None] + fine) / ry
    half = rx * np.sqrt(np.maximum(1.0 - heights * heights, 0.0)).mean(axis=1)[:, None]
    low, high = np.maximum(columns, -half), np.minimum(columns + 1.0, half)
    return np.asarray(np.maximum(high - low, 0.0) / (math.pi * rx * ry))
