"""The last few moments that were asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Kept = TypeVar("Kept")
_MOMENTS = 4  # the frame's own, and the shutter opening and closing


@dataclass(slots=True)
class Recent(Generic[Kept]):
    """What was computed for the last few moments, since several stages ask for them."""

    _kept: dict[float, Kept] = field(default_factory=dict)

    def at(self, time_s: float, compute: Callable[[float], Kept]) -> Kept:
        """The same object as before for a moment [s] that is known, else what `compute` gives."""
        known = self._kept.get(time_s)
        if known is None:
            known = compute(time_s)
            if len(self._kept) >= _MOMENTS:
                self._kept.pop(next(iter(self._kept)), None)
            self._kept[time_s] = known
        return known
