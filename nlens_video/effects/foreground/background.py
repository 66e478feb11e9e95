"""The background of a shot of a still camera: what its pixels show where nothing moves.

Pixels are compared by the square root of their light, in which noise is about as strong in shadows
as in lights. Pictures are brought to the exposure of the first one by the median ratio of their
light, which holds whatever moves in less than half of the picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Box, Float32, Picture

SMALL_WIDTH = 384
"""Pictures are searched for things that move at this width at most [px]."""
MOVED = 14.0 / 255.0
"""Least change of a root of light that something makes that moves [1]."""
MOST_KEPT, FEW_KEPT, LARGE_PX = 21, 11, 3_000_000
"""Pictures kept for a median, and of regions from so many pixels on [1, 1, px]."""
_DARKEST, _BRIGHTEST = 0.1, 0.97  # roots of light that tell a gain [1]
_CODES = 16383.0  # of a root of light of 1; up to 4 fits into 16 bits
_LEAST_NOISE = 0.8 / 255.0
_LEAST_PICTURES = 3  # that tell a background
_EVERY = 29  # pixels, for a gain
_LEAST_WIDTH = 5  # pixels of the small picture, of what crosses a place; swaying edges are narrower
_IN_PLACE = 0.625  # of all that a thing ever covers, which it covers at once if it goes nowhere [1]
_OFTEN = 3  # pictures on which what goes nowhere covers half as much
_UNSTEADY = 8.0 / 255.0  # usual change of a root of light where the camera moves
_MOST_UNSTEADY, _MOST_MOVING = 0.25, 0.75  # of the frame

Codes = npt.NDArray[np.uint16]


def small_size(width: int, height: int) -> tuple[int, int]:
    """Columns and rows at which a frame is searched [px]."""
    scale = min(1.0, SMALL_WIDTH / width)
    return max(1, round(width * scale)), max(1, round(height * scale))


def root(light: Float32) -> Float32:
    """Square root of light, 0 for negative light."""
    return np.asarray(np.sqrt(np.maximum(light, np.float32(0.0))), np.float32)


def gain(seen: Float32, background: Float32) -> Float32:
    """Ratio of the roots of light (3,) of a picture (h, w, 3) to those of the background."""
    now, then = (np.ascontiguousarray(one.reshape(-1, 3)[::_EVERY].T) for one in (seen, background))
    each = (then > _DARKEST) & (then < _BRIGHTEST) & (now < _BRIGHTEST)
    known = each[0] & each[1] & each[2]
    if np.count_nonzero(known) < 0.02 * known.size:
        return np.ones(3, np.float32)
    return np.asarray(np.median(now[:, known] / then[:, known], axis=1), np.float32)


def middle(pictures: Sequence[Codes]) -> Codes:
    """Median of pictures, the upper one of an even number; `np.partition` along them is slow.

    The least and the greatest of two more than half of them are no median: both are dropped, and
    the next one is taken in.
    """
    waiting = [one.copy() for one in pictures]
    if len(waiting) % 2 == 0:
        waiting.append(np.full_like(waiting[0], np.iinfo(waiting[0].dtype).max))
    spare = np.empty_like(waiting[0])
    held = [waiting.pop() for _ in range(min(len(waiting), len(waiting) // 2 + 2))]
    while True:
        for at in range(1, len(held)):  # the least goes to the front
            np.minimum(held[0], held[at], out=spare)
            np.maximum(held[0], held[at], out=held[at])
            held[0], spare = spare, held[0]
        if not waiting and len(held) == 1:
            return held[0]
        for at in range(1, len(held) - 1):  # the greatest goes to the end
            np.maximum(held[-1], held[at], out=spare)
            np.minimum(held[-1], held[at], out=held[at])
            held[-1], spare = spare, held[-1]
        held = held[1:-1]
        if waiting:
            held.append(waiting.pop())


def _largest(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Largest of the three values of each pixel; `max` along so short an axis is slow."""
    first = np.maximum(values[..., 0], values[..., 1])
    return np.asarray(np.maximum(first, values[..., 2]))


@dataclass(slots=True)
class Reservoir:
    """At most `most` pictures, evenly spaced over those that were added, however many."""

    most: int = MOST_KEPT
    _step: int = 1
    _count: int = 0
    _kept: list[Codes] = field(default_factory=list)

    @property
    def takes_next(self) -> bool:
        """Whether the next picture will be kept."""
        return self._count % self._step == 0

    def add(self, roots: Float32 | None) -> None:
        """Add a picture's roots of light (h, w, 3); None for one that is not taken."""
        if self.takes_next and roots is not None:
            codes = np.clip(roots, 0.0, 4.0) * np.float32(_CODES)
            self._kept.append(codes.astype(np.uint16))
        self._count += 1
        if len(self._kept) > self.most:
            del self._kept[1::2]
            self._step *= 2

    def median(self) -> tuple[Float32, Float32]:
        """Median (h, w, 3) of the pictures, and how far a picture lies off it (h, w) [1].

        The latter is the median deviation, smoothed; nowhere less than its middle, or more than
        three times that, where the background itself is in doubt.
        """
        codes = middle(self._kept)
        off = [_largest(np.maximum(one, codes) - np.minimum(one, codes)) for one in self._kept]
        noise = middle(off).astype(np.float32) / np.float32(_CODES)
        smooth = cv2.blur(noise, (5, 5))
        floor = max(_LEAST_NOISE, float(np.median(smooth)))
        noise = np.clip(smooth, np.float32(floor), np.float32(3.0 * floor))
        return codes.astype(np.float32) / np.float32(_CODES), noise

    def off(self, background: Float32) -> Iterator[Float32]:
        """How far each of the pictures (h, w) lies off a background [1]."""
        for codes in self._kept:
            yield _largest(np.abs(codes.astype(np.float32) / np.float32(_CODES) - background))

    def agreement(self, background: Float32, noise: Float32) -> Float32:
        """Share of the pictures (h, w) that show the background [1]."""
        limit = np.maximum(np.float32(MOVED), 4.0 * noise)
        same = np.zeros(background.shape[:2], np.float32)
        for off in self.off(background):
            same += off < limit
        return same / np.float32(len(self._kept))


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """The background of a region of the frame, in the exposure of the first frame.

    Attributes:
        box: the region.
        roots: square root of its scene-linear light (h, w, 3).
        noise: standard deviation of a picture's (h, w) [1].
    """

    box: Box
    roots: Float32
    noise: Float32


@dataclass(slots=True)
class Survey:
    """A first look at a shot: where in the frame anything moves.

    Attributes:
        size: columns and rows of the frame [px].
        pictures: that it was shown [1].
    """

    size: tuple[int, int]
    _reservoir: Reservoir = field(default_factory=Reservoir)
    pictures: int = 0
    _first: Float32 | None = None
    _low: Float32 | None = None
    _high: Float32 | None = None

    def add(self, picture: Picture) -> None:
        """Take the shot's next picture."""
        roots = root(picture.downsample(*small_size(*self.size)))
        if self._first is None or self._low is None or self._high is None:
            self._first = roots
            self._low, self._high = roots.copy(), roots.copy()
        else:
            roots = roots / gain(roots, self._first)
            np.minimum(self._low, roots, out=self._low)
            np.maximum(self._high, roots, out=self._high)
        self._reservoir.add(roots)
        self.pictures += 1

    def changes(self, box: Box) -> bool:
        """Whether anything as wide as what matters changes in a box of the frame."""
        if self._low is None or self._high is None:
            return False
        changed = _widely(_largest(self._high - self._low) > MOVED)
        height, width = changed.shape
        small = _small(box, self.size, (width, height))
        return bool(changed[small.slices_in(Box(0, 0, width, height))].any())

    def result(self) -> SmallBackground | None:
        """The shot's background at a small size, None with few pictures."""
        if self._low is None or self._high is None or self.pictures < _LEAST_PICTURES:
            return None
        roots, noise = self._reservoir.median()
        moved = _largest(np.maximum(self._high - roots, roots - self._low))
        limit = max(MOVED, 8.0 * float(np.median(noise)))
        return SmallBackground(
            size=self.size, roots=roots, noise=noise, changed=moved > limit,
            travelled=self._travelled(roots, _widely(moved > limit), limit),
            agreement=self._reservoir.agreement(roots, noise),
        )  # fmt: skip

    def _travelled(self, roots: Float32, changed: Bool, limit: float) -> Bool:
        """Where (h, w) something changes that goes anywhere.

        What stirs, or a lamp that flickers, covers on one picture most of what it ever covers, and
        does so again and again; what is fast is at a place only once.
        """
        count, labels = cv2.connectedComponents(changed.astype(np.uint8))
        whole = np.bincount(labels.ravel(), minlength=count)
        shares = [
            np.bincount(labels[off > limit], minlength=count) / np.maximum(whole, 1)
            for off in self._reservoir.off(roots)
        ]
        often = (np.array(shares) > 0.5 * _IN_PLACE).sum(axis=0) >= _OFTEN
        stays = often & (np.max(shares, axis=0) > _IN_PLACE)
        stays[0] = True
        return np.asarray(~stays[labels])


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallBackground:
    """The background of a whole shot, at a small size.

    Attributes:
        size: columns and rows of the frame [px].
        roots: square root of its scene-linear light (h, w, 3).
        noise: standard deviation of a picture's (h, w) [1].
        changed: where anything changes over the shot (h, w).
        travelled: where something does that goes anywhere (h, w).
        agreement: share of the pictures that show the background (h, w) [1].
    """

    size: tuple[int, int]
    roots: Float32
    noise: Float32
    changed: Bool
    travelled: Bool
    agreement: Float32

    def small(self, box: Box) -> Box:
        """A box of the frame on the small picture, inside it."""
        height, width = self.noise.shape
        return _small(box, self.size, (width, height))

    def moves(self, box: Box) -> bool:
        """Whether anything crosses a box of the frame."""
        small = self.small(box)
        if small.empty:
            return False
        return bool(self.travelled[small.slices_in(Box(0, 0, *self.noise.shape[::-1]))].any())

    @property
    def steady(self) -> bool:
        """Whether the camera stands still, and most of the picture with it."""
        unsteady = float((self.noise > _UNSTEADY).mean())
        return unsteady < _MOST_UNSTEADY and float(_opened(self.changed, 2).mean()) < _MOST_MOVING

    def certainty(self, box: Box) -> float:
        """Share of a box of the frame whose background most pictures show [1]."""
        small = self.small(box)
        if small.empty:
            return 0.0
        part = self.agreement[small.slices_in(Box(0, 0, *self.noise.shape[::-1]))]
        return float((part >= 0.5).mean())


def _small(box: Box, size: tuple[int, int], small: tuple[int, int]) -> Box:
    """A box of a frame of a size on a small picture of it, inside that."""
    x, y = small[0] / size[0], small[1] / size[1]
    return Box(
        math.floor(box.x0 * x), math.floor(box.y0 * y),
        math.ceil(box.x1 * x), math.ceil(box.y1 * y),
    ).intersection(Box(0, 0, *small))  # fmt: skip


def _widely(changed: Bool) -> Bool:
    return _opened(changed, _LEAST_WIDTH)


def _opened(mask: Bool, side: int) -> Bool:
    element = np.ones((side, side), np.uint8)
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, element) > 0
