"""The slope of a shot's lens, lent by the frames that tell it to those that do not.

A pull of the focus moves the intercept alone. Frames whose ground is out of focus all over, or
whose grain hides the blur, do not tell the slope, and so not the sign either; other frames of the
shot do, as the focus passes over the ground.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Literal

import numpy as np
from msgspec.structs import replace

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import Expected, LensPrior
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.values import FoundLens
from nlens_video.stages.r_regression import FitLens

_ALIKE = 0.03  # of the slope, between frames of a shot
_SIDES: tuple[Literal["near", "far"], ...] = ("near", "far")


class ShotSlope:
    """Keeps what the frames of a shot told of its lens."""

    def __init__(self) -> None:
        self._weighted = self._weight = 0.0
        self._told: LensFit | None = None  # the last that told its slope
        self._before: LensFit | None = None  # the last of all

    def lend(self, found: FoundLens) -> LensFit:
        """The lens of a frame, fitted again with the slope of the shot where it tells none itself.

        Of both signs the lens nearer to the one before is taken. Frames come in their order.

        Args:
            found: what the frame alone tells.

        Returns:
            Its own fit where that tells the slope, or where no frame before does.
        """
        fit, told, before = found.fit, self._told, self._before
        if fit.sign == "resolved" and fit.depends_on_depth:
            weight = max(fit.slope_stderr, 1e-9) ** -2
            self._weighted += weight * fit.slope
            self._weight += weight
            self._told = self._before = fit
            return fit
        if told is None or before is None or found.regression is None or fit.sign == "assumed":
            return fit
        slope = self._weighted / self._weight
        samples, size = found.regression.samples, (fit.width, fit.height)
        prior = LensPrior(slope=Expected(slope, _ALIKE * slope), source="the slope of the shot")
        fits = []
        for side in _SIDES:
            with suppress(LensFitError):
                where, known = fit.method, replace(prior, prefer=side)
                fits.append(FitLens().of_samples(samples, size, where, fit.frame, known).fit)
        if not fits:
            return fit
        lent = fits[int(np.argmin([abs(one.intercept - before.intercept) for one in fits]))]
        self._before = _with_errors_of(told, lent, fit)
        return self._before


def _with_errors_of(told: LensFit, lent: LensFit, own: LensFit) -> LensFit:
    """A lens with the errors of the slope that it was lent, and those of its readings beside them.

    Args:
        told: the frame whose slope it has.
        lent: the lens.
        own: what the frame told by itself.
    """
    error = math.hypot(told.intercept_stderr, lent.intercept_stderr)
    return replace(
        lent,
        slope_stderr=told.slope_stderr,
        intercept_stderr=error,
        correlation=told.correlation * told.intercept_stderr / max(error, 1e-9),
        readings_share=told.readings_share,
        sign="resolved" if lent.sign == "resolved" else "assumed",
        object_disparity=own.object_disparity,
    )
