"""One thing over the frames of a shot."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import islice
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.looks import Look, middle
from nlens_video.effects.foreground.meeting import Placed
from nlens_video.effects.foreground.things import Seen

_TRAVELS = 0.6  # of its own size, that a thing must go [1]
_JUMP = 0.08  # of its height, by which the foot of a thing that goes its way does not jump [1]
_BODY = 0.6  # of the height of somebody, that is seen without legs that look like the ground [1]
_TALL = 0.75  # quantile of its heights, of those with legs
KNOWN = 6
"""Frames by which the motion of a thing is known."""
LEAST_APART = 2
"""Frames that tell a thing's looks."""
_GAIT = 16  # frames whose places tell a motion: more than a stride
_MOST_HIDDEN = 25  # frames for which a thing is followed that none of it is seen of
_HIDDEN = 0.3  # share of a thing below which it counts as not seen [1]


@dataclass(slots=True)
class Track:
    """A thing over the frames of a shot.

    Attributes:
        frames: numbers of the frames.
        boxes: on the small picture; while it meets others, around the middle of its upper half.
        regions: boxes around the connected regions that it is in.
        middles: column of the middle of its upper half [px].
        feet: disparity of the ground where it stands [1 / scene unit]; not a number where another
            thing may hide that place.
        contacts: disparity of the object's contact with the ground [1 / scene unit].
        cut: on which of the frames its foot is below the frame.
        apart: on which it meets no other.
        pieces: on a frame, regions of parts of it that are apart from the rest.
        hidden: frames since so much of it was seen that tells where it is [1].
        traced: whether it was sought on the frames before the first one.
        look: its colours and its outline.
    """

    frames: list[int] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    regions: list[Box] = field(default_factory=list)
    middles: list[float] = field(default_factory=list)
    feet: list[float] = field(default_factory=list)
    contacts: list[float] = field(default_factory=list)
    cut: list[bool] = field(default_factory=list)
    apart: list[bool] = field(default_factory=list)
    pieces: dict[int, list[Box]] = field(default_factory=dict)
    hidden: int = 0
    traced: bool = False
    look: Look = field(default_factory=Look)
    _seen_apart: int = 0
    _expected: dict[int, Box] = field(default_factory=dict)

    def add(
        self, index: int, thing: Seen, foot: float, contact: float,
        picture: tuple[Float32, Bool] | None,
    ) -> None:  # fmt: skip
        """Take the thing on its next frame, on which it meets no other."""
        column = 0.5 * (thing.box.x0 + thing.box.x1 - 1)
        if picture is not None:
            column = middle(picture[1], thing.box)
            self.look.add(*picture, thing.box)
        self._add(index, thing.box, thing.region, column, foot, contact)
        self.cut.append(thing.cut)
        self.apart.append(True)
        self._seen_apart += 1
        self.hidden = 0

    def meet(self, index: int, thing: Seen, placed: Placed, foot: float, contact: float) -> None:
        """Take it on a frame on which it meets others in one region."""
        column = 0.5 * (placed.box.x0 + placed.box.x1 - 1)
        self._add(index, placed.box, thing.region, column, foot, contact)
        self.cut.append(thing.cut)
        self.apart.append(False)
        self.hidden = 0 if placed.seen > _HIDDEN else self.hidden + 1

    def met(self, index: int, thing: Seen, placed: Placed, foot: float, contact: float) -> None:
        """Take it on a frame before its first one, or on one on which it seemed to be apart.

        Args:
            index: of the frame.
            thing: the region that it makes with others.
            placed: where it is.
            foot: disparity of the ground where it stands [1 / scene unit].
            contact: that of the object's contact with the ground [1 / scene unit].
        """
        at = self.frames.index(index) if index in self.frames else 0
        if index in self.frames:
            self._seen_apart -= self.apart[at]
            for kept in self._columns:
                del kept[at]
        self._expected.clear()
        column = 0.5 * (placed.box.x0 + placed.box.x1 - 1)
        values = index, placed.box, thing.region, column, foot, contact, thing.cut, False
        for kept, value in zip(self._columns, values, strict=True):
            kept.insert(at, value)

    def is_in(self, index: int, thing: Seen) -> bool:
        """Whether it is in a region of a frame."""
        return index in self.frames and self.regions[self.frames.index(index)] == thing.region

    def is_apart(self, index: int) -> bool:
        """Whether it was seen apart on a frame."""
        return index in self.frames and self.apart[self.frames.index(index)]

    def moved_px(self, at: int) -> float:
        """How far it went sideways to its frame of a number, swinging limbs included [px].

        Of what meets others only the middle is known.
        """
        last = max(0, at - 1)
        if not (self.apart[at] and self.apart[last]):
            return abs(self.middles[at] - self.middles[last])
        now, then = self.boxes[at], self.boxes[last]
        return float(max(abs(now.x0 - then.x0), abs(now.x1 - then.x1)))

    @property
    def _columns(self) -> tuple[list[Any], ...]:
        return (
            self.frames, self.boxes, self.regions, self.middles, self.feet, self.contacts,
            self.cut, self.apart,
        )  # fmt: skip

    def _add(
        self, index: int, box: Box, region: Box, column: float, foot: float, contact: float
    ) -> None:
        self._expected.clear()
        self.frames.append(index)
        self.boxes.append(box)
        self.regions.append(region)
        self.middles.append(column)
        self.feet.append(foot)
        self.contacts.append(contact)

    @property
    def known(self) -> bool:
        """Whether it was seen apart often enough to be told from others that it meets."""
        return self._seen_apart >= LEAST_APART and self.hidden <= _MOST_HIDDEN

    @property
    def new(self) -> bool:
        """Whether its motion is not known yet."""
        return self._seen_apart < KNOWN

    @property
    def last_foot(self) -> float:
        """The last disparity of its foot that was seen [1 / scene unit]."""
        return next((foot for foot in reversed(self.feet) if not math.isnan(foot)), 0.0)

    @property
    def travels(self) -> bool:
        """Whether it goes anywhere; what stirs in its place belongs to the background."""
        boxes = np.array([(one.x0, one.y0, one.x1, one.y1) for one in self.boxes], float)
        middles = 0.5 * (boxes[:, :2] + boxes[:, 2:])
        sizes = np.median(boxes[:, 2:] - boxes[:, :2], axis=0)
        return bool((np.ptp(middles, axis=0) > _TRAVELS * sizes).any())

    @property
    def jumps(self) -> int:
        """Frames on which it jumps from the line on which it goes, while it meets no other.

        Its foot does, or its top while the frame's border cuts the foot. Where the top goes its way
        the foot may jump by the length of legs: they look like the ground now and then.
        """
        tops, feet = np.array([(box.y0, box.y1) for box in self.boxes], float).T
        heights = feet - tops
        cut = _thrice(self.cut)  # a foot that jumps to the border and back is no such
        tall = _thrice(heights >= _BODY * np.quantile(heights, _TALL))
        of_top, of_foot = np.abs(np.diff(tops, 2)), np.abs(np.diff(feet, 2))
        bends = np.where(cut, of_top, np.where(tall, np.minimum(of_top, of_foot), of_foot))
        return int((_thrice(self.apart) & (bends > _JUMP * np.median(heights))).sum())

    def expected(self, index: int) -> Box:
        """Where it is on a frame beside its own if it goes as it went, or before as it went later.

        The box is around its upper half's middle.
        """
        if index not in self._expected:
            self._expected[index] = self._expect(index)
        return self._expected[index]

    def _expect(self, index: int) -> Box:
        later, count = bisect_right(self.frames, index), len(self.frames)
        near = range(later, count)[:_GAIT] or range(count)[-_GAIT:]
        column = _ahead([self.frames[at] for at in near], [self.middles[at] for at in near], index)
        alone = self._apart_among(range(later, count))
        alone = alone or self._apart_among(reversed(range(later)))[::-1]
        boxes = [self.boxes[at] for at in alone]
        foot = _ahead([self.frames[at] for at in alone], [float(box.y1) for box in boxes], index)
        width = median([float(box.width) for box in boxes])
        height = median([float(box.height) for box in boxes])
        left, top = round(column + 0.5 - 0.5 * width), round(foot - height)
        return Box(left, top, left + max(1, round(width)), top + max(1, round(height)))

    def _apart_among(self, numbers: Iterable[int]) -> list[int]:
        """The first of some of its frames' numbers on which it meets no other, `_GAIT` at most."""
        return list(islice((at for at in numbers if self.apart[at]), _GAIT))


def _thrice(flags: npt.ArrayLike) -> Bool:
    """Where a frame and both beside it are flagged (n - 2,)."""
    each = np.asarray(flags)
    return np.asarray(each[:-2] & each[1:-1] & each[2:])


def _ahead(frames: list[int], values: list[float], index: int) -> float:
    """A value on a frame beside these, by the median of the slopes between them."""
    if len(values) < 2:
        return values[-1]
    half = len(values) // 2
    pairs = zip(values[half:], values, frames[half:], frames, strict=False)
    slope = median([(now - then) / (to - since) for now, then, to, since in pairs])
    nearest = slice(-KNOWN, None) if index > frames[-1] else slice(KNOWN)
    near = zip(values[nearest], frames[nearest], strict=True)
    return median([value + slope * (index - frame) for value, frame in near])
