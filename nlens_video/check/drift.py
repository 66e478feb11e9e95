"""Whether the object keeps its place on the plate's ground, as tracked points show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.check.frames import BLOCK_PX, FrameFeatures
from nlens_video.check.regions import Mask
from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.scene.camera import Camera
from nlens_video.solve.ground_drift import GroundDrift, ground_seen, seen_by_pinhole
from nlens_video.solve.tracks import Tracker, UInt8, follow

_WIDTH = 960  # of the pictures that are tracked, at most [px]
_POINTS = 400
_OBJECT_POINTS = 80
_LOWER = 0.6  # of the object, where it stands
_GROUND_MOVES_PX, _STILL_PX = 0.6, 0.2  # from frame to frame
_LEAST_POINTS, _STILL_SHARE = 30, 0.2  # over the clip
_FEWEST_STEPS = 8  # points whose motion is the plate's


@dataclass(slots=True)
class DriftMeasure:
    """Follows the ground around the object in the plate, and the object in the result.

    With the camera that the object was rendered with, the ground must move as the camera says. An
    object without one is judged only where it stays at rest in the frame: what walks on the ground
    moves against it.

    Attributes:
        solved: the camera that the object was rendered with, None where it is not known.
        start_s: time of the plate's first frame, as the camera counts it [s].
        plate_step_px: how far right and down the plate has moved since the frame before, (2,); 0
            where it has too few points [px].
    """

    solved: SolvedCamera | None = None
    start_s: float = 0.0
    plate_step_px: Float64 = field(default_factory=lambda: np.zeros(2))
    _tracker: Tracker = field(default_factory=lambda: Tracker(most=_POINTS, recorded=False))
    _drift: GroundDrift = field(default_factory=GroundDrift)
    _width: int = 0
    _full_width: int = 0
    _camera: Camera | None = None
    _object: tuple[UInt8, Mask] | None = None
    _points: int = 0
    _still_points: int = 0

    def add(self, plate: FrameFeatures, result: FrameFeatures, mask: Mask | None) -> None:
        """Take the next pair of frames, with the object's blocks (h, w); None without an object."""
        full, self._full_width = plate.luma.shape[::-1], plate.luma.shape[1]
        self._width = min(_WIDTH, full[0])
        size = self._width, max(1, round(full[1] * self._width / full[0]))
        known = self._tracker.current
        self._tracker.add(_small(plate.luma, size))
        self.plate_step_px = self._scale * _middle_step(known, self._tracker.current)
        camera = None
        if self.solved is not None:
            camera = self.solved.at(self.start_s + float(plate.time_s)).resized(*size)
        before, self._camera = self._camera or camera, camera
        if mask is None:
            self._object = None
            return
        points: Mapping[int, Float32] = self._tracker.current
        if camera is not None and before is not None and self.solved is not None:
            expected = ground_seen(before, camera, self.solved.ground_y)
            points = seen_by_pinhole(points, camera, self.solved.distortion_k1)
        else:
            expected = _same
        self._drift.add(points, _box(mask, self._width / full[0]), expected)
        if self.solved is None:
            self._follow_object(_small(result.luma, size), mask)

    @property
    def rms_px(self) -> float | None:
        """Drift over the ground, root mean square; None where it is not known [px]."""
        if self.solved is None and self._slides and not self._at_rest:
            return None
        return self._scale * self._drift.rms_px

    @property
    def worst_px(self) -> float:
        """Largest drift [px]."""
        return self._scale * self._drift.worst_px

    @property
    def slides(self) -> bool:
        """Whether the object is known to slide over the ground."""
        return self.rms_px is not None and self._slides

    @property
    def _slides(self) -> bool:
        return self._drift.slides(self._full_width, self._scale)

    @property
    def _scale(self) -> float:
        return self._full_width / self._width if self._width else 1.0

    @property
    def _at_rest(self) -> bool:
        """Whether what stands on the ground stays where it is in the frame."""
        return self._points >= _LEAST_POINTS and self._still_points > _STILL_SHARE * self._points

    def _follow_object(self, picture: UInt8, mask: Mask) -> None:
        """Count the object's points that stand still in the frame while the ground moves."""
        before, self._object = self._object, (picture, mask)
        if before is None or self._drift.step_px < _GROUND_MOVES_PX:
            return
        inside = _lower(before[1] & mask, picture.shape)
        corners = cv2.goodFeaturesToTrack(before[0], _OBJECT_POINTS, 0.02, 4, mask=inside)
        if corners is None:
            return
        points = corners.reshape(-1, 2).astype(np.float32)
        moved, kept = follow(before[0], picture, points)
        steps = np.linalg.norm(moved - points, axis=1)[kept]
        self._points += len(steps)
        self._still_points += int((steps < _STILL_PX).sum())


def _middle_step(before: Mapping[int, Float32], now: Mapping[int, Float32]) -> Float64:
    """The median motion (2,) of the points that both have; 0 where they are too few."""
    steps = [now[number] - place for number, place in before.items() if number in now]
    return np.median(steps, axis=0) if len(steps) >= _FEWEST_STEPS else np.zeros(2)


def _same(first: Float64) -> Float64:
    return first


def _small(luma: Float32, size: tuple[int, int]) -> UInt8:
    picture = luma
    if size != luma.shape[::-1]:
        picture = np.asarray(cv2.resize(luma, size, interpolation=cv2.INTER_AREA), np.float32)
    return np.asarray(np.clip(picture + 0.5, 0.0, 255.0), np.uint8)


def _box(mask: Mask, scale: float) -> Box:
    """The box of some blocks in the tracked picture [px]."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    edges = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)
    return Box(*(round(BLOCK_PX * scale * int(edge)) for edge in edges))


def _lower(mask: Mask, shape: tuple[int, ...]) -> UInt8:
    """The lower part of some blocks, without their border, as a picture (H, W) of 0 and 255."""
    blocks = mask.astype(np.uint8)
    inner = cv2.erode(blocks, np.ones((3, 3), np.uint8), borderValue=0)
    chosen = inner if inner.any() else blocks
    rows = np.flatnonzero(mask.any(1))
    if len(rows):
        chosen[: round(rows[-1] + 1 - _LOWER * (rows[-1] + 1 - rows[0]))] = 0
    size = shape[1], shape[0]
    return np.asarray(255 * cv2.resize(chosen, size, interpolation=cv2.INTER_NEAREST), np.uint8)
