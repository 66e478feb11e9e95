"""Levenberg's method under Cauchy's loss, for parameters that are no plain vectors."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from nlens_video.core.layers import Float64

_STEPS, _SETTLED = 30, 1e-4
_TRIES = 4  # at a stronger damping, where a step does not help
_Place = TypeVar("_Place")


def least_cauchy(
    residuals: Callable[[_Place], Float64],
    slopes: Callable[[_Place], Float64],
    moved: Callable[[_Place, Float64], _Place],
    start: _Place,
    loss: float,
) -> tuple[_Place, Float64]:
    """The place nearby where the residuals' loss is least, and its information (P, P).

    Args:
        residuals: of a place (N,).
        slopes: their derivatives by each of a step's P parameters (P, N).
        moved: a place after a step (P,).
        start: where to begin.
        loss: residual at which the loss bends [that of the residuals].
    """
    place, damping = start, 1e-3
    here = residuals(place)
    for _ in range(_STEPS):
        across = slopes(place)
        weights = 1.0 / (1.0 + (here / loss) ** 2)
        information = (across * weights) @ across.T
        information += 1e-9 * np.trace(information) / len(across) * np.eye(len(across))
        gradient = across @ (weights * here)
        before = np.log1p((here / loss) ** 2).sum()
        for _ in range(_TRIES):
            guard = damping * np.diag(np.diag(information))
            step = np.asarray(np.linalg.solve(information + guard, gradient), np.float64)
            tried = moved(place, -step)
            there = residuals(tried)
            gain = 1.0 - np.log1p((there / loss) ** 2).sum() / max(before, 1e-12)
            if gain > 0.0:
                break
            damping *= 10.0
        if gain <= 0.0:
            break
        place, here, damping = tried, there, 0.1 * damping
        if gain < _SETTLED:
            break
    return place, information
