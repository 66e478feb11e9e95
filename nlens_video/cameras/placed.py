"""A solved camera as an object sees it that stands on the plate's ground."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.placement import contact_depth, shown_at
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import NoGroundError, SceneError, UsageError
from nlens_video.core.layers import Float32, Float64
from nlens_video.core.optics import Distortion
from nlens_video.core.placement import SMALLEST, GroundPlacing, Placement, usual_size
from nlens_video.scene.camera import Camera

_DOWN = 0.62  # of the way from the horizon, or the frame's top, to the lower border
_SMALLER = 0.85
_LOWEST = 0.9  # row of the horizon under which enough ground is left [frame height]


class PlacedCamera(Struct, frozen=True, kw_only=True, eq=False):
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
    vertices: Float32, contact: Float64, placing: Placement, solved: SolvedCamera, time_s: float,
    lens: Distortion | None = None,
) -> PlacedCamera:  # fmt: skip
    """The cameras that show an object on the plate's ground, where it stays as they move.

    Args:
        vertices: the object's world positions (V, 3) at the moment it is placed.
        contact: point of the object's world that touches the ground (3,) [scene unit].
        placing: where the frame shows it, and how large.
        solved: the plate's cameras.
        time_s: time of that frame [s].
        lens: the distortion that the object is given, None for none.

    Raises:
        SceneError: the frame shows no ground there, or the object would reach behind the camera.
    """
    camera = solved.at(time_s)
    ray, depth = ground_seen_at(placing.at, camera, solved.ground_y, lens)
    turn = _turn(placing.yaw_deg, camera)
    axes = turn @ camera.world_from_camera[:3, :3]
    wanted = contact_depth(vertices, contact, placing, axes, ray, camera.fy, camera.height)
    return _standing(contact, solved, camera, turn, ray, depth, wanted / depth)


def stand_on_ground(
    vertices: Float32, contact: Float64, wish: GroundPlacing, solved: SolvedCamera, time_s: float,
    lens: Distortion | None = None,
) -> tuple[PlacedCamera, str]:  # fmt: skip
    """The cameras that show an object on the plate's ground, where it is wished or chosen.

    A chosen place is the one that the solve found free, at its first frame, else the middle of the
    ground. A chosen size fits into the frame.

    Args:
        vertices: the object's world positions (V, 3) at the moment it is placed.
        contact: point of the object's world that touches the ground (3,) [scene unit].
        wish: where it stands, and how large.
        solved: the plate's cameras.
        time_s: time of the frame that `wish.at` is of [s].
        lens: as of `place_on_ground`.

    Returns:
        The cameras, and the options that give this placement.

    Raises:
        UsageError: the height is given, but the plate's scale is not known.
        SceneError: as `place_on_ground`, or the object has no height.
    """
    at = wish.at
    if at is None:
        at, time_s = default_placement(solved).at, solved.keys[0].pts_s
    said = f"--at {at[0]:.4g},{at[1]:.4g}"
    turned = f"--yaw {wish.yaw_deg:.4g}"
    if wish.height_m is not None:
        placed = _at_height(
            vertices, contact, at, wish.height_m, wish.yaw_deg, solved, time_s, lens
        )
        return placed, f"{said} --height {wish.height_m:.4g}m {turned}"
    size = usual_size(at) if wish.size is None else wish.size
    while True:
        placing = Placement(at=at, size=size, yaw_deg=wish.yaw_deg, horizon=None)
        placed = place_on_ground(vertices, contact, placing, solved, time_s, lens)
        fits = wish.size is not None or size < SMALLEST or _in_frame(vertices, placed.at(time_s))
        if fits:
            return placed, placing.describe()
        size *= _SMALLER


def _at_height(
    vertices: Float32, contact: Float64, at: tuple[float, float], height_m: float, yaw_deg: float,
    solved: SolvedCamera, time_s: float, lens: Distortion | None,
) -> PlacedCamera:  # fmt: skip
    if solved.scale != "metres":
        raise UsageError(
            f"--height {height_m:g}m: the plate's scale is not known; give --size, or solve "
            "the camera by something known (nlens-video solve --marker SIDE, --person-height)"
        )
    tall = float(vertices[:, 1].max() - contact[1])
    if not tall > 0.0:
        raise SceneError(f"--height {height_m:g}m: the object does not rise above its ground")
    camera = solved.at(time_s)
    ray, depth = ground_seen_at(at, camera, solved.ground_y, lens)
    turn = _turn(yaw_deg, camera)
    return _standing(contact, solved, camera, turn, ray, depth, tall / height_m)


def ground_seen_at(
    at: tuple[float, float], camera: Camera, ground_y: float, lens: Distortion | None
) -> tuple[Float64, float]:
    """Where a camera sees the ground at a place of its frame.

    Args:
        at: column and row [frame width, frame height].
        camera: of that moment.
        ground_y: height of the ground [scene unit].
        lens: its distortion, None for a pinhole.

    Returns:
        The direction in camera axes (3,), with z = -1, and the ground's depth [scene unit].

    Raises:
        SceneError: the place lies above the horizon.
    """
    places = shown_at(at, camera, lens)
    depth = float(camera.ground_seen_at(places, ground_y)[1][0])
    if not depth > 0.0:
        raise SceneError(
            f"at {at[0]:g},{at[1]:g} lies above the horizon, where no ground is; give a greater Y"
        )
    return camera.rays(places)[0], depth


def _turn(yaw_deg: float, camera: Camera) -> Float64:
    """From the solved world's axes to those of an object (3, 3) that faces a camera at 0 [deg]."""
    pose = camera.world_from_camera
    return _about_y(-math.radians(yaw_deg) - math.atan2(pose[0, 2], pose[2, 2]))


def _standing(
    contact: Float64, solved: SolvedCamera, camera: Camera, turn: Float64, ray: Float64,
    depth: float, scale: float,
) -> PlacedCamera:  # fmt: skip
    pose = camera.world_from_camera
    ground = pose[:3, 3] + depth * pose[:3, :3] @ ray
    return PlacedCamera(
        solved=solved, scale=scale, turn=turn, shift=contact - scale * turn @ ground
    )


def default_placement(solved: SolvedCamera) -> Placement:
    """A place on the ground of the first frame: the one the solve found free, else the middle.

    Raises:
        NoGroundError: the frame shows none.
    """
    at = solved.place
    if at is None:
        top = ground_top(solved.at(solved.keys[0].pts_s))
        at = 0.5, top + _DOWN * (1.0 - top)
    return Placement(at=at, size=usual_size(at), horizon=None)


def ground_top(camera: Camera) -> float:
    """The row below which a camera sees ground, at the frame's middle column [frame height].

    Raises:
        NoGroundError: it sees next to none.
    """
    up = camera.world_from_camera[1, :3]
    row = camera.cy - camera.fy * up[2] / up[1] if up[1] > 0.0 else math.inf
    horizon = float(row / camera.height)
    if not horizon < _LOWEST:
        raise NoGroundError("the solved camera sees no ground; give --at, --size and --horizon")
    return max(horizon, 0.0)


def _in_frame(vertices: Float32, camera: Camera) -> bool:
    """Whether a camera sees the whole object."""
    seen = camera.to_camera(vertices.astype(np.float64))
    if not (seen[:, 2] < 0.0).all():
        return False
    spots = camera.pixels(seen)
    low, high = spots.min(axis=0), spots.max(axis=0)
    return bool((low >= 0.0).all() and (high <= (camera.width, camera.height)).all())


def _about_y(angle: float) -> Float64:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
