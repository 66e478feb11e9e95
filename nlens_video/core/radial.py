"""Radial coordinates of pixels, in half diagonals: 0 in the middle of the frame, 1 in a corner.

Pixels are assumed square.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Box, Float32, Float64


def half_diagonal(frame: Box) -> float:
    """From the middle of a frame to its corner [px]."""
    return 0.5 * math.hypot(frame.width, frame.height)


def from_middle(box: Box, frame: Box) -> tuple[Float32, Float32]:
    """Columns (w,) and rows (h,) of a box's pixel centres from the frame's middle [px]."""
    columns = np.arange(box.x0, box.x1, dtype=np.float32) + np.float32(
        0.5 - 0.5 * (frame.x0 + frame.x1)
    )
    rows = np.arange(box.y0, box.y1, dtype=np.float32) + np.float32(
        0.5 - 0.5 * (frame.y0 + frame.y1)
    )
    return columns, rows


def square_radius(box: Box, frame: Box) -> Float32:
    """Square of the radius of each pixel of a box (h, w) [half diagonal^2]."""
    columns, rows = from_middle(box, frame)
    scale = np.float32(1.0 / half_diagonal(frame) ** 2)
    return np.asarray((rows * rows)[:, None] * scale + (columns * columns)[None, :] * scale)


def undistorted_radius(k1: float, k2: float, distorted: Float64) -> Float64:
    """Inverse of Brown's model: undistorted radii, infinite where there is none.

    Args:
        k1: [1].
        k2: [1].
        distorted: radii, any shape, in the model's unit.
    """
    limit = 4.0 * float(np.max(distorted, initial=0.0)) + 1e-6
    r = np.linspace(0.0, limit, 16384)
    grows = r * (1.0 + k1 * r**2 + k2 * r**4)
    turn = int(np.argmax(np.diff(grows) <= 0.0)) + 1 if (np.diff(grows) <= 0.0).any() else len(r)
    inverse = np.interp(distorted, grows[:turn], r[:turn], right=np.inf)
    return np.asarray(inverse)
