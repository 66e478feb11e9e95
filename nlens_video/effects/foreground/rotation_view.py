"""Reference view of a camera that rotates: the view of a virtual camera at one orientation.

Two views from one place differ by a homography, whatever the scene's depth, so frames of a camera
that rotates in place are warped exactly. For a camera that travels, see `ParallaxView`.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.box import undistorted_radius
from nlens_video.core.layers import Box, Float32, Float64, Picture
from nlens_video.effects.foreground.background import BackgroundModel, lowres_size, sqrt_light
from nlens_video.effects.foreground.reference_view import PixelMap, ground_disparity_at
from nlens_video.scene.camera import Camera

_WIDTH_FACTOR, _HEIGHT_FACTOR = 2.0, 1.5  # size of the reference view, by that of the frame [1]
OUT_OF_VIEW = -1e6
"""Column and row of a pixel that the other camera does not see [px]."""
_MIN_K1_R2 = -1.0 / 3.0  # k1 r^2 below which the distorted radius falls again [1]
_MIN_LEVEL = 1e-3  # level part of a direction below which it is vertical, by its length [1]
_GRID_STEP_PX = 8  # grid of pixels that are projected; those between are interpolated [px]
_MIN_DEPTH = 1e-6  # depth of a ray in the target camera, by that in the source camera [1]


class RotationView(Struct, frozen=True, kw_only=True):
    """The view of a virtual camera that looks at the object, for frames of a camera that rotates.

    Attributes:
        camera: the virtual camera, a pinhole; its image is the reference view.
        frame_size: columns and rows of the shot's frames [px].
        distortion_k1: of their lens, as in `SolvedCamera` [1].
    """

    camera: Camera
    frame_size: tuple[int, int]
    distortion_k1: float = 0.0

    @classmethod
    def looking_at(
        cls, point: Float64, camera: Camera, *, distortion_k1: float = 0.0
    ) -> RotationView:
        """The view from a frame's camera, turned to a point without roll; its pitch is kept.

        Args:
            point: of the scene (3,).
            camera: of a frame.
            distortion_k1: of its lens [1].
        """
        pose = camera.world_from_camera.copy()
        away = point - pose[:3, 3]
        level = math.hypot(away[0], away[2])
        if level > _MIN_LEVEL * float(np.linalg.norm(away)):  # else there is no heading
            pitch = float(np.clip(pose[1, 2], -0.99, 0.99))  # sine of the angle below the horizon
            flat: Float64 = -math.sqrt(1.0 - pitch * pitch) / level * away
            back = np.array([flat[0], pitch, flat[2]])
            right = np.cross([0.0, 1.0, 0.0], back)
            right /= np.linalg.norm(right)
            pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        frame_size = camera.width, camera.height
        across, down = lowres_size(*frame_size)
        lowres = round(_WIDTH_FACTOR * across), round(_HEIGHT_FACTOR * down)
        width, height = (
            round(one * whole / part)
            for one, whole, part in zip(lowres, frame_size, (across, down), strict=True)
        )
        virtual = replace(
            camera, world_from_camera=pose, width=width, height=height,
            cx=camera.cx + 0.5 * (width - frame_size[0]),
            cy=camera.cy + 0.5 * (height - frame_size[1]),
        )  # fmt: skip
        return cls(camera=virtual, frame_size=frame_size, distortion_k1=distortion_k1)

    def at_eye(self, eye: Float64) -> RotationView:
        """The view of the same orientation from another place (3,)."""
        pose = self.camera.world_from_camera.copy()
        pose[:3, 3] = eye
        return replace(self, camera=replace(self.camera, world_from_camera=pose))

    @property
    def size(self) -> tuple[int, int]:
        """See `ReferenceView`."""
        return self.camera.width, self.camera.height

    @property
    def lowres_size(self) -> tuple[int, int]:
        """See `ReferenceView`."""
        across, down = lowres_size(*self.frame_size)
        return round(_WIDTH_FACTOR * across), round(_HEIGHT_FACTOR * down)

    def warp_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """See `ReferenceView`."""
        size = lowres_size(*self.frame_size)
        roots = sqrt_light(picture.downsample(*size))
        virtual = self.camera.resized(*self.lowres_size)
        pixels = self._map_to_frame(virtual, camera.resized(*size), Box(0, 0, *self.lowres_size))
        return warp(roots, pixels)

    def register_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """See `ReferenceView`."""
        return self.warp_lowres(picture, camera)

    def render_background(self, model: BackgroundModel, camera: Camera) -> BackgroundModel:
        """See `ReferenceView`."""
        return model

    def register_box(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        columns, rows = self._map_to_frame(self.camera, camera, box)
        return warp_picture(picture, (columns, rows), self.frame_size)

    def box_in_reference(self, box: Box, camera: Camera) -> Box:
        """See `ReferenceView`."""
        pixels = self.map_to_reference(camera, box)
        return bounding_box(*pixels).intersection(Box(0, 0, *self.size))

    def box_in_frame(self, box: Box, camera: Camera) -> Box:
        """See `ReferenceView`."""
        pixels = self._map_to_frame(self.camera, camera, box)
        return bounding_box(*pixels).intersection(Box(0, 0, *self.frame_size))

    def lowres_to_frame(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        columns, rows = self.map_to_reference(camera, box)
        across, down = (
            np.float32(low / full) for low, full in zip(self.lowres_size, self.size, strict=True)
        )
        half = np.float32(0.5)
        pixels = (columns + half) * across - half, (rows + half) * down - half
        found = cv2.remap(values, *pixels, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(found, np.float32)

    def box_to_frame(self, values: Float32, source: Box, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        columns, rows = self.map_to_reference(camera, box)
        return warp(values, (columns - np.float32(source.x0), rows - np.float32(source.y0)))

    def ground_disparity(
        self, point: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """See `ReferenceView`."""
        disparity = ground_disparity_at(point, self.camera, ground_y)
        if not disparity > 0.0:
            return disparity
        ray = np.array([
            (math.floor(point[0]) + 0.5 - self.camera.cx) / self.camera.fx,
            -(math.floor(point[1]) + 0.5 - self.camera.cy) / self.camera.fy, -1.0,
        ])  # fmt: skip
        pose = self.camera.world_from_camera
        on_ground = pose[:3, :3] @ ray / disparity + pose[:3, 3]
        depth = -float(camera.to_camera(on_ground[None])[0, 2])
        return 1.0 / depth if depth > 0.0 else math.inf

    def project_to_frame(self, pixels: PixelMap, camera: Camera) -> PixelMap:
        """Pixels of a frame that show given pixels of this view."""
        virtual, half = self.camera, 0.5
        x = (pixels[0].astype(np.float64) + half - virtual.cx) / virtual.fx
        y = (pixels[1].astype(np.float64) + half - virtual.cy) / virtual.fy
        x, y = self._distort(*self._rotate(virtual, camera, x, y))
        return (
            np.nan_to_num(x * camera.fx + camera.cx - half, nan=OUT_OF_VIEW).astype(np.float32),
            np.nan_to_num(y * camera.fy + camera.cy - half, nan=OUT_OF_VIEW).astype(np.float32),
        )

    def _map_to_frame(self, virtual: Camera, camera: Camera, box: Box) -> PixelMap:
        """Pixels of a frame that show the pixels of a box of the virtual camera."""
        x, y = self._rotate(virtual, camera, *_ray_grid(virtual, box))
        return _dense_map(camera, *self._distort(x, y), box)

    def _distort(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Radial distortion by the frames' lens, in normalised image coordinates."""
        k1_r2 = self.distortion_k1 * (x * x + y * y)
        scale = np.where(k1_r2 > _MIN_K1_R2, 1.0 + k1_r2, np.nan)
        return x * scale, y * scale

    def map_to_reference(self, camera: Camera, box: Box) -> PixelMap:
        """Pixels of this view that show the pixels of a box of a frame."""
        x, y = np.broadcast_arrays(*_ray_grid(camera, box))
        if self.distortion_k1:
            radius = np.maximum(np.hypot(x, y), 1e-9)
            scale = undistorted_radius(self.distortion_k1, 0.0, radius) / radius
            x, y = x * scale, y * scale
        return _dense_map(self.camera, *self._rotate(camera, self.camera, x, y), box)

    def _rotate(
        self, source: Camera, target: Camera, x: Float64, y: Float64
    ) -> tuple[Float64, Float64]:
        """Infinite homography from a camera to another, in normalised image coordinates.

        x points right and y down; NaN where the point is not in front of the target camera.
        """
        to_target = target.world_from_camera[:3, :3].T
        ray = (
            np.stack(np.broadcast_arrays(x, -y, -1.0), axis=-1) @ source.world_from_camera[:3, :3].T
        )
        seen: Float64 = ray @ to_target.T
        depth = -seen[..., 2]
        depth[depth < _MIN_DEPTH] = np.nan
        across: Float64 = seen[..., 0] / depth
        down: Float64 = -seen[..., 1] / depth
        return across, down


def _ray_grid(camera: Camera, box: Box) -> tuple[Float64, Float64]:
    """Normalised columns (1, w) and rows (h, 1) of a coarse grid over a box, and one step around.

    The step is so small that projections are linear between its nodes.
    """
    step = _GRID_STEP_PX
    across, down = math.ceil(box.width / step), math.ceil(box.height / step)
    x: Float64 = (
        box.x0 + step * (np.arange(-1, across + 1, dtype=np.float64) + 0.5) - camera.cx
    ) / camera.fx
    y: Float64 = (
        box.y0 + step * (np.arange(-1, down + 1, dtype=np.float64) + 0.5) - camera.cy
    ) / camera.fy
    return x[None, :], y[:, None]


def _dense_map(camera: Camera, x: Float64, y: Float64, box: Box) -> PixelMap:
    """Pixels of a camera at each pixel of a box, from normalised coordinates at its coarse grid."""
    columns = np.nan_to_num(x * camera.fx + camera.cx - 0.5, nan=OUT_OF_VIEW)
    rows = np.nan_to_num(y * camera.fy + camera.cy - 0.5, nan=OUT_OF_VIEW)
    step = _GRID_STEP_PX
    inside = slice(step, step + box.height), slice(step, step + box.width)
    size = step * x.shape[1], step * x.shape[0]
    found = [
        cv2.resize(np.clip(one, OUT_OF_VIEW, -OUT_OF_VIEW), size, interpolation=cv2.INTER_LINEAR)[
            inside
        ]
        for one in (columns, rows)
    ]
    return found[0].astype(np.float32), found[1].astype(np.float32)


def warp(values: Float32, pixels: PixelMap) -> Float32:
    """Values (H, W, ...) at mapped pixels, NaN beyond their outermost pixels."""
    columns, rows = pixels
    height, width = values.shape[:2]
    known = (columns >= 0.0) & (columns <= width - 1) & (rows >= 0.0) & (rows <= height - 1)
    found = cv2.remap(values, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    found = np.maximum(found, np.float32(0.0))
    found[~known] = np.nan
    return np.asarray(found, np.float32)


def warp_picture(picture: Picture, pixels: PixelMap, size: tuple[int, int]) -> Float32:
    """Square root of a picture's light at mapped pixels (h, w, 3) [1], NaN beyond the picture.

    Args:
        picture: of `size`; only the part that the mapped pixels reach is read.
        pixels: columns and rows in it (h, w) [px].
        size: columns and rows of the picture [px].
    """
    columns, rows = pixels
    source = bounding_box(columns, rows).expanded(2).intersection(Box(0, 0, *size))
    if source.empty:
        return np.full((*columns.shape, 3), np.nan, np.float32)
    shifted = columns - np.float32(source.x0), rows - np.float32(source.y0)
    return warp(sqrt_light(picture.linear(source)), shifted)


def bounding_box(columns: Float32, rows: Float32) -> Box:
    """Bounding box of the mapped pixels that are in view."""
    known = (np.abs(columns) < -OUT_OF_VIEW) & (np.abs(rows) < -OUT_OF_VIEW)
    if not known.any():
        return Box(0, 0, 0, 0)
    columns, rows = columns[known], rows[known]
    return Box(
        math.floor(columns.min()), math.floor(rows.min()),
        math.ceil(columns.max()) + 1, math.ceil(rows.max()) + 1,
    )  # fmt: skip
