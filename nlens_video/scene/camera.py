"""The virtual camera: pinhole model, the file's perspective cameras, one made from a placement.

The only place where glTF's axes (Y up, camera looks along -Z) meet the picture's (row 0 on top).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from nlens_video.core.errors import Note, NoteKind, SceneError
from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.core.placement import FULL_FRAME_DIAGONAL_MM, Placement
from nlens_video.scene.gltf.document import Document

# What lies this close above the ground, as a share of the object's height, stands on it.
_STANDING = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera:
    """A pinhole camera at one moment.

    Attributes:
        world_from_camera: pose (4, 4), rigid (no scale), glTF axes [scene unit].
        fx: focal length along columns [px].
        fy: focal length along rows [px].
        cx: principal point, column, pixel centres at +0.5 [px].
        cy: principal point, row [px].
        width: columns of the frame [px].
        height: rows of the frame [px].
    """

    world_from_camera: Float64
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @classmethod
    def from_yfov(
        cls,
        world_from_camera: Float64,
        yfov: float,
        width: int,
        height: int,
        pixel_aspect: float = 1.0,
    ) -> Camera:
        """A camera with a vertical field of view, as glTF stores it.

        Args:
            world_from_camera: pose (4, 4).
            yfov: vertical field of view [rad].
            width: columns [px].
            height: rows [px].
            pixel_aspect: width of a pixel by its height (sample aspect ratio) [1].
        """
        fy = 0.5 * height / math.tan(0.5 * yfov)
        return cls.centred(world_from_camera, fy, width, height, pixel_aspect)

    @classmethod
    def centred(
        cls, world_from_camera: Float64, fy: float, width: int, height: int, pixel_aspect: float
    ) -> Camera:
        """A camera whose principal point is the middle of the frame; arguments as above."""
        return cls(
            world_from_camera=world_from_camera,
            fx=fy / pixel_aspect,
            fy=fy,
            cx=0.5 * width,
            cy=0.5 * height,
            width=width,
            height=height,
        )

    def cropped(self, box: Box) -> Camera:
        """The same camera on a box of its frame."""
        return replace(
            self, cx=self.cx - box.x0, cy=self.cy - box.y0, width=box.width, height=box.height
        )

    @property
    def camera_from_world(self) -> Float64:
        """Inverse of the pose (4, 4)."""
        return np.asarray(np.linalg.inv(self.world_from_camera))

    def to_camera(self, world: Float64) -> Float64:
        """World points (N, 3) in camera space, x right, y up, looking along -z [scene unit]."""
        matrix = self.camera_from_world
        return np.asarray(world @ matrix[:3, :3].T + matrix[:3, 3])

    def pixels(self, camera_points: Float64) -> Float64:
        """Pixel positions (N, 2), column then row, of camera-space points with z < 0 (N, 3)."""
        depth = -camera_points[:, 2]
        columns = self.cx + self.fx * camera_points[:, 0] / depth
        return np.stack([columns, self.cy - self.fy * camera_points[:, 1] / depth], axis=1)

    def plane_disparity(self, ground_y: float) -> Float64:
        """Disparity of the horizontal plane y = ground_y at every pixel centre (H, W).

        Disparity of a plane is affine in the pixel position; it is <= 0 at and above the horizon.

        Args:
            ground_y: height of the plane in the world [scene unit].

        Returns:
            1 / camera-space depth [1 / scene unit]; all zero where the camera lies in the plane.
        """
        columns, rows = np.arange(self.width, dtype=np.float64), np.arange(self.height, dtype=float)
        return self._disparity(columns + 0.5, rows + 0.5, ground_y)

    def corner_disparity(self, ground_y: float) -> Float64:
        """Disparity of that plane at the corners of the frame (2, 2) [1 / scene unit]."""
        ends = np.array([0.0, self.width]), np.array([0.0, self.height])
        return self._disparity(*ends, ground_y)

    def plane_points(self, ground_y: float) -> Float64:
        """Points of that plane at pixel centres (H, W, 3); any point where it is not seen."""
        disparity = self.plane_disparity(ground_y)
        depth = 1.0 / np.where(disparity > 0.0, disparity, 1.0)
        x = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        y = -(np.arange(self.height) + 0.5 - self.cy) / self.fy
        rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)
        rotation, eye = self.world_from_camera[:3, :3], self.world_from_camera[:3, 3]
        return np.asarray(depth[..., None] * (rays @ rotation.T) + eye)

    def _disparity(self, x: Float64, y: Float64, ground_y: float) -> Float64:
        """Disparity of a plane at columns (W,) and rows (H,) of places: (H, W)."""
        up = self.world_from_camera[1, :3]
        below = ground_y - self.world_from_camera[1, 3]
        if below == 0.0:
            return np.zeros((len(y), len(x)))
        columns, rows = (x - self.cx) / self.fx, -(y - self.cy) / self.fy
        return np.asarray((up[0] * columns[None, :] + up[1] * rows[:, None] - up[2]) / below)


@dataclass(frozen=True, slots=True, kw_only=True)
class Perspective:
    """A camera as the file declares it.

    Attributes:
        name: its own name, else its node's, else `camera N`.
        node_name: name of the node that carries it.
        node: index of that node.
        yfov: vertical field of view [rad].
        aspect_ratio: width by height it was made for, or None [1].
    """

    name: str
    node_name: str
    node: int
    yfov: float
    aspect_ratio: float | None


def read_cameras(document: Document, visible: frozenset[int]) -> tuple[Perspective, ...]:
    """Perspective cameras of the default scene, in the order of their nodes.

    Raises:
        SceneError: a field of view that no camera can have.
    """
    declared = document.items("cameras")
    cameras = []
    for index, node in enumerate(document.items("nodes")):
        number = node.reference("camera", len(declared))
        if number is None or index not in visible:
            continue
        item = declared[number]
        if item.text("type") != "perspective":
            line = f"{item.place} is not a perspective camera and is not used"
            document.warn(Note(line, NoteKind.CAMERA))
            continue
        lens = item.child("perspective")
        yfov = lens.number("yfov")
        if not 0.0 < yfov < math.pi:
            raise lens.wrong("yfov", "an angle between 0 and pi")
        cameras.append(
            Perspective(
                name=item.name or node.name or f"camera {number}",
                node_name=node.name,
                node=index,
                yfov=yfov,
                aspect_ratio=lens.positive("aspectRatio"),
            )
        )
    return tuple(cameras)


def rigid(world: Float64) -> Float64:
    """A node's world matrix (4, 4) without scale and shear: what a camera sees along -Z, Y up.

    Raises:
        SceneError: the node is scaled to zero.
    """
    back, up = world[:3, 2], world[:3, 1]
    z = back / max(float(np.linalg.norm(back)), 1e-300)
    x = np.cross(up, z)
    length = float(np.linalg.norm(x))
    if length == 0.0:
        raise SceneError("its node is scaled to zero; give it a scale")
    x = x / length
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, world[:3, 3]
    return pose


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
) -> Camera:
    """The camera, without roll, that shows an object at its placement under a given horizon.

    The object keeps its position in the file; the camera moves.

    Args:
        vertices: the object's world positions (V, 3) at the moment it is placed.
        contact: point of the ground on which it stands (3,) [scene unit].
        placing: where the frame shows it.
        focal_35mm: 35 mm equivalent focal length, by the frame's diagonal [mm].
        frame: columns and rows [px].
        pixel_aspect: width of a pixel by its height [1].

    Raises:
        SceneError: so large that the object would reach behind the camera, or it has no height.
    """
    width, height = frame
    fy = focal_35mm / FULL_FRAME_DIAGONAL_MM * math.hypot(width * pixel_aspect, height)
    fx = fy / pixel_aspect
    pitch = math.atan((placing.horizon_row - 0.5) * height / fy)  # upwards
    turned = _turn(math.radians(-placing.yaw_deg), pitch)
    ray = np.array([(placing.at[0] - 0.5) * width / fx, -(placing.at[1] - 0.5) * height / fy, -1.0])
    depth = contact_depth(vertices, contact, placing, turned, ray, fy, height)
    pose = np.eye(4)
    pose[:3, :3] = turned
    pose[:3, 3] = contact - depth * (turned @ ray)
    return Camera.centred(pose, fy, width, height, pixel_aspect)


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


def _turn(yaw: float, pitch: float) -> Float64:
    """Rotation (3, 3) that looks along -Z, pitched up about X, then turned about Y [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    c, s = math.cos(pitch), math.sin(pitch)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.asarray(about_y @ about_x)
