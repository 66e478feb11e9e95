"""Camera of a still from fSpy's JSON export (fspy.io).

fSpy's world is right-handed with Z up; its camera looks along -Z like glTF's. The ground is its
plane z = 0, on which the origin lies. Its image plane spans -1 to 1 along the longer side.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nlens_video.cameras.solved import CameraKey, SolvedCamera, rigid_matrix
from nlens_video.core.errors import SceneError

Y_UP_FROM_Z_UP = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Turns axes with Z up into axes with Y up (4, 4)."""


def is_fspy(raw: object) -> bool:
    """Whether a parsed JSON file is one that fSpy exports."""
    return isinstance(raw, dict) and "viewTransform" in raw and "horizontalFieldOfView" in raw


def from_fspy(raw: dict[str, Any], source: str) -> SolvedCamera:
    """The camera of a parsed export.

    Raises:
        SceneError: a value is missing or wrong.
    """
    try:
        width, height = int(raw["imageWidth"]), int(raw["imageHeight"])
        fov = math.degrees(float(raw["horizontalFieldOfView"]))
        view = rigid_matrix(raw["viewTransform"]["rows"])
        point = raw.get("principalPoint", {"x": 0.0, "y": 0.0})
        offset = float(point["x"]), float(point["y"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise SceneError(f"{source}: no whole export of fSpy ({error!r})") from error
    if view is None or not 0.0 < fov < 180.0 or min(width, height) < 1:
        raise SceneError(f"{source}: no whole export of fSpy (its matrix, field of view or size)")
    half = 0.5 * max(width, height)
    return SolvedCamera(
        width=width,
        height=height,
        keys=(
            CameraKey(index=0, pts_s=0.0, world_to_camera=view @ Y_UP_FROM_Z_UP.T, fov_x_deg=fov),
        ),
        fov="measured",
        horizon="measured",
        method="fSpy",
        principal_px=(0.5 * width + half * offset[0], 0.5 * height - half * offset[1]),
    )
