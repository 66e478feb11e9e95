"""Cameras with known paths, for tests that solve them."""

from __future__ import annotations

import math

import numpy as np

SIZE = (960, 512)


def rotation(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Camera axes in the world (3, 3): roll, then pitch, then yaw [rad]."""
    cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    cr, sr = math.cos(roll), math.sin(roll)
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    return about_y @ about_x @ np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])


def focal_of(fov_deg: float) -> float:
    """Focal length of a field of view across the frame [px]."""
    return 0.5 * SIZE[0] / math.tan(0.5 * math.radians(fov_deg))


def project(
    points: np.ndarray, turn: np.ndarray, eye: np.ndarray, fov_deg: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) of world points (N, 3), and which of them the frame shows (N,)."""
    camera = (points - eye) @ turn
    depth = np.maximum(-camera[:, 2], 1e-6)
    focal = focal_of(fov_deg)
    pixels = np.column_stack(
        [SIZE[0] / 2 + focal * camera[:, 0] / depth, SIZE[1] / 2 - focal * camera[:, 1] / depth]
    )
    seen = (
        (camera[:, 2] < -0.1) & (pixels > 4.0).all(axis=1) & (pixels < np.array(SIZE) - 4.0).all(1)
    )
    return pixels, seen
