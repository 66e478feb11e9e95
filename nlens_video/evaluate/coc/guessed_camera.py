"""The object under a camera whose field of view is wrong, placed so that it looks the same.

A user's camera is a guess. Its pose is kept, its focal length f is f' = s f with s = tan(yfov / 2)
/ tan(yfov' / 2), and the user then moves and scales the object (rigidly: one factor for all axes)
until it stands where it stood:

- The foot, the middle of the footprint on the ground, keeps its pixel p: the ray through p under
  f' meets the plane y = ground_y at the new foot, at depth z' instead of z.
- The size in the picture at the foot, k f' / z', is that of f / z: so k = z' / (s z).

Contact, footprint and height thus match at the foot; away from it the pixels differ only by what a
wrong perspective changes, which is the error under test. Each point of the object's surface keeps
the CoC that the true lens gave it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.scene.camera import Camera


@dataclass(frozen=True, slots=True, kw_only=True)
class GuessedCamera:
    """A camera with a wrong field of view, and where its user puts the object.

    Attributes:
        camera: the wrong camera, on the same frame.
        size: factor by which the object is scaled about its foot [1].
        foot: the foot in the true world (3,) [scene unit].
        moved_foot: the foot in the world of the wrong camera (3,) [scene unit].
    """

    camera: Camera
    size: float
    foot: Float64
    moved_foot: Float64

    def moved(self, world: Float64) -> Float64:
        """Points of the true object (..., 3), moved and scaled with it [scene unit]."""
        return np.asarray(self.moved_foot + self.size * (world - self.foot))


def guess_camera(
    camera: Camera, triangles: Float64, ground_y: float, yfov_ratio: float
) -> GuessedCamera:
    """Take the field of view for `yfov_ratio` times what it is, and place the object anew.

    Args:
        camera: the true camera.
        triangles: the object in the true world (T, 3, 3) [scene unit].
        ground_y: height of the plane on which it stands, in both worlds [scene unit].
        yfov_ratio: wrong vertical field of view by the true one [1].

    Raises:
        SceneError: no such field of view, or no ground in view where the foot would have to be.
    """
    half = math.atan(0.5 * camera.height / camera.fy)
    if not 0 < half * yfov_ratio < math.pi / 2:
        raise SceneError(f"no camera sees {math.degrees(2 * half * yfov_ratio):.0f} degrees")
    factor = math.tan(half) / math.tan(half * yfov_ratio)
    wrong = replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)
    corners = triangles.reshape(-1, 3)
    foot = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    foot[1] = ground_y
    seen = camera.to_camera(foot[None])
    depth = -float(seen[0, 2])
    if depth <= 0:
        raise SceneError("the object's foot lies behind the camera")
    column, row = camera.pixels(seen)[0]
    ray = np.array([(column - wrong.cx) / wrong.fx, -(row - wrong.cy) / wrong.fy, -1.0])
    direction, eye = wrong.world_from_camera[:3, :3] @ ray, wrong.world_from_camera[:3, 3]
    fall = ground_y - float(eye[1])
    if direction[1] * fall <= 0:
        raise SceneError("under the wrong field of view the object's foot lies above the horizon")
    new_depth = fall / float(direction[1])
    return GuessedCamera(
        camera=wrong,
        size=new_depth / (factor * depth),
        foot=foot,
        moved_foot=eye + new_depth * direction,
    )


def moved_depth(guess: GuessedCamera, camera: Camera, depth: Float64) -> Float64:
    """Depth under the wrong camera of each surface point that the true one sees.

    Args:
        guess: the wrong camera and the object's new place.
        camera: the true camera.
        depth: camera-space depth of the object under it (H, W) [scene unit].

    Returns:
        Depth of the same surface points (H, W) [scene unit].
    """
    columns = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    rows = -(np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
    across, up = np.broadcast_arrays(columns[None, :], rows[:, None])
    seen = depth[..., None] * np.stack([across, up, -np.ones_like(across)], axis=-1)
    pose = camera.world_from_camera
    world = guess.moved(seen.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3])
    return np.asarray(-guess.camera.to_camera(world)[:, 2].reshape(depth.shape))
