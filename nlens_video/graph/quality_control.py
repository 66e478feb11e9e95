"""Holding a frame budget: which level of quality the next frame gets."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

LEVELS = ("reference", "standard", "realtime", "draft")
"""The shipped presets that are levels, the best one first."""
_JUDGED = 8  # frames that decide on a step down
_SHARE = 0.75  # of them within the budget is enough
_COMFORT_S = 3.0  # time within the comfortable part of the budget before a step up
_COMFORT = 0.8  # of the budget: what the level above is expected to need at most
_PATIENCE = 2.0  # factor on that time for a level that was left again soon
_SOON_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A change of level.

    Attributes:
        frame: index of the frame whose time led to it.
        level: the one from then on.
        reason: why.
    """

    frame: int
    level: str
    reason: str


@dataclass(slots=True)
class BudgetControl:
    """Steps down when frames do not fit into the budget, and up when they would with room to spare.

    Time is that of the stream, counted in frames: the same times give the same steps.

    Args:
        budget_ms: what a frame may cost [ms].
        levels: names, the best one first; the run begins there.
        frame_s: from one frame to the next [s].
    """

    budget_ms: float
    levels: Sequence[str]
    frame_s: float
    steps: list[Step] = field(default_factory=list)
    at: int = 0
    _recent: deque[float] = field(default_factory=lambda: deque(maxlen=_JUDGED))
    _calm: deque[float] = field(default_factory=deque)
    _ratio: dict[int, float] = field(default_factory=dict)
    _left_ms: float | None = None
    _wait_s: dict[int, float] = field(default_factory=dict)
    _came_up: int | None = None

    @property
    def level(self) -> str:
        """The one that the next frame gets."""
        return self.levels[self.at]

    def observe(self, frame: int, level: str, total_ms: float) -> None:
        """Take a frame's time into account.

        Args:
            frame: its index.
            level: what it was made with; frames of a level that has been left tell nothing.
            total_ms: what it cost [ms].
        """
        if level != self.level:
            return
        self._recent.append(total_ms)
        self._calm.append(total_ms)
        while len(self._calm) > self._patience(self.at - 1):
            self._calm.popleft()
        self._compare()
        if self._over():
            self._down(frame)
        elif self._may_go_up():
            self._up(frame)

    def _compare(self) -> None:
        """Once a level has been seen, how much more the one above it costs."""
        if self._left_ms is not None and len(self._recent) == _JUDGED:
            self._ratio[self.at - 1] = max(1.0, self._left_ms / _middle(self._recent))
            self._left_ms = None

    def _over(self) -> bool:
        within = sum(time <= self.budget_ms for time in self._recent)
        return len(self._recent) == _JUDGED and within < _SHARE * _JUDGED

    def _may_go_up(self) -> bool:
        above = self.at - 1
        if above < 0 or len(self._calm) < self._patience(above):
            return False
        return _high(self._calm) * self._ratio.get(above, 1.0) <= _COMFORT * self.budget_ms

    def _patience(self, level: int) -> int:
        """Comfortable frames that a step up to a level asks for."""
        return max(_JUDGED, round(self._wait_s.get(level, _COMFORT_S) / self.frame_s))

    def _down(self, frame: int) -> None:
        if self.at + 1 >= len(self.levels):
            return
        if self._came_up is not None and (frame - self._came_up) * self.frame_s < _SOON_S:
            self._wait_s[self.at] = _PATIENCE * self._wait_s.get(self.at, _COMFORT_S)
        slow = _middle([time for time in self._recent if time > self.budget_ms])
        self._go(frame, self.at + 1, f"{slow:.0f} ms a frame, {self.budget_ms:g} allowed")
        self._left_ms = slow

    def _up(self, frame: int) -> None:
        self._came_up = frame
        self._go(frame, self.at - 1, f"{_high(self._calm):.0f} ms a frame for long")

    def _go(self, frame: int, level: int, reason: str) -> None:
        self.at = level
        self._recent.clear()
        self._calm.clear()
        self.steps.append(Step(frame=frame, level=self.level, reason=reason))


def _middle(times: Sequence[float] | deque[float]) -> float:
    return sorted(times)[len(times) // 2]


def _high(times: Sequence[float] | deque[float]) -> float:
    """The time that nine in ten do not exceed [ms]."""
    return sorted(times)[(9 * len(times)) // 10]
