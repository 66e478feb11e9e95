"""Background survey of a shot, on the assumption that its camera is static."""

from __future__ import annotations

import math

from nlens_video.effects.beginning import Beginning
from nlens_video.effects.foreground.background import BackgroundSurvey
from nlens_video.effects.foreground.reference_view import StaticView
from nlens_video.video.info import SourceFrame

SURVEY_INTERVAL_S = 0.2
"""Least time from one frame of the survey to the next [s]."""


class StaticCameraSurvey:
    """Background survey that is made while the frames of a shot are read, for a static camera.

    A beginning that is black, white or a fade is left out.

    Args:
        size: columns and rows of the frames [px].

    Attributes:
        reference: the reference view, which is the frame itself.
        survey: the background survey.
        times: times of all frames that were read [s].
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.reference = StaticView(size)
        self.survey = BackgroundSurvey(size)
        self.times: list[float] = []
        self._due = -math.inf
        self._beginning, self._began = Beginning(), False

    def see(self, frame: SourceFrame) -> None:
        """Read the next frame, and survey it if the interval since the last one has passed."""
        self.times.append(frame.time_s)
        self._began = self._began or self._beginning.ends(frame.picture)
        if self._began and frame.time_s >= self._due:
            self.survey.add(self.reference.downsampled(frame.picture))
            self._due = frame.time_s + SURVEY_INTERVAL_S
