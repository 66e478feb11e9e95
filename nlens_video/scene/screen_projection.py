"""Vertex stage: projection of world positions to the screen.

Positions are snapped to 1/256 px, whose differences and products are exact in float64: of two
triangles that share an edge exactly one covers a sample on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.numba_config import inlined, kernel_of

_GRID = 256.0
_HUGE = 1e9  # positions beyond are far off the frame whatever they are [px]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PinholeParams:
    """Pinhole camera parameters for the kernels.

    Attributes:
        axes: rows right, up and back of the camera in the world (3, 3).
        eye: its place in the world (3,) [scene unit].
        fx: focal length along columns [px].
        fy: focal length along rows [px].
        cx: principal point, column of the picture, pixel centres at +0.5 [px].
        cy: principal point, row [px].
        near: least depth that is drawn [scene unit].
        width: columns of the picture [px].
        height: rows [px].
    """

    axes: Float64
    eye: Float64
    fx: float
    fy: float
    cx: float
    cy: float
    near: float
    width: int
    height: int

    def numbers(self) -> Float64:
        """All of it in a row: axes, eye, fx, fy, cx, cy, near (17,)."""
        scalars = [self.fx, self.fy, self.cx, self.cy, self.near]
        return np.array([*self.axes.ravel(), *self.eye, *scalars], dtype=np.float64)


@inlined
def in_camera(position: Float32, lens: Float64) -> tuple[float, float, float]:
    """Right, up and depth of a world position."""
    x = np.float64(position[0]) - lens[9]
    y = np.float64(position[1]) - lens[10]
    z = np.float64(position[2]) - lens[11]
    return (
        x * lens[0] + y * lens[1] + z * lens[2],
        x * lens[3] + y * lens[4] + z * lens[5],
        -(x * lens[6] + y * lens[7] + z * lens[8]),
    )


@kernel_of("void(f4[:,::1],f8[::1],f8[:,::1])")
def project(positions: Float32, lens: Float64, points: Float64) -> None:
    """Fill in columns and rows [px] and disparities (V, 3); disparity 0 nearer than `near`."""
    for v in range(len(positions)):
        right, up, depth = in_camera(positions[v], lens)
        inside = depth >= lens[16]
        disparity = 1.0 / (depth if inside else 1.0)
        x = lens[14] + lens[12] * right * disparity
        y = lens[15] - lens[13] * up * disparity
        points[v, 0] = np.rint(min(max(x, -_HUGE), _HUGE) * _GRID) / _GRID
        points[v, 1] = np.rint(min(max(y, -_HUGE), _HUGE) * _GRID) / _GRID
        points[v, 2] = disparity if inside else 0.0


@kernel_of("Tuple((f8,f8,f8,f8,f8,f8))(f4[:,:],f8[::1])")
def bounds(positions: Float32, lens: Float64) -> tuple[float, float, float, float, float, float]:
    """Least and greatest column, row [px] and depth of positions (V, 3).

    Columns and rows are those of positions before the camera; without meaning if any is not.
    """
    low_x = low_y = low_z = np.inf
    high_x = high_y = high_z = -np.inf
    for v in range(len(positions)):
        right, up, depth = in_camera(positions[v], lens)
        x = lens[14] + lens[12] * right / depth
        y = lens[15] - lens[13] * up / depth
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        low_z, high_z = min(low_z, depth), max(high_z, depth)
    return low_x, high_x, low_y, high_y, low_z, high_z
