"""R under a camera that zooms: a lens that was fitted once follows the focal length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nlens_video.core.lens_fit import LensFit

_SAME = 1e-9  # what rounding makes of a focal length that stays [1]


@dataclass(slots=True)
class CameraZoom:
    """A camera's focal length over time.

    Attributes:
        focal_px: at a time of the plate [s]: focal length [px].
        frame_s: frame interval, for fits of which only the frame's number is known [s].
        fitted_s: time of the frame of the fit, None where that is not known [s].
    """

    focal_px: Callable[[float], float]
    frame_s: float
    fitted_s: float | None = None

    def follow(self, fit: LensFit, time_s: float) -> LensFit:
        """The lens of a fit at another time [s]."""
        then = fit.frame * self.frame_s if self.fitted_s is None else self.fitted_s
        ratio = self.focal_px(time_s) / self.focal_px(then)
        return fit if abs(ratio - 1.0) < _SAME else fit.zoomed(ratio)
