"""Playback of the object's animation: clip, loop, speed, offset. Imports nothing heavy."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nlens_video.core.errors import UsageError

ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Playback:
    """Mapping from the plate's time to the animation's.

    Camera animation is unaffected: it was matched to the plate and keeps the plate's time.

    Attributes:
        animation: name of the one that plays, else its number from 0, or `all`; of those that
            move the same thing, `all` plays the first.
        loop: whether it starts again after its last key; else it rests there.
        speed: seconds of the animation per second of the plate, > 0 [1].
        offset_s: moment of the animation on the first frame [s].
    """

    animation: str = ALL
    loop: bool = False
    speed: float = 1.0
    offset_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.speed < math.inf:
            raise UsageError(f"animation speed {self.speed:g}: must be a number above 0")
        if not math.isfinite(self.offset_s):
            raise UsageError(f"animation offset {self.offset_s}: must be a number of seconds")

    def moment(self, time_s: float, duration_s: float) -> float:
        """Moment of the animation at a moment of the plate.

        Args:
            time_s: seconds since the plate's first frame [s].
            duration_s: time of the animation's last key [s].
        """
        moment = self.offset_s + self.speed * time_s
        return moment % duration_s if self.loop and duration_s > 0.0 else moment


ONCE = Playback()
"""All animations, once, from the plate's first frame on."""
