"""The virtual camera: pinhole model, and the perspective cameras of the file.

The only place where glTF's axes (Y up, camera looks along -Z) meet the picture's (row 0 on top).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import MissingCameraError, Note, NoteKind, SceneError
from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.scene.gltf.animations import Animation
from nlens_video.scene.gltf.document import Document


class Camera(Struct, frozen=True, kw_only=True, eq=False):
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

    def about(self, origin: Float64 | None) -> Camera:
        """The same camera in a world with a point (3,) as its origin; None: as it is."""
        if origin is None:
            return self
        pose = self.world_from_camera.copy()
        pose[:3, 3] -= origin
        return replace(self, world_from_camera=pose)

    def cropped(self, box: Box) -> Camera:
        """The same camera on a box of its frame."""
        return replace(
            self, cx=self.cx - box.x0, cy=self.cy - box.y0, width=box.width, height=box.height
        )

    def resized(self, width: int, height: int) -> Camera:
        """The camera of the same frame at another size [px]."""
        x, y = width / self.width, height / self.height
        return replace(
            self, fx=self.fx * x, fy=self.fy * y, cx=self.cx * x, cy=self.cy * y, width=width,
            height=height,
        )  # fmt: skip

    @property
    def camera_from_world(self) -> Float64:
        """Inverse of the pose (4, 4)."""
        return _inverse(self.world_from_camera.astype(np.float64, copy=False).tobytes())

    def to_camera(self, world: Float64) -> Float64:
        """World points (N, 3) in camera space, x right, y up, looking along -z [scene unit]."""
        matrix = self.camera_from_world
        return np.asarray(world @ matrix[:3, :3].T + matrix[:3, 3])

    def pixels(self, camera_points: Float64) -> Float64:
        """Pixel positions (N, 2), column then row, of camera-space points with z < 0 (N, 3)."""
        depth = -camera_points[:, 2]
        columns = self.cx + self.fx * camera_points[:, 0] / depth
        return np.stack([columns, self.cy - self.fy * camera_points[:, 1] / depth], axis=1)

    def rays(self, places: Float64) -> Float64:
        """Directions (N, 3) in camera axes, with z = -1, of pixel positions (N, 2)."""
        x, y = (places[:, 0] - self.cx) / self.fx, -(places[:, 1] - self.cy) / self.fy
        return np.stack([x, y, np.full_like(x, -1.0)], axis=1)

    def ground_seen_at(self, places: Float64, ground_y: float) -> tuple[Float64, Float64]:
        """The ground, the horizontal plane y = ground_y, at pixel positions (N, 2).

        Returns:
            Its points (N, 3) and their camera-space depth (N,) [scene unit], NaN at and above the
            horizon, and where the camera lies below it.
        """
        eye = self.world_from_camera[:3, 3]
        ways = self.rays(places) @ self.world_from_camera[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (ground_y - eye[1]) / ways[:, 1]
        depth[~((depth > 0.0) & (ways[:, 1] < 0.0))] = np.nan
        return np.asarray(eye + depth[:, None] * ways), depth

    def points_at(self, depth: Float32, columns: Float64, rows: Float64) -> Float32:
        """World points (h, w, 3) at depths (h, w) of columns (w,) and rows (h,) [px]."""
        pose = self.world_from_camera.astype(np.float32)
        x = np.asarray((columns - self.cx) / self.fx, np.float32)[None, :]
        y = np.asarray(-(rows - self.cy) / self.fy, np.float32)[:, None]
        planes = [depth * (a[0] * x + a[1] * y - a[2]) + a[3] for a in pose[:3]]
        return np.ascontiguousarray(np.stack(planes, axis=-1))

    def plane_disparity(self, ground_y: float) -> Float64:
        """Disparity of the horizontal plane y = ground_y at every pixel centre (H, W).

        Disparity of a plane is affine in the pixel position; it is <= 0 at and above the horizon.

        Args:
            ground_y: height of the plane in the world [scene unit].

        Returns:
            1 / camera-space depth [1 / scene unit]; all zero where the camera lies in the plane.
        """
        columns, rows = np.arange(self.width, dtype=np.float64), np.arange(self.height, dtype=float)
        return self.disparity_at(columns + 0.5, rows + 0.5, ground_y)

    def corner_disparity(self, ground_y: float) -> Float64:
        """Disparity of that plane at the corners of the frame (2, 2) [1 / scene unit]."""
        ends = np.array([0.0, self.width]), np.array([0.0, self.height])
        return self.disparity_at(*ends, ground_y)

    def plane_points(self, ground_y: float) -> Float64:
        """Points of that plane at pixel centres (H, W, 3); any point where it is not seen."""
        disparity = self.plane_disparity(ground_y)
        depth = 1.0 / np.where(disparity > 0.0, disparity, 1.0)
        x = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        y = -(np.arange(self.height) + 0.5 - self.cy) / self.fy
        rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)
        rotation, eye = self.world_from_camera[:3, :3], self.world_from_camera[:3, 3]
        return np.asarray(depth[..., None] * (rays @ rotation.T) + eye)

    def disparity_at(self, x: Float64, y: Float64, ground_y: float) -> Float64:
        """Disparity of that plane at columns (W,) and rows (H,) of places [px]: (H, W)."""
        up = self.world_from_camera[1, :3]
        below = ground_y - self.world_from_camera[1, 3]
        if below == 0.0:
            return np.zeros((len(y), len(x)))
        columns, rows = (x - self.cx) / self.fx, -(y - self.cy) / self.fy
        return np.asarray((up[0] * columns[None, :] + up[1] * rows[:, None] - up[2]) / below)


@lru_cache(maxsize=64)  # grids, crops and moments share few poses
def _inverse(pose: bytes) -> Float64:
    """Inverse of a pose (4, 4), which is not to be written to."""
    inverse = np.asarray(np.linalg.inv(np.frombuffer(pose).reshape(4, 4)))
    inverse.flags.writeable = False
    return inverse


class Perspective(Struct, frozen=True, kw_only=True):
    """A camera as the file declares it.

    Attributes:
        name: its own name, else its node's, else `camera N`.
        node_name: name of the node that carries it.
        node: index of that node.
        number: its own index among the file's cameras.
        yfov: vertical field of view where no animation changes it [rad].
        aspect_ratio: width by height it was made for, or None [1].
    """

    name: str
    node_name: str
    node: int
    number: int
    yfov: float
    aspect_ratio: float | None

    def yfov_at(self, animation: Animation, time_s: float) -> float:
        """Vertical field of view at a time [s] of an animation [rad].

        Raises:
            SceneError: a spline between its keys leaves what a camera can have.
        """
        animated = animation.yfov(self.number, time_s)
        if animated is None:
            return self.yfov
        if not 0.0 < animated < math.pi:
            raise SceneError(
                f"its animated field of view is {animated:.4g} at {time_s:.4g} s, expected an "
                "angle between 0 and pi; straighten the curve between its keys"
            )
        return animated


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
                number=number,
                yfov=yfov,
                aspect_ratio=lens.positive("aspectRatio"),
            )
        )
    return tuple(cameras)


def chosen_camera(cameras: Sequence[Perspective], name: str | None, path: Path) -> Perspective:
    """The camera of a name, of itself or its node; the first for None.

    Raises:
        SceneError: the file has no such camera.
    """
    if not cameras:
        raise MissingCameraError(
            f"{path}: no perspective camera; give the plate's by --camera-from CAMERA (found by "
            "`nlens-video solve`), or place the object with --at X,Y --size S --yaw D --horizon H "
            "(`nlens-video place` shows choices), or add one in the modelling program and export it"
        )
    if name is None:
        return cameras[0]
    for camera in cameras:
        if name in (camera.name, camera.node_name):
            return camera
    known = ", ".join(camera.name for camera in cameras)
    raise SceneError(f"{path}: no camera is named '{name}'; expected one of {known}")


def rigid(world: Float64) -> Float64:
    """A node's world matrix (4, 4) without scale and shear: what a camera sees along -Z, Y up.

    Raises:
        SceneError: the matrix has no direction.
    """
    back, up = world[:3, 2], world[:3, 1]
    z = back / max(float(np.linalg.norm(back)), 1e-300)
    x = np.cross(up, z)
    length = float(np.linalg.norm(x))
    if length == 0.0:
        raise SceneError("the matrix of its node has no direction; give it a scale other than 0")
    x = x / length
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, world[:3, 3]
    return pose
