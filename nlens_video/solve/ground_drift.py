"""How far something slides over the ground of a plate, by points that are tracked there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from nlens_video.cameras.solved import undistorted
from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.core.optics import Distortion
from nlens_video.scene.camera import Camera

LIMIT_PX, LIMIT_SHARE = 2.0, 0.002
"""Drift from which an object is seen to slide: the larger of pixels and a share of the width."""
_REACHES = ((0.1, 0.5, 0.25, 12), (0.25, 0.5, 0.5, 20))
"""Above, below and beside the object's contact, by its box, and in pixels: near, else farther."""
_FEWEST = 5
_LEAST_GROUND = 1.0 / 3.0  # share of the points around the object that are of the ground
_ALIKE_PX = 0.5  # between steps of one thing
_AT_REST = 1e-6  # change of a pose or of a focal length that is none [1]
_SURE = 3.0  # standard errors


@dataclass(slots=True)
class GroundDrift:
    """Adds up, frame by frame, how tracked ground moves against where it is expected.

    Memory does not grow with the clip.

    Attributes:
        frames: on which the ground was compared [1].
        step_px: drift since the frame before, 0 where that is not known [px].
    """

    frames: int = 0
    step_px: float = 0.0
    _drift: Float64 = field(default_factory=lambda: np.zeros(2))
    _variance: float = 0.0
    _squares: float = 0.0
    _worst: float = 0.0
    _before: Mapping[int, Float32] | None = None

    @property
    def rms_px(self) -> float:
        """Root mean square over the frames [px]."""
        return math.sqrt(self._squares / self.frames) if self.frames else 0.0

    @property
    def worst_px(self) -> float:
        """Largest distance from where the ground was at first [px]."""
        return self._worst

    def slides(self, width: int, scale: float = 1.0) -> bool:
        """Whether the drift is visible in the frame, and no noise.

        Args:
            width: of the frame [px].
            scale: the frame's pixels by those of the picture that was tracked [1].
        """
        limit = max(LIMIT_PX, LIMIT_SHARE * width) / scale
        return self.rms_px > limit and self._worst > limit + _SURE * math.sqrt(self._variance)

    def add(
        self, points: Mapping[int, Float32], box: Box, expected: Callable[[Float64], Float64]
    ) -> None:
        """Compare one more frame with the one before.

        Args:
            points: tracked in the plate, by a number that each keeps (2,) [px].
            box: of the object [px].
            expected: takes pixels (N, 2) of the frame before to those of this one, NaN where there
                is no ground.
        """
        before, self._before = self._before, points
        self.step_px = 0.0
        both = [] if before is None else [number for number in points if number in before]
        if before is None or len(both) < _FEWEST:
            return
        first = np.array([before[number] for number in both], np.float64)
        now = np.array([points[number] for number in both], np.float64)
        seen = expected(first)
        known = np.isfinite(seen).all(axis=1)
        around = (known & _around(box, reach, first) for reach in _REACHES)
        near = next((one for one in around if one.sum() >= _FEWEST), None)
        if near is None:
            return
        step = now - seen
        middle, error = _of_the_ground(step[near])
        everywhere, _ = _of_the_ground(step[known])
        # what moves by itself beside the object is not the ground: most of the plate stays then
        if np.linalg.norm(everywhere) < np.linalg.norm(middle):
            middle = everywhere
        self._drift = self._drift + middle
        self.step_px = float(np.linalg.norm(middle))
        self._variance += error**2
        away = float(np.linalg.norm(self._drift))
        self.frames += 1
        self._squares += away**2
        self._worst = max(self._worst, away)


def seen_by_pinhole(
    points: Mapping[int, Float32], camera: Camera, distortion_k1: float
) -> Mapping[int, Float32]:
    """Tracked points where a pinhole sees them.

    Args:
        points: as of `GroundDrift.add`.
        camera: the pinhole.
        distortion_k1: of the plate's lens, as of `SolvedCamera` [1].
    """
    if not distortion_k1 or not points:
        return points
    shown = np.array(list(points.values()), np.float64)
    lens = Distortion(k1=distortion_k1, focal_normalized=True)
    seen = undistorted(shown, camera, lens).astype(np.float32)
    return dict(zip(points, seen, strict=True))


def ground_seen(before: Camera, now: Camera, ground_y: float) -> Callable[[Float64], Float64]:
    """Where a camera sees the ground that another one saw, as `GroundDrift.add` takes it.

    Args:
        before: the camera of the frame before.
        now: that of this frame.
        ground_y: height of the ground [scene unit].
    """

    def seen_again(first: Float64) -> Float64:
        rays = np.column_stack([
            (first[:, 0] - before.cx) / before.fx,
            -(first[:, 1] - before.cy) / before.fy,
            -np.ones(len(first)),
        ])  # fmt: skip
        rays = rays @ before.world_from_camera[:3, :3].T
        eye = before.world_from_camera[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (ground_y - eye[1]) / rays[:, 1]
        on_ground = np.isfinite(depth) & (depth > 0.0)
        points = now.to_camera(eye + np.where(on_ground, depth, 1.0)[:, None] * rays)
        there = on_ground & (points[:, 2] < 0.0)
        spots = now.pixels(np.where(there[:, None], points, [0.0, 0.0, -1.0]))
        return np.where(there[:, None], spots, np.nan)

    return seen_again


def _around(
    box: Box, reach: tuple[float, float, float, int], points: Float64
) -> np.typing.NDArray[np.bool_]:
    """Which points (N, 2) lie around the lower border of the object's box."""
    width, height = box.x1 - box.x0, box.y1 - box.y0
    above, below, beside, margin = reach
    left, right = box.x0 - beside * width - margin, box.x1 + beside * width + margin
    top, bottom = box.y1 - above * height - margin, box.y1 + below * height + margin
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x > left) & (x < right) & (y > top) & (y < bottom))


def _of_the_ground(steps: Float64) -> tuple[Float64, float]:
    """Step of the ground (N, 2), and its standard error, where other things are tracked too [px].

    Of the ground are the third of the points that keeps best to where it is expected, and all that
    move as those do. Where the whole ground slides, that third does too.
    """
    least = max(_FEWEST, math.ceil(_LEAST_GROUND * len(steps)))
    kept = steps[np.argsort(np.linalg.norm(steps, axis=1), kind="stable")[:least]]
    middle, error = _median(kept)
    spread = error * math.sqrt(len(kept)) / 1.25
    alike = np.linalg.norm(steps - middle, axis=1) <= max(_ALIKE_PX, _SURE * spread)
    return _median(steps[alike])


def _median(steps: Float64) -> tuple[Float64, float]:
    """Median of (N, 2), and its standard error by the median deviation [px]."""
    middle = np.median(steps, axis=0)
    spread = 1.4826 * float(np.median(np.linalg.norm(steps - middle, axis=1)))
    return middle, 1.25 * spread / math.sqrt(len(steps))


def has_moved(before: Camera, now: Camera) -> bool:
    """Whether a camera has another pose or focal length."""
    size = max(1.0, float(np.abs(before.world_from_camera).max()))
    change = np.abs(now.world_from_camera - before.world_from_camera).max()
    return bool(change > _AT_REST * size or abs(now.fx - before.fx) > _AT_REST * before.fx)
