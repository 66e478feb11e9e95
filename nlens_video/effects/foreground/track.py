"""Track of one target over the frames of a shot."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import islice
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.appearance import AppearanceModel, torso_column
from nlens_video.effects.foreground.detection import Detection
from nlens_video.effects.foreground.mutual_occlusion import Localization

MOTION_FRAMES = 6
"""Isolated frames from which the motion of a target is known."""
MIN_ISOLATED_FRAMES = 2
"""Isolated frames from which the appearance of a target is known."""
_MOTION_WINDOW = 16  # frames from which motion is estimated: more than a stride
_MAX_HIDDEN_FRAMES = 25  # frames for which a target is tracked while it is hidden
_MIN_VISIBILITY = 0.3  # visible fraction of a target below which it is hidden [1]
_MIN_TRAVEL = 0.6  # way of a target that travels, by the size of its box [1]
_MIN_JUMP = 0.08  # second difference of a position that is a jump, by the target's height [1]
_BODY_HEIGHT = 0.6  # height of a person detected without legs, by the full height [1]
_MEDIAN_RADIUS = 5  # frames to either side in the running median of the foot's disparity
_ORDER_MARGIN = 0.025  # hysteresis of the order, by the object's distance [1]
_FADE_FRAMES = 1  # frames to either side over which a change of the order fades
_FULL_HEIGHT_QUANTILE = 0.75  # quantile of a track's heights that is the full height [1]


@dataclass(slots=True)
class Track:
    """A target over the frames of a shot.

    On each of its frames a target is either isolated, the only one in its blob, or merged.

    Attributes:
        frames: numbers of the frames.
        boxes: its box at low resolution; while merged, centred on the torso.
        blob_boxes: bounding box of the blob that it is in.
        torso_columns: mean column of its upper half [px].
        foot_disparities: disparity of the ground at its foot [1 / scene unit]; NaN where another
            target may hide the foot.
        contact_disparities: disparity of the object's contact with the ground [1 / scene unit].
        truncated: whether the frame's lower border cuts it.
        isolated: whether it is isolated.
        fragments: bounding boxes of its further blobs, by the number of the frame.
        frames_hidden: frames since it was last visible [1].
        backtracked: whether it was searched for on the frames before its first one.
        appearance: its appearance model.
    """

    frames: list[int] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    blob_boxes: list[Box] = field(default_factory=list)
    torso_columns: list[float] = field(default_factory=list)
    foot_disparities: list[float] = field(default_factory=list)
    contact_disparities: list[float] = field(default_factory=list)
    truncated: list[bool] = field(default_factory=list)
    isolated: list[bool] = field(default_factory=list)
    fragments: dict[int, list[Box]] = field(default_factory=dict)
    frames_hidden: int = 0
    backtracked: bool = False
    appearance: AppearanceModel = field(default_factory=AppearanceModel)
    _isolated_count: int = 0
    _predictions: dict[int, Box] = field(default_factory=dict)
    _passages: dict[Box, tuple[float, int, int] | None] = field(default_factory=dict)

    def add_isolated(
        self, index: int, detection: Detection, foot: float, contact: float,
        image: tuple[Float32, Bool] | None,
    ) -> None:  # fmt: skip
        """Append a frame on which the target is isolated, and learn its appearance there."""
        column = 0.5 * (detection.box.x0 + detection.box.x1 - 1)
        if image is not None:
            column = torso_column(image[1], detection.box)
            self.appearance.update(*image, detection.box)
        self._append(index, detection.box, detection.blob_box, column, foot, contact)
        self.truncated.append(detection.truncated)
        self.isolated.append(True)
        self._isolated_count += 1
        self.frames_hidden = 0

    def add_merged(
        self, index: int, blob: Detection, location: Localization, foot: float, contact: float
    ) -> None:
        """Append a frame on which the target is in a merged blob."""
        column = 0.5 * (location.box.x0 + location.box.x1 - 1)
        self._append(index, location.box, blob.blob_box, column, foot, contact)
        self.truncated.append(blob.truncated)
        self.isolated.append(False)
        self.frames_hidden = 0 if location.visibility > _MIN_VISIBILITY else self.frames_hidden + 1

    def revise_as_merged(
        self, index: int, blob: Detection, location: Localization, foot: float, contact: float
    ) -> None:
        """Insert a frame before the first one, or replace one that was taken for isolated.

        Args:
            index: number of the frame.
            blob: detection of the merged blob.
            location: of the target in it.
            foot: disparity of the ground at its foot [1 / scene unit].
            contact: that of the object's contact with the ground [1 / scene unit].
        """
        known = self._number(index)
        i = known or 0
        if known is not None:
            self._isolated_count -= self.isolated[i]
            for column in self._table:
                del column[i]
        self._forget()
        torso = 0.5 * (location.box.x0 + location.box.x1 - 1)
        row = index, location.box, blob.blob_box, torso, foot, contact, blob.truncated, False
        for column, value in zip(self._table, row, strict=True):
            column.insert(i, value)

    def is_in_blob(self, index: int, blob: Detection) -> bool:
        """Whether it is in a blob of a frame."""
        return (i := self._number(index)) is not None and self.blob_boxes[i] == blob.blob_box

    def is_isolated(self, index: int) -> bool:
        """Whether it is isolated on a frame."""
        return (i := self._number(index)) is not None and self.isolated[i]

    def _number(self, index: int) -> int | None:
        """Which of its frames, in their order, a frame is; None if it is none."""
        i = bisect_left(self.frames, index)
        return i if self.frames[i : i + 1] == [index] else None

    def displacement_px(self, i: int) -> float:
        """Sideways displacement from the frame before to its i-th one [px].

        That of the box' edges, which includes swinging limbs; of a merged target that of the torso.
        """
        last = max(0, i - 1)
        if not (self.isolated[i] and self.isolated[last]):
            return abs(self.torso_columns[i] - self.torso_columns[last])
        now, then = self.boxes[i], self.boxes[last]
        return float(max(abs(now.x0 - then.x0), abs(now.x1 - then.x1)))

    @property
    def _table(self) -> tuple[list[Any], ...]:
        """The lists that have a value for each frame."""
        return (
            self.frames, self.boxes, self.blob_boxes, self.torso_columns, self.foot_disparities,
            self.contact_disparities, self.truncated, self.isolated,
        )  # fmt: skip

    def _append(
        self, index: int, box: Box, blob_box: Box, column: float, foot: float, contact: float
    ) -> None:
        self._forget()
        self.frames.append(index)
        self.boxes.append(box)
        self.blob_boxes.append(blob_box)
        self.torso_columns.append(column)
        self.foot_disparities.append(foot)
        self.contact_disparities.append(contact)

    def _forget(self) -> None:
        """What was told of the frames until now."""
        self._predictions.clear()
        self._passages.clear()

    @property
    def confirmed(self) -> bool:
        """Whether its appearance is known, and it has not been hidden for too long."""
        return (
            self._isolated_count >= MIN_ISOLATED_FRAMES and self.frames_hidden <= _MAX_HIDDEN_FRAMES
        )

    @property
    def motion_known(self) -> bool:
        """Whether it has enough isolated frames to tell its motion."""
        return self._isolated_count >= MOTION_FRAMES

    @property
    def last_foot_disparity(self) -> float:
        """Disparity of the ground at its foot where that was last seen [1 / scene unit]."""
        return next((foot for foot in reversed(self.foot_disparities) if not math.isnan(foot)), 0.0)

    def passage(self, region: Box) -> tuple[float, int, int] | None:
        """Median area of its box [px^2], number of its frames, and of those on which it jumps.

        Kept until it has another frame. None if it does not travel through the region.
        """
        if region not in self._passages:
            self._passages[region] = None
            if any(not box.intersection(region).empty for box in self.boxes) and self.travels:
                area = float(np.median([box.area for box in self.boxes]))
                self._passages[region] = area, len(self.frames), self.jump_count
        return self._passages[region]

    @property
    def travels(self) -> bool:
        """Whether it goes anywhere; what stirs in place belongs to the background."""
        boxes = np.array([(one.x0, one.y0, one.x1, one.y1) for one in self.boxes], float)
        centres = 0.5 * (boxes[:, :2] + boxes[:, 2:])
        sizes = np.median(boxes[:, 2:] - boxes[:, :2], axis=0)
        return bool((np.ptp(centres, axis=0) > _MIN_TRAVEL * sizes).any())

    @property
    def jump_count(self) -> int:
        """Frames on which it jumps off its path while it is isolated.

        What jumps is the foot, or the top where the frame's border cuts the foot. The foot alone
        may jump by the length of legs, for these are not always told from the ground.
        """
        tops, feet = np.array([(box.y0, box.y1) for box in self.boxes], float).T
        heights = feet - tops
        cut = _all_of_three(self.truncated)  # a foot that jumps to the border and back still counts
        tall = _all_of_three(heights >= _BODY_HEIGHT * np.quantile(heights, _FULL_HEIGHT_QUANTILE))
        of_top, of_foot = np.abs(np.diff(tops, 2)), np.abs(np.diff(feet, 2))
        bends = np.where(cut, of_top, np.where(tall, np.minimum(of_top, of_foot), of_foot))
        return int((_all_of_three(self.isolated) & (bends > _MIN_JUMP * np.median(heights))).sum())

    def predict(self, index: int) -> Box:
        """Its box on a frame after the last or before the first one, centred on the torso."""
        if index not in self._predictions:
            self._predictions[index] = self._extrapolate(index)
        return self._predictions[index]

    def _extrapolate(self, index: int) -> Box:
        later, count = bisect_right(self.frames, index), len(self.frames)
        near = range(later, count)[:_MOTION_WINDOW] or range(count)[-_MOTION_WINDOW:]
        column = _predict_value(
            [self.frames[i] for i in near], [self.torso_columns[i] for i in near], index
        )
        alone = self._first_isolated(range(later, count))
        alone = alone or self._first_isolated(reversed(range(later)))[::-1]
        boxes = [self.boxes[i] for i in alone]
        foot = _predict_value(
            [self.frames[i] for i in alone], [float(box.y1) for box in boxes], index
        )
        width = median([float(box.width) for box in boxes])
        height = median([float(box.height) for box in boxes])
        left, top = round(column + 0.5 - 0.5 * width), round(foot - height)
        return Box(left, top, left + max(1, round(width)), top + max(1, round(height)))

    def _first_isolated(self, numbers: Iterable[int]) -> list[int]:
        """The first isolated ones of some of its frames, at most `_MOTION_WINDOW`."""
        return list(islice((i for i in numbers if self.isolated[i]), _MOTION_WINDOW))


def smoothed_feet(track: Track) -> list[float]:
    """Disparities of its foot, interpolated where that is hidden, by their running median."""
    feet = np.array(track.foot_disparities)
    known = ~np.isnan(feet)
    frames = np.array(track.frames, float)
    values = np.interp(frames, frames[known], feet[known])
    return [
        float(np.median(values[max(0, i - _MEDIAN_RADIUS) : i + _MEDIAN_RADIUS + 1]))
        for i in range(len(values))
    ]


def depth_order(nearness: list[float]) -> list[float]:
    """Depth order on each frame, with hysteresis: 0 behind the object to 1 in front.

    Args:
        nearness: distance of the object by that of the target, > 1 for a nearer target [1].
    """
    in_front = float(np.median(nearness[: 2 * _MEDIAN_RADIUS])) > 1.0
    states = []
    for near in nearness:
        if near > 1.0 + _ORDER_MARGIN:
            in_front = True
        elif near < 1.0 - _ORDER_MARGIN:
            in_front = False
        states.append(float(in_front))
    return [
        float(np.mean(states[max(0, i - _FADE_FRAMES) : i + _FADE_FRAMES + 1]))
        for i in range(len(states))
    ]


def _all_of_three(flags: npt.ArrayLike) -> Bool:
    """Where a frame and both its neighbours are flagged (n - 2,)."""
    each = np.asarray(flags)
    return np.asarray(each[:-2] & each[1:-1] & each[2:])


def _predict_value(frames: list[int], values: list[float], index: int) -> float:
    """Robust linear extrapolation: median of the slopes, then of the nearest values."""
    if len(values) < 2:
        return values[-1]
    half = len(values) // 2
    pairs = zip(values[half:], values, frames[half:], frames, strict=False)
    slope = median([(now - then) / (to - since) for now, then, to, since in pairs])
    nearest = slice(-MOTION_FRAMES, None) if index > frames[-1] else slice(MOTION_FRAMES)
    near = zip(values[nearest], frames[nearest], strict=True)
    return median([value + slope * (index - other) for value, other in near])
