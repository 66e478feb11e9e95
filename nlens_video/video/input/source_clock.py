"""Presentation times of a source, with missing and implausible time stamps repaired."""

from __future__ import annotations

from fractions import Fraction

from nlens_video.video.info import SourceInfo

_BACK_S = 1
"""Time stamps that step back by more start anew, as those of joined recordings do [s]."""
_AHEAD_S = 10
"""How far beyond the length that a file states its time stamps are still believed [s]."""
_LONGEST_PAUSE_S = 24 * 3600
"""Between two frames of a source that states no length [s]."""


class SourceClock:
    """Gives every frame a pts: its own, or where that is missing or makes no sense, the next one.

    Args:
        info: the source.

    Attributes:
        time_base: seconds per tick [s].
        repaired: frames whose own time was not kept [1].
    """

    def __init__(self, info: SourceInfo) -> None:
        self.time_base = info.time_base
        self.repaired = 0
        self._step = max(1, round(1 / (info.average_rate or 25) / info.time_base))
        self._length_s = info.duration_s
        self._shift = 0
        self._first: int | None = None
        self._last = 0

    def tick(self, pts: int | None) -> int:
        """The frame's pts [ticks], later than the one before."""
        if self._first is None:
            self.repaired += pts is None
            self._first = self._last = pts or 0
            return self._last
        self._last = self._after(pts)
        return self._last

    def _after(self, pts: int | None) -> int:
        following = self._last + self._step
        if pts is None:
            self.repaired += 1
            return following
        if self._is_leap(pts + self._shift):
            # one wrong time stamp, or all from here on: where the own ones fit they come back
            self._shift = 0 if not self._is_leap(pts) else following - pts
            self.repaired += 1
        elif pts + self._shift <= self._last:
            self.repaired += 1
        return max(pts + self._shift, self._last + 1)

    def _is_leap(self, pts: int) -> bool:
        """Whether a time stamp is too far from the last frame's to be meant."""
        distance_s = (pts - self._last) * self.time_base
        if self._length_s is None:
            return not -_BACK_S < distance_s < _LONGEST_PAUSE_S
        beyond_s = (pts - (self._first or 0)) * self.time_base - Fraction(self._length_s)
        return distance_s <= -_BACK_S or (distance_s > _AHEAD_S and beyond_s > _AHEAD_S)

    def missing_before(self, pts: int) -> int:
        """How many frames of the usual distance would fit before it [1]; ask before `tick`."""
        if self._first is None or self._is_leap(pts + self._shift):
            return 0
        return max(0, round((pts + self._shift - self._last) / self._step) - 1)

    def seconds(self, pts: int) -> float:
        """Since the first frame [s]."""
        return float((pts - (self._first or 0)) * self.time_base)
