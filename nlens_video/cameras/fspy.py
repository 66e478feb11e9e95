"""Camera of a still from fSpy's JSON export (fspy.io).

fSpy's world is right-handed with Z up; its camera looks along -Z like glTF's. The ground is its
plane z = 0, on which the origin lies. Its image plane spans -1 to 1 along the longer side.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nlens_video.cameras.solved import LARGEST, CameraKey, SolvedCamera, rigid_matrix
from nlens_video.core.errors import SceneError

Y_UP_FROM_Z_UP = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Turns axes with Z up into axes with Y up (4, 4)."""


_MEMBERS = "imageWidth", "imageHeight", "horizontalFieldOfView", "viewTransform"
_EXPORT = "export it again by fSpy: File, Export, Camera parameters as JSON"


def is_fspy(raw: object) -> bool:
    """Whether a parsed JSON file is one that fSpy exports, whole or not."""
    return isinstance(raw, dict) and any(name in raw for name in _MEMBERS)


def from_fspy(raw: dict[str, Any], source: str) -> SolvedCamera:
    """The camera of a parsed export.

    Raises:
        SceneError: a value is missing or wrong.
    """
    missing = [name for name in _MEMBERS if raw.get(name) is None]
    if missing:
        raise SceneError(f"{source}: an export of fSpy without {', '.join(missing)}; {_EXPORT}")
    try:
        width, height = int(raw["imageWidth"]), int(raw["imageHeight"])
        fov = math.degrees(float(raw["horizontalFieldOfView"]))
        view = rigid_matrix(raw["viewTransform"]["rows"])
        point = raw.get("principalPoint", {"x": 0.0, "y": 0.0})
        offset = float(point["x"]), float(point["y"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise SceneError(
            f"{source}: an export of fSpy with a value of another kind than it writes; {_EXPORT}"
        ) from error
    sized = 1 <= min(width, height) and max(width, height) <= LARGEST
    if view is None or not 0.0 < fov < 180.0 or not sized:
        raise SceneError(
            f"{source}: an export of fSpy whose matrix, field of view or size cannot be; {_EXPORT}"
        )
    if not np.linalg.inv(view)[2, 3] > 0.0:
        raise SceneError(
            f"{source}: the camera of this export of fSpy lies below its ground z = 0; expected "
            "the z axis upwards; choose the axes of the vanishing points so"
        )
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
