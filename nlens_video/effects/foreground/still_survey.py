"""A first look at a shot, as a camera that stands still sees it."""

from __future__ import annotations

import math

from nlens_video.effects.foreground.background import Survey
from nlens_video.effects.foreground.canvas import StillCanvas
from nlens_video.video.info import SourceFrame

EVERY_S = 0.2
"""From one frame that is looked at beforehand to the next [s]."""


class StillSurvey:
    """A first look at a shot as a camera that stands still sees it.

    Args:
        size: columns and rows of its frames [px].

    Attributes:
        canvas: where the frames lie.
        survey: where in the frame anything moves.
        times: of the frames read [s].
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.canvas = StillCanvas(size)
        self.survey = Survey(size)
        self.times: list[float] = []
        self._due = -math.inf

    def see(self, frame: SourceFrame) -> None:
        """Read the next frame, and look at it if the last that was looked at is long enough ago."""
        self.times.append(frame.time_s)
        if frame.time_s >= self._due:
            self.survey.add(self.canvas.shrunk(frame.picture))
            self._due = frame.time_s + EVERY_S
