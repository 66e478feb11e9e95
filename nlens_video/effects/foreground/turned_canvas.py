"""The canvas of a camera that moves: frames are laid as another camera at one place sees them.

A camera that turns in its place sees the same picture from there: it is laid exactly. One that
travels sees another one from each place: there the canvas' camera has to go along.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nlens_video.core.box import undistorted_radius
from nlens_video.core.layers import Box, Float32, Float64, Picture
from nlens_video.effects.foreground.background import SmallBackground, root, small_size
from nlens_video.effects.foreground.canvas import ground_disparity_at
from nlens_video.scene.camera import Camera

_WIDER, _TALLER = 2.0, 1.5  # of a turned canvas, by the frame [1]
NOWHERE = -1e6  # a pixel that another camera does not see [px]
_FOLDS = -1.0 / 3.0  # k1 r^2 from which on a lens shows what lies farther out farther in
_BELOW = 1e-3  # of a distance, by which a point lies beside the one straight below
_STEP = 8  # pixels between places whose position is worked out [px]
_LEAST_DEPTH = 1e-6  # before a camera, of the distance of what it sees [1]

Places = tuple[Float32, Float32]
"""Columns and rows (h, w), for `cv2.remap`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnedCanvas:
    """The picture of one camera that looks at the object, for the frames of another that moves.

    Attributes:
        camera: it; its frame is the canvas.
        frame: columns and rows of the shot's frames [px].
        distortion_k1: of their lens, as of `SolvedCamera` [1].
    """

    camera: Camera
    frame: tuple[int, int]
    distortion_k1: float = 0.0

    @classmethod
    def towards(cls, point: Float64, camera: Camera, *, distortion_k1: float = 0.0) -> TurnedCanvas:
        """The canvas of a camera that turns to a point of the scene (3,), as far down as it looks.

        Args:
            point: of the scene.
            camera: of a frame.
            distortion_k1: of its lens.
        """
        pose = camera.world_from_camera.copy()
        away = point - pose[:3, 3]
        level = math.hypot(away[0], away[2])
        if level > _BELOW * float(np.linalg.norm(away)):  # else it has no direction to turn to
            pitch = float(np.clip(pose[1, 2], -0.99, 0.99))  # sine of how far down it looks
            flat: Float64 = -math.sqrt(1.0 - pitch * pitch) / level * away
            back = np.array([flat[0], pitch, flat[2]])
            right = np.cross([0.0, 1.0, 0.0], back)
            right /= np.linalg.norm(right)
            pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        frame = camera.width, camera.height
        across, down = small_size(*frame)
        small = round(_WIDER * across), round(_TALLER * down)
        width, height = (
            round(one * whole / part)
            for one, whole, part in zip(small, frame, (across, down), strict=True)
        )
        turned = replace(
            camera, world_from_camera=pose, width=width, height=height,
            cx=camera.cx + 0.5 * (width - frame[0]), cy=camera.cy + 0.5 * (height - frame[1]),
        )  # fmt: skip
        return cls(camera=turned, frame=frame, distortion_k1=distortion_k1)

    def from_eye(self, eye: Float64) -> TurnedCanvas:
        """The canvas of a camera that looks the same way from elsewhere (3,)."""
        pose = self.camera.world_from_camera.copy()
        pose[:3, 3] = eye
        return replace(self, camera=replace(self.camera, world_from_camera=pose))

    @property
    def size(self) -> tuple[int, int]:
        """As of `Canvas`."""
        return self.camera.width, self.camera.height

    @property
    def small_size(self) -> tuple[int, int]:
        """As of `Canvas`."""
        across, down = small_size(*self.frame)
        return round(_WIDER * across), round(_TALLER * down)

    def small(self, picture: Picture, camera: Camera) -> Float32:
        """As of `Canvas`."""
        size = small_size(*self.frame)
        roots = root(picture.downsample(*size))
        canvas = self.camera.resized(*self.small_size)
        places = self._places(canvas, camera.resized(*size), Box(0, 0, *self.small_size))
        return laid(roots, places)

    def still(self, picture: Picture, camera: Camera) -> Float32:
        """As of `Canvas`."""
        return self.small(picture, camera)

    def background(self, small: SmallBackground, camera: Camera) -> SmallBackground:
        """As of `Canvas`."""
        return small

    def part(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        columns, rows = self._places(self.camera, camera, box)
        frame = Box(0, 0, *self.frame)
        held = around(columns, rows).expanded(2).intersection(frame)
        if held.empty:
            return np.full((*box.shape, 3), np.nan, np.float32)
        moved = columns - np.float32(held.x0), rows - np.float32(held.y0)
        return laid(root(picture.linear(held)), moved)

    def reached(self, box: Box, camera: Camera) -> Box:
        """As of `Canvas`."""
        edges = self.frame_places(camera, box)
        return around(*edges).intersection(Box(0, 0, *self.size))

    def seen(self, box: Box, camera: Camera) -> Box:
        """As of `Canvas`."""
        return around(*self._places(self.camera, camera, box)).intersection(Box(0, 0, *self.frame))

    def from_small(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        columns, rows = self.frame_places(camera, box)
        across, down = (
            np.float32(small / large)
            for small, large in zip(self.small_size, self.size, strict=True)
        )
        half = np.float32(0.5)
        places = (columns + half) * across - half, (rows + half) * down - half
        found = cv2.remap(values, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(found, np.float32)

    def from_part(self, values: Float32, held: Box, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        columns, rows = self.frame_places(camera, box)
        return laid(values, (columns - np.float32(held.x0), rows - np.float32(held.y0)))

    def ground_disparity(
        self, place: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """As of `Canvas`."""
        disparity = ground_disparity_at(place, self.camera, ground_y)
        if not disparity > 0.0:
            return disparity
        ray = np.array([
            (math.floor(place[0]) + 0.5 - self.camera.cx) / self.camera.fx,
            -(math.floor(place[1]) + 0.5 - self.camera.cy) / self.camera.fy, -1.0,
        ])  # fmt: skip
        pose = self.camera.world_from_camera
        point = pose[:3, :3] @ ray / disparity + pose[:3, 3]
        depth = -float(camera.to_camera(point[None])[0, 2])
        return 1.0 / depth if depth > 0.0 else math.inf

    def shown(self, places: Places, camera: Camera) -> Places:
        """Where a frame shows places of the canvas."""
        canvas, half = self.camera, 0.5
        x = (places[0].astype(np.float64) + half - canvas.cx) / canvas.fx
        y = (places[1].astype(np.float64) + half - canvas.cy) / canvas.fy
        x, y = self._distorted(*self._pinhole(canvas, camera, x, y))
        return (
            np.nan_to_num(x * camera.fx + camera.cx - half, nan=NOWHERE).astype(np.float32),
            np.nan_to_num(y * camera.fy + camera.cy - half, nan=NOWHERE).astype(np.float32),
        )

    def _places(self, canvas: Camera, camera: Camera, box: Box) -> Places:
        """Where a frame's camera shows the pixels of a box of the canvas."""
        x, y = self._pinhole(canvas, camera, *_rays(canvas, box))
        return _indices(camera, *self._distorted(x, y), box)

    def _distorted(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Where the frames' lens shows what a pinhole shows at x, y by focal lengths."""
        square = self.distortion_k1 * (x * x + y * y)
        scale = np.where(square > _FOLDS, 1.0 + square, np.nan)
        return x * scale, y * scale

    def frame_places(self, camera: Camera, box: Box) -> Places:
        """Where the canvas shows the pixels of a box of a frame."""
        x, y = np.broadcast_arrays(*_rays(camera, box))
        if self.distortion_k1:
            far = np.maximum(np.hypot(x, y), 1e-9)
            scale = undistorted_radius(self.distortion_k1, 0.0, far) / far
            x, y = x * scale, y * scale
        return _indices(self.camera, *self._pinhole(camera, self.camera, x, y), box)

    def _pinhole(
        self, one: Camera, other: Camera, x: Float64, y: Float64
    ) -> tuple[Float64, Float64]:
        """Where another camera sees what a camera sees at x, y right and down, by focal lengths."""
        turn = other.world_from_camera[:3, :3].T
        ray = np.stack(np.broadcast_arrays(x, -y, -1.0), axis=-1) @ one.world_from_camera[:3, :3].T
        seen: Float64 = ray @ turn.T
        depth = -seen[..., 2]
        depth[depth < _LEAST_DEPTH] = np.nan
        across: Float64 = seen[..., 0] / depth
        down: Float64 = -seen[..., 1] / depth
        return across, down


def _rays(camera: Camera, box: Box) -> tuple[Float64, Float64]:
    """Columns (1, w) and rows (h, 1) of a grid over a box, by focal lengths.

    What lies between its places is interpolated: they are as far apart as bends do not matter.
    """
    across, down = math.ceil(box.width / _STEP), math.ceil(box.height / _STEP)
    x: Float64 = (
        box.x0 + _STEP * (np.arange(-1, across + 1, dtype=np.float64) + 0.5) - camera.cx
    ) / camera.fx
    y: Float64 = (
        box.y0 + _STEP * (np.arange(-1, down + 1, dtype=np.float64) + 0.5) - camera.cy
    ) / camera.fy
    return x[None, :], y[:, None]


def _indices(camera: Camera, x: Float64, y: Float64, box: Box) -> Places:
    """Pixels of a camera, as `cv2.remap` counts them, that a box shows; its grid's are at x, y."""
    columns = np.nan_to_num(x * camera.fx + camera.cx - 0.5, nan=NOWHERE)
    rows = np.nan_to_num(y * camera.fy + camera.cy - 0.5, nan=NOWHERE)
    inside = slice(_STEP, _STEP + box.height), slice(_STEP, _STEP + box.width)
    size = _STEP * x.shape[1], _STEP * x.shape[0]
    found = [
        cv2.resize(np.clip(one, NOWHERE, -NOWHERE), size, interpolation=cv2.INTER_LINEAR)[inside]
        for one in (columns, rows)
    ]
    return found[0].astype(np.float32), found[1].astype(np.float32)


def laid(values: Float32, places: Places) -> Float32:
    """Values (H, W, ...) at places, NaN beyond their outermost pixels."""
    columns, rows = places
    height, width = values.shape[:2]
    known = (columns >= 0.0) & (columns <= width - 1) & (rows >= 0.0) & (rows <= height - 1)
    found = cv2.remap(values, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    found = np.maximum(found, np.float32(0.0))
    found[~known] = np.nan
    return np.asarray(found, np.float32)


def around(columns: Float32, rows: Float32) -> Box:
    """The box around places that are seen at all."""
    known = (np.abs(columns) < -NOWHERE) & (np.abs(rows) < -NOWHERE)
    if not known.any():
        return Box(0, 0, 0, 0)
    columns, rows = columns[known], rows[known]
    return Box(
        math.floor(columns.min()), math.floor(rows.min()),
        math.ceil(columns.max()) + 1, math.ceil(rows.max()) + 1,
    )  # fmt: skip
