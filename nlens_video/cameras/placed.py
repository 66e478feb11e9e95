"""A solved camera as an object sees it that stands on the plate's ground."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from nlens_video.cameras.placement import contact_depth
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float32, Float64
from nlens_video.core.placement import Placement
from nlens_video.scene.camera import Camera

_DOWN = 0.62  # of the way from the horizon, or the frame's top, to the lower border
_LARGEST = 0.35
_HEADROOM = 0.05  # between the object and the frame's top [frame height]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedCamera:
    """The cameras of a plate in the world of an object's file.

    The object keeps its position in the file; the cameras move.

    Attributes:
        solved: the plate's cameras.
        scale: object's scene units by solved ones [1].
        turn: from the solved world's axes to the object's (3, 3).
        shift: where the solved world's origin lies in the object's (3,) [scene unit].
    """

    solved: SolvedCamera
    scale: float
    turn: Float64
    shift: Float64

    def at(self, time_s: float) -> Camera:
        """The camera at a time of the plate [s]."""
        camera = self.solved.at(time_s)
        pose = np.eye(4)
        pose[:3, :3] = self.turn @ camera.world_from_camera[:3, :3]
        pose[:3, 3] = self.scale * self.turn @ camera.world_from_camera[:3, 3] + self.shift
        return replace(camera, world_from_camera=pose)


def in_solved_world(solved: SolvedCamera) -> PlacedCamera:
    """The cameras for an object that was made in the solved world."""
    return PlacedCamera(solved=solved, scale=1.0, turn=np.eye(3), shift=np.zeros(3))


def place_on_ground(
    vertices: Float32, contact: Float64, placing: Placement, solved: SolvedCamera, time_s: float
) -> PlacedCamera:
    """The cameras that show an object on the plate's ground, where it stays as they move.

    Args:
        vertices: the object's world positions (V, 3) at the moment it is placed.
        contact: point of the object's world that touches the ground (3,) [scene unit].
        placing: where the frame shows it, and how large.
        solved: the plate's cameras.
        time_s: time of that frame [s].

    Raises:
        SceneError: the frame shows no ground there, or the object would reach behind the camera.
    """
    camera = solved.at(time_s)
    ray = np.array([
        (placing.at[0] * camera.width - camera.cx) / camera.fx,
        -(placing.at[1] * camera.height - camera.cy) / camera.fy,
        -1.0,
    ])  # fmt: skip
    pose = camera.world_from_camera
    direction, eye = pose[:3, :3] @ ray, pose[:3, 3]
    depth = (solved.ground_y - eye[1]) / direction[1] if direction[1] < 0.0 else -1.0
    if not depth > 0.0:
        x, y = placing.at
        raise SceneError(
            f"--at {x:g},{y:g} lies above the horizon of the solved camera, where no ground is; "
            "give a greater Y"
        )
    heading = math.atan2(pose[0, 2], pose[2, 2])
    turn = _about_y(-math.radians(placing.yaw_deg) - heading)
    wanted = contact_depth(
        vertices, contact, placing, turn @ pose[:3, :3], ray, camera.fy, camera.height
    )
    scale = wanted / depth
    ground = eye + depth * direction
    return PlacedCamera(
        solved=solved, scale=scale, turn=turn, shift=contact - scale * turn @ ground
    )


def default_placement(solved: SolvedCamera) -> Placement:
    """A place on the ground in the middle of the first frame, at a size that fits.

    Raises:
        SceneError: the frame shows no ground.
    """
    camera = solved.at(solved.keys[0].pts_s)
    up = camera.world_from_camera[1, :3]
    row = camera.cy - camera.fy * up[2] / up[1] if up[1] > 0.0 else math.inf
    horizon = row / camera.height
    if not horizon < 0.9:
        raise SceneError("the solved camera sees no ground; give --at, --size and --horizon")
    top = max(horizon, 0.0)
    y = top + _DOWN * (1.0 - top)
    return Placement(at=(0.5, y), size=min(_LARGEST, y - _HEADROOM), horizon=None)


def _about_y(angle: float) -> Float64:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
