"""Confidence intervals over scenes: plates of one scene are no independent samples."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from nlens_video.evaluate.tables import NONE

LEVEL = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A mean over scenes and how far the truth may be from it.

    Attributes:
        mean: of the scenes' means, nan where there is none.
        half: half the width of the interval, nan for fewer than two scenes.
        scenes: how many.
    """

    mean: float
    half: float
    scenes: int

    def text(self, digits: int) -> str:
        """Mean and half width, such as `34.7 ± 2.1`; the mean alone where no width is known."""
        if not math.isfinite(self.mean):
            return NONE
        width = f" ± {self.half:.{digits}f}" if math.isfinite(self.half) else ""
        return f"{self.mean:.{digits}f}{width}"


def over_scenes(figures: Iterable[tuple[str, float]]) -> Interval:
    """Student's interval of the mean over scenes, each scene the mean of its plates.

    Args:
        figures: scene and figure of each plate; what is not finite is left out.
    """
    by_scene: dict[str, list[float]] = defaultdict(list)
    for scene, figure in figures:
        if math.isfinite(figure):
            by_scene[scene].append(figure)
    means = np.array([np.mean(values) for values in by_scene.values()], np.float64)
    count = len(means)
    if count < 2:
        return Interval(mean=float(means[0]) if count else math.nan, half=math.nan, scenes=count)
    reach = float(student.ppf(0.5 + 0.5 * LEVEL, count - 1))
    half = reach * float(means.std(ddof=1)) / math.sqrt(count)
    return Interval(mean=float(means.mean()), half=half, scenes=count)
