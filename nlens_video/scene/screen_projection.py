"""Vertices on the screen, in place of a graphics driver's vertex stage.

Positions are snapped to 1/256 px. Differences and products of such numbers are exact in float64, so
that two triangles which share an edge never both cover a sample on it, and never both miss it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.numba_config import inlined, kernel_of

_GRID = 256.0
_HUGE = 1e9  # positions beyond are far off the frame whatever they are [px]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lens:
    """A pinhole camera as the kernels read it.

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


@kernel_of("b1(f8[:,::1],f8[::1],f8,f8,f8,f8)")
def misses(points: Float64, lens: Float64, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether all that lies in the hull of points (N, 3) is certain to miss a box of the screen.

    Points of which some lie behind the camera and some before it may be seen anywhere.
    """
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    before = behind = True
    for p in range(len(points)):
        right, up, depth = in_camera(points[p], lens)
        before &= depth > 0.0
        behind &= depth <= 0.0
        x = lens[14] + lens[12] * right / depth
        y = lens[15] - lens[13] * up / depth
        before &= np.isfinite(x) and np.isfinite(y)  # else it is not known where
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    if len(points) == 0:
        return False
    beside = low_x > x1 or low_y > y1 or high_x < x0 or high_y < y0
    return behind or (before and beside)


@kernel_of("f8(f8[:,:,::1],f8[:,::1])")
def travel(points: Float64, lenses: Float64) -> float:
    """What no mean of points (M, N, 3) moves more than from moment to moment, summed up [px].

    Args:
        points: at each moment.
        lenses: the camera of each (M, 17); focal lengths are those of the first.

    Returns:
        The bound; infinite where a point is not before the camera.
    """
    moments, count = points.shape[:2]
    slant_x = slant_y = 0.0
    nearest = np.inf
    for m in range(moments):
        for p in range(count):
            right, up, depth = in_camera(points[m, p], lenses[m])
            if not (depth > 0.0 and np.isfinite(right) and np.isfinite(up)):
                return np.inf
            slant_x = max(slant_x, abs(right / depth))
            slant_y = max(slant_y, abs(up / depth))
            nearest = min(nearest, depth)
    total = 0.0
    for m in range(1, moments):
        way_x = way_y = way_z = 0.0
        for p in range(count):
            right, up, depth = in_camera(points[m, p], lenses[m])
            right0, up0, depth0 = in_camera(points[m - 1, p], lenses[m - 1])
            way_x = max(way_x, abs(right - right0))
            way_y = max(way_y, abs(up - up0))
            way_z = max(way_z, abs(depth - depth0))
        # x1 / z1 - x0 / z0 = ((x1 - x0) - x0 / z0 (z1 - z0)) / z1
        across = lenses[0, 12] * (way_x + slant_x * way_z)
        down = lenses[0, 13] * (way_y + slant_y * way_z)
        total += math.hypot(across, down) / nearest
    return total
