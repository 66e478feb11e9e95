"""Shutter angle and exposure interval of a frame."""

from __future__ import annotations

from dataclasses import dataclass

ASSUMED_ANGLE_DEG = 180.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Shutter:
    """A shutter that opens once a frame, centred on the frame's moment.

    Attributes:
        angle_deg: share of the frame's time that it is open, 360 for all of it [deg].
        frame_s: from one frame to the next, 0 where there is only one [s].
        source: description of where the angle comes from.
        given: whether the user gave it.
    """

    angle_deg: float = ASSUMED_ANGLE_DEG
    frame_s: float = 0.0
    source: str = "assumed"
    given: bool = False

    @property
    def open_s(self) -> float:
        """How long it is open [s]."""
        return self.angle_deg / 360.0 * self.frame_s

    def edges(self, time_s: float) -> tuple[float, float, float]:
        """When it opens, is half through, and closes round a frame's moment [s]."""
        return time_s - 0.5 * self.open_s, time_s, time_s + 0.5 * self.open_s

    def middles(self, time_s: float, count: int) -> tuple[float, ...]:
        """Middles of `count` equal parts of the time that it is open round a frame's moment [s]."""
        return tuple(time_s + self.open_s * ((i + 0.5) / count - 0.5) for i in range(count))
