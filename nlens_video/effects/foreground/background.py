"""The background of a shot: what its pixels show where nothing moves.

Pixels are compared by the square root of their light, in which noise is about as strong in shadows
as in lights. Pictures are brought to the exposure of the first one by the median ratio of their
light, which holds whatever moves in less than half of the picture. Pictures may lie on a canvas
larger than they are: what one of them does not show is not a number there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.reservoir import LEAST_PICTURES, MOVED, Reservoir, largest
from nlens_video.effects.foreground.things import LEAST_AREA

SMALL_WIDTH = 384
"""Pictures are searched for things that move at this width at most [px]."""
_DARKEST, _BRIGHTEST = 0.1, 0.97  # roots of light that tell a gain [1]
_EVERY = 29  # pixels, for a gain
_LEAST_WIDTH = 5  # pixels of the small picture, of what crosses a place; swaying edges are narrower
_IN_PLACE = 0.625  # of all that a thing ever covers, which it covers at once if it goes nowhere [1]
_LEAST_PATH = 1.6  # of the area of the least thing, that it covers in all if it goes anywhere
_OFTEN = 3  # pictures on which what goes nowhere covers half as much
_UNSTEADY = 8.0 / 255.0  # usual change of a root of light where the camera moves
_MOST_UNSTEADY, _MOST_MOVING = 0.25, 0.75  # of the frame


def small_size(width: int, height: int) -> tuple[int, int]:
    """Columns and rows at which a frame is searched [px]."""
    scale = min(1.0, SMALL_WIDTH / width)
    return max(1, round(width * scale)), max(1, round(height * scale))


def root(light: Float32) -> Float32:
    """Square root of light, 0 for negative light."""
    made = np.maximum(light, np.float32(0.0))
    return np.asarray(np.sqrt(made, out=made), np.float32)


def gain(seen: Float32, background: Float32) -> Float32:
    """Ratio of the roots of light (3,) of a picture (h, w, 3) to those of the background."""
    now, then = (np.ascontiguousarray(one.reshape(-1, 3)[::_EVERY].T) for one in (seen, background))
    each = (then > _DARKEST) & (then < _BRIGHTEST) & (now < _BRIGHTEST)
    known = each[0] & each[1] & each[2]
    if np.count_nonzero(known) < 0.02 * known.size:
        return np.ones(3, np.float32)
    return np.asarray(np.median(now[:, known] / then[:, known], axis=1), np.float32)


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
        size: columns and rows of the frame, or of the canvas that frames are laid into [px].
        pictures: that it was shown [1].
    """

    size: tuple[int, int]
    _reservoir: Reservoir = field(default_factory=Reservoir)
    pictures: int = 0
    _first: Float32 | None = None
    _low: Float32 | None = None
    _high: Float32 | None = None

    def add(self, roots: Float32) -> None:
        """Take the roots of light (h, w, 3) of the shot's next picture, at the small size."""
        if self._first is None or self._low is None or self._high is None:
            self._first, self._low, self._high = roots.copy(), roots.copy(), roots.copy()
        else:
            roots = roots / gain(roots, self._first)
            np.fmin(self._low, roots, out=self._low)
            np.fmax(self._high, roots, out=self._high)
            new = np.isnan(self._first[..., 0])
            if new.any():
                self._first[new] = roots[new]
        self._reservoir.add(roots)
        self.pictures += 1

    def changes(self, box: Box) -> bool:
        """Whether anything as wide as what matters changes in a box of the frame."""
        if self._low is None or self._high is None:
            return False
        changed = _widely(largest(self._high - self._low) > MOVED)
        height, width = changed.shape
        small = _small(box, self.size, (width, height))
        return bool(changed[small.slices_in(Box(0, 0, width, height))].any())

    def result(self) -> SmallBackground | None:
        """The shot's background at a small size, None with few pictures."""
        if self._low is None or self._high is None or self.pictures < LEAST_PICTURES:
            return None
        roots, noise = self._reservoir.median()
        moved = largest(np.maximum(self._high - roots, roots - self._low))
        seen = self._reservoir.shown >= LEAST_PICTURES
        if not seen.any():
            return None
        limit = max(MOVED, 8.0 * float(np.median(noise[seen])))
        return SmallBackground(
            size=self.size, roots=roots, noise=noise, changed=moved > limit,
            travelled=self._travelled(roots, _widely(moved > limit), limit),
            agreement=self._reservoir.agreement(roots, noise), seen=seen,
        )  # fmt: skip

    def _travelled(self, roots: Float32, changed: Bool, limit: float) -> Bool:
        """Where (h, w) something changes that goes anywhere.

        What stirs, or a lamp that flickers, covers on one picture most of what it ever covers, and
        does so again and again; what is fast is at a place only once. What the least thing would
        cover as it goes by is more than the edge of a lamp that sways.
        """
        count, labels = cv2.connectedComponents(changed.astype(np.uint8))
        whole = np.bincount(labels.ravel(), minlength=count)
        shares = [
            np.bincount(labels[off > limit], minlength=count) / np.maximum(whole, 1)
            for off in self._reservoir.off(roots)
        ]
        often = (np.array(shares) > 0.5 * _IN_PLACE).sum(axis=0) >= _OFTEN
        stays = often & (np.max(shares, axis=0) > _IN_PLACE)
        stays |= whole < _LEAST_PATH * LEAST_AREA * labels.size
        stays[0] = True
        return np.asarray(~stays[labels])


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallBackground:
    """The background of a whole shot, at a small size.

    Attributes:
        size: columns and rows of the frame, or of the canvas that frames are laid into [px].
        roots: square root of its scene-linear light (h, w, 3).
        noise: standard deviation of a picture's (h, w) [1].
        changed: where anything changes over the shot (h, w).
        travelled: where something does that goes anywhere (h, w).
        agreement: share of the pictures that show the background (h, w) [1].
        seen: where enough pictures show anything (h, w).
    """

    size: tuple[int, int]
    roots: Float32
    noise: Float32
    changed: Bool
    travelled: Bool
    agreement: Float32
    seen: Bool

    def normalised(self, roots: Float32) -> Float32:
        """A picture (h, w, 3) in the background's exposure, which it is where one is unknown."""
        roots = np.asarray(roots / gain(roots, self.roots), np.float32)
        unknown = np.isnan(roots[..., 0]) | ~self.seen
        if unknown.any():
            roots[unknown] = self.roots[unknown]
        return roots

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
        unsteady = float((self.noise > _UNSTEADY)[self.seen].mean())
        moving = float(_opened(self.changed, 2)[self.seen].mean())
        return unsteady < _MOST_UNSTEADY and moving < _MOST_MOVING

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
