"""A camera on the ground y = 0, and the grid on that ground that a scene file shows."""

from __future__ import annotations

import math

import numpy as np
from msgspec.structs import replace

from nlens_video.cameras.ground import moved
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.layers import Float64

_REACH = 20  # squares around the path of the camera
_MOST_SQUARES = 400  # along a side


def on_ground_zero(camera: SolvedCamera) -> SolvedCamera:
    """The same camera in a world whose ground is y = 0."""
    if camera.ground_y == 0.0:
        return camera
    lowered = np.eye(4)
    lowered[1, 3] = -camera.ground_y
    return replace(moved(camera, lowered), ground_y=0.0)


def square_size(camera: SolvedCamera) -> float:
    """Side of the grid's squares [scene unit]: a power of ten near the first camera's height."""
    height = abs(float(camera.keys[0].world_from_camera[1, 3]) - camera.ground_y)
    return float(10.0 ** math.floor(math.log10(max(height, 1e-6))))


def ground_lines(camera: SolvedCamera) -> Float64:
    """The grid's lines (L, 2, 3): their ends on the ground under and around the camera's path."""
    eyes = np.array([key.world_from_camera[:3, 3] for key in camera.keys])[:, [0, 2]]
    side = square_size(camera)
    while (np.ptp(eyes, axis=0) / side).max() > _MOST_SQUARES - 2 * _REACH:
        side *= 10.0
    low = np.floor(eyes.min(axis=0) / side).astype(int) - _REACH
    high = np.ceil(eyes.max(axis=0) / side).astype(int) + _REACH
    (x0, z0), (x1, z1), y = low * side, high * side, camera.ground_y
    along_z = [((n * side, y, z0), (n * side, y, z1)) for n in range(low[0], high[0] + 1)]
    along_x = [((x0, y, n * side), (x1, y, n * side)) for n in range(low[1], high[1] + 1)]
    return np.array([*along_z, *along_x])
