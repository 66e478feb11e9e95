"""The camera of a scene without one, from the object's place in the frame."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.cameras.solved import undistorted
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float32, Float64
from nlens_video.core.optics import Distortion
from nlens_video.core.placement import FULL_FRAME_DIAGONAL_MM, Placement
from nlens_video.scene.camera import Camera

# What lies this close above the ground, as a share of the object's height, stands on it.
_STANDING = 0.01


def contact_point(vertices: Float32, ground_y: float | None = None) -> Float64:
    """The point of the ground on which an object stands (3,) [scene unit].

    It is the middle of the box around the lowest vertices, so that legs stand round it.

    Args:
        vertices: world positions (V, 3).
        ground_y: height of the ground, None for the lowest vertex.
    """
    heights = vertices[:, 1].astype(np.float64)
    lowest, highest = float(heights.min()), float(heights.max())
    feet = vertices[heights <= lowest + _STANDING * (highest - lowest)].astype(np.float64)
    middle = 0.5 * (feet.min(axis=0) + feet.max(axis=0))
    return np.array([middle[0], lowest if ground_y is None else ground_y, middle[2]])


def place_camera(
    vertices: Float32,
    contact: Float64,
    placing: Placement,
    focal_35mm: float,
    frame: tuple[int, int],
    pixel_aspect: float = 1.0,
    lens: Distortion | None = None,
) -> Camera:
    """The camera that shows an object at its placement under a given horizon.

    The object keeps its position in the file; the camera moves.

    Args:
        vertices: the object's world positions (V, 3) at the moment it is placed.
        contact: point of the ground on which it stands (3,) [scene unit].
        placing: where the frame shows it.
        focal_35mm: 35 mm equivalent focal length, by the frame's diagonal [mm].
        frame: columns and rows [px].
        pixel_aspect: width of a pixel by its height [1].
        lens: the distortion that the object is given, None for none.

    Raises:
        SceneError: so large that the object would reach behind the camera, or it has no height.
        UsageError: the place lies above the horizon.
    """
    width, height = frame
    fy = focal_35mm / FULL_FRAME_DIAGONAL_MM * math.hypot(width * pixel_aspect, height)
    roll = math.radians(placing.roll_deg)
    pitch = math.atan((placing.horizon_row - 0.5) * height / fy * math.cos(roll))  # upwards
    turned = _turn(math.radians(-placing.yaw_deg), pitch, roll)
    pinhole = Camera.centred(np.eye(4), fy, width, height, pixel_aspect)
    ray = pinhole.rays(shown_at(placing.at, pinhole, lens))[0]
    if not (turned @ ray)[1] < 0.0:
        raise placing.no_ground
    depth = contact_depth(vertices, contact, placing, turned, ray, fy, height)
    pose = np.eye(4)
    pose[:3, :3] = turned
    pose[:3, 3] = contact - depth * (turned @ ray)
    return Camera.centred(pose, fy, width, height, pixel_aspect)


def shown_at(at: tuple[float, float], camera: Camera, lens: Distortion | None) -> Float64:
    """Where a pinhole sees what the plate shows at a place (1, 2) [px].

    Args:
        at: column and row [frame width, frame height].
        camera: the pinhole.
        lens: as of `undistorted`.
    """
    return undistorted(np.array([[at[0] * camera.width, at[1] * camera.height]]), camera, lens)


def contact_depth(
    vertices: Float32,
    contact: Float64,
    placing: Placement,
    turned: Float64,
    ray: Float64,
    fy: float,
    height: int,
) -> float:
    """Depth of the contact point at which the object has its size in the frame [scene unit].

    Args:
        vertices: the object's world positions (V, 3).
        contact: point of the ground on which it stands (3,).
        placing: where the frame shows it, and how large.
        turned: camera axes in the object's world (3, 3).
        ray: direction of the contact point in camera axes, with z = -1 (3,).
        fy: focal length along rows [px].
        height: rows of the frame [px].

    Raises:
        SceneError: so large that the object would reach behind the camera, or it has no height.
    """
    # In camera axes, with the contact point at depth t, a vertex at p from it has the depth
    # t - p_z and lies fy (p_y + ray_y p_z) / (t - p_z) rows above the contact point.
    local = (vertices.astype(np.float64) - contact) @ turned
    rise = local[:, 1] + ray[1] * local[:, 2]
    depth = float((local[:, 2] + rise * fy / (placing.size * height)).max())
    nearest = depth - float(local[:, 2].max())
    if not nearest > 1e-3 * depth or not rise.max() > 0.0:
        raise SceneError(
            f"{placing.describe()}: the object would reach behind the camera; "
            "give a smaller --size or a higher horizon"
        )
    return depth


def _turn(yaw: float, pitch: float, roll: float) -> Float64:
    """Rotation (3, 3) that looks along -Z, rolled about Z, pitched about X, turned about Y [rad].

    By a positive roll the camera leans to its left, and the horizon falls to the right.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    c, s = math.cos(pitch), math.sin(pitch)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    c, s = math.cos(roll), math.sin(roll)
    about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_y @ about_x @ about_z)
