"""The background of a shot of a still camera: what its pixels show where nothing moves.

Pixels are compared by the square root of their light, in which noise is about as strong in shadows
as in lights. Pictures are brought to the exposure of the first one by the median ratio of their
light, which holds whatever moves in less than half of the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Box, Float32, Picture

SMALL_WIDTH = 384
"""Pictures are searched for things that move at this width at most [px]."""
MOVED = 14.0 / 255.0
"""Least change of a root of light that something makes that moves [1]."""
MOST_KEPT, FEW_KEPT, LARGE_PX = 21, 11, 3_000_000
"""Pictures kept for a median, and of regions from so many pixels on [1, 1, px]."""
_DARKEST, _BRIGHTEST = 0.1, 0.97  # roots of light that tell a gain [1]
_CODES = 16383.0  # of a root of light of 1; up to 4 fits into 16 bits
_LEAST_NOISE = 0.8 / 255.0
_EVERY = 7  # pixels, for a gain
_LEAST_PX = 12  # of the small picture, that must change
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
    now, then = (one.reshape(-1, 3)[::_EVERY] for one in (seen, background))
    known = ((then > _DARKEST) & (then < _BRIGHTEST) & (now < _BRIGHTEST)).all(axis=1)
    if np.count_nonzero(known) < 0.02 * known.size:
        return np.ones(3, np.float32)
    return np.asarray(np.median(now[known] / then[known], axis=0), np.float32)


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
        kept = np.stack(self._kept)
        middle = len(kept) // 2
        codes = np.partition(kept, middle, axis=0)[middle]
        off = np.abs(kept.astype(np.int32) - codes).max(axis=3).astype(np.uint16)
        noise = np.partition(off, middle, axis=0)[middle].astype(np.float32) / np.float32(_CODES)
        smooth = cv2.blur(noise, (5, 5))
        floor = max(_LEAST_NOISE, float(np.median(smooth)))
        noise = np.clip(smooth, np.float32(floor), np.float32(3.0 * floor))
        return codes.astype(np.float32) / np.float32(_CODES), noise

    def agreement(self, background: Float32, noise: Float32) -> Float32:
        """Share of the pictures (h, w) that show the background [1]."""
        limit = np.maximum(np.float32(MOVED), 4.0 * noise)
        same = np.zeros(background.shape[:2], np.float32)
        for codes in self._kept:
            off = np.abs(codes.astype(np.float32) / np.float32(_CODES) - background).max(axis=2)
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
    """

    size: tuple[int, int]
    _reservoir: Reservoir = field(default_factory=Reservoir)
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

    def result(self) -> SmallBackground | None:
        """The shot's background at a small size, None without a picture."""
        if self._low is None or self._high is None:
            return None
        roots, noise = self._reservoir.median()
        moved = np.maximum(self._high - roots, roots - self._low).max(axis=2)
        agreement = self._reservoir.agreement(roots, noise)
        return SmallBackground(
            size=self.size, roots=roots, noise=noise, moved=moved, agreement=agreement,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallBackground:
    """The background of a whole shot, at a small size.

    Attributes:
        size: columns and rows of the frame [px].
        roots: square root of its scene-linear light (h, w, 3).
        noise: standard deviation of a picture's (h, w) [1].
        moved: largest change over the shot (h, w) [1].
        agreement: share of the pictures that show the background (h, w) [1].
    """

    size: tuple[int, int]
    roots: Float32
    noise: Float32
    moved: Float32
    agreement: Float32

    def small(self, box: Box) -> Box:
        """A box of the frame on the small picture, inside it."""
        height, width = self.noise.shape
        x, y = width / self.size[0], height / self.size[1]
        return Box(
            math.floor(box.x0 * x), math.floor(box.y0 * y),
            math.ceil(box.x1 * x), math.ceil(box.y1 * y),
        ).intersection(Box(0, 0, width, height))  # fmt: skip

    def moves(self, box: Box) -> bool:
        """Whether anything crosses a box of the frame."""
        small = self.small(box)
        if small.empty:
            return False
        changed = self._changed()[small.slices_in(Box(0, 0, *self.noise.shape[::-1]))]
        return bool(changed.sum() >= _LEAST_PX)

    @property
    def steady(self) -> bool:
        """Whether the camera stands still, and most of the picture with it."""
        unsteady = float((self.noise > _UNSTEADY).mean())
        return unsteady < _MOST_UNSTEADY and float(self._changed().mean()) < _MOST_MOVING

    def certainty(self, box: Box) -> float:
        """Share of a box of the frame whose background most pictures show [1]."""
        small = self.small(box)
        if small.empty:
            return 0.0
        part = self.agreement[small.slices_in(Box(0, 0, *self.noise.shape[::-1]))]
        return float((part >= 0.5).mean())

    def _changed(self) -> npt.NDArray[np.bool_]:
        beyond = self.moved > max(MOVED, 8.0 * float(np.median(self.noise)))
        opened = cv2.morphologyEx(beyond.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2)))
        return opened > 0
