"""Pictures of a shot kept for their median, however long it is.

They are compared by the square root of their light; what a picture does not show is not a number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32

MOVED = 14.0 / 255.0
"""Least change of a root of light that something makes that moves [1]."""
MOST_KEPT, FEW_KEPT, LARGE_PX = 21, 11, 3_000_000
"""Pictures kept for a median, and of regions from so many pixels on [1, 1, px]."""
LEAST_PICTURES = 3
"""Pictures that tell a background."""
_CODES = 16383.0  # of a root of light of 1; up to 4 fits below the code of what is not shown
_UNKNOWN = np.uint16(65535)
_LEAST_NOISE = 0.8 / 255.0

Codes = npt.NDArray[np.uint16]


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


def largest(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
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
    _partial: bool = False

    @property
    def takes_next(self) -> bool:
        """Whether the next picture will be kept."""
        return self._count % self._step == 0

    @property
    def pictures(self) -> Sequence[Codes]:
        """Those that are kept: 16383 times their roots of light (h, w, 3), 65535 beyond them."""
        return self._kept

    def add(self, roots: Float32 | None) -> None:
        """Add a picture's roots of light (h, w, 3), NaN where it shows nothing.

        None stands for one that is not taken.
        """
        if self.takes_next and roots is not None:
            hidden = np.isnan(roots[..., 0])
            partial = bool(hidden.any())
            known = np.nan_to_num(roots) if partial else roots
            kept = (np.clip(known, 0.0, 4.0) * np.float32(_CODES)).astype(np.uint16)
            if partial:
                kept[hidden] = _UNKNOWN
                self._partial = True
            self._kept.append(kept)
        self._count += 1
        if len(self._kept) > self.most:
            del self._kept[1::2]
            self._step *= 2

    def median(self) -> tuple[Float32, Float32]:
        """Median (h, w, 3) of the pictures, and how far a picture lies off it (h, w) [1].

        The latter is the median deviation, smoothed; nowhere less than its middle, or more than
        three times that, where the background itself is in doubt. Where no picture shows anything,
        both are 0 and that middle.
        """
        seen = self.shown > 0
        codes = middle(self._filled(self._kept))
        codes[~seen] = 0
        off = self._filled([self._off(one, codes) for one in self._kept])
        noise = middle(off).astype(np.float32) / np.float32(_CODES)
        noise[~seen] = 0.0
        smooth = cv2.blur(noise, (5, 5))
        floor = max(_LEAST_NOISE, float(np.median(smooth[seen])) if seen.any() else 0.0)
        noise = np.clip(smooth, np.float32(floor), np.float32(3.0 * floor))
        return codes.astype(np.float32) / np.float32(_CODES), noise

    @property
    def shown(self) -> npt.NDArray[np.int32]:
        """How many of the pictures show each pixel (h, w) [1]."""
        shown = np.zeros(self._kept[0].shape[:2], np.int32)
        for one in self._kept:
            shown += one[..., 0] != _UNKNOWN
        return shown

    def off(self, background: Float32) -> Iterator[Float32]:
        """How far each of the pictures (h, w) lies off a background [1]; NaN beyond a picture."""
        for codes in self._kept:
            off = largest(np.abs(codes.astype(np.float32) / np.float32(_CODES) - background))
            if self._partial:
                off[codes[..., 0] == _UNKNOWN] = np.nan
            yield off

    def agreement(self, background: Float32, noise: Float32) -> Float32:
        """Share of the pictures (h, w) that show the background, of those that show a pixel [1].

        0 where fewer than `LEAST_PICTURES` show it.
        """
        limit = np.maximum(np.float32(MOVED), 4.0 * noise)
        same = np.zeros(background.shape[:2], np.float32)
        for off in self.off(background):
            same += off < limit
        shown = self.shown
        same /= np.maximum(shown, 1).astype(np.float32)
        return np.where(shown < LEAST_PICTURES, np.float32(0.0), same)

    def _off(self, one: Codes, codes: Codes) -> Codes:
        off = largest(np.maximum(one, codes) - np.minimum(one, codes))
        if self._partial:
            off[one[..., 0] == _UNKNOWN] = _UNKNOWN
        return np.asarray(off, np.uint16)

    def _filled(self, pictures: list[Codes]) -> list[Codes]:
        """Pictures whose unknown pixels are the least and the greatest number by turns.

        The median of all is then that of those that show something.
        """
        if not self._partial:
            return pictures
        low = np.ones(pictures[0].shape[:2], np.bool_)
        filled = []
        for one in pictures:
            unknown = (one if one.ndim == 2 else one[..., 0]) == _UNKNOWN
            made = one.copy()
            made[unknown & low] = 0
            low ^= unknown
            filled.append(made)
        return filled
