"""How often a check looks at the plate: less and less often while nothing changes."""

from __future__ import annotations


class Pace:
    """Tells which frames are looked at.

    Args:
        frame_s: from one frame to the next, 0 for a still [s].
        soon_s: from one look to the next where the plate has changed between the last two [s].
        late_s: at most, where it rests: the wait doubles with each look [s].

    Attributes:
        soon: frames from one look to the next at least, 0 for a still [1].
    """

    def __init__(self, frame_s: float, soon_s: float, late_s: float) -> None:
        self.soon, self._late = (
            (max(1, round(wait / frame_s)) if frame_s > 0.0 else 0) for wait in (soon_s, late_s)
        )
        self._wait, self._next = self.soon, 0

    def due(self, index: int) -> bool:
        """Whether a frame is looked at, by its number."""
        return index >= self._next

    def looked(self, index: int, *, rests: bool) -> None:
        """A frame was looked at; whether the plate shows there what it showed at the last look."""
        self._wait = min(2 * self._wait, self._late) if rests else self.soon
        self._next = index + self._wait
