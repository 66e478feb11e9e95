"""The ground's blur as a cue: its signed CoC is affine in the picture.

Disparity on a plane is affine in pixel coordinates, and the CoC is affine in disparity. So on the
ground the CoC's level lines are parallel to the horizon, which tells the roll; and it grows from
the line in focus by so much per row until, on the horizon, it is the CoC at infinity. How large
that is, is not known, but lenses give it within limits: a weak measure of the horizon's height.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from scipy.optimize import least_squares

from nlens_video.core.layers import CocMap, Float64

_STEP = 8  # the map is smooth: every eighth row and column tells all [px of 960]
_LEAST_ERROR, _WORST_ERROR = 0.7e-3, 8e-3  # of the CoC, by the frame's width [1]
_FEWEST = 100
_INDEPENDENT = 40.0  # samples of a map that err on their own; by the roll of known cameras
_CUT = 3.0  # residuals beyond so many errors stop counting in the search
_SLOPES = -np.array([10.0, 20.0, 40.0, 70.0, 110.0, 160.0]) / 960.0
_FOCUSED = np.linspace(-0.3, 0.4, 15)
_LEAST_SLOPE = 10.0 / 960.0  # below it the network's own errors slope as much [1]
_WORST_ROLL = math.radians(3.0)
_ROLL_FLOOR = math.radians(0.7)
_INFINITY = math.log(0.02), 0.8  # CoC at infinity by the frame's width: middle, spread [log]
_FOCUS_ERROR = 0.01  # nearest that the horizon comes to the line in focus [frame's width]
_OUTLIER = 0.2  # share of plates whose map tells something else


class GroundBlur(Struct, frozen=True):
    """What the blur of the ground tells.

    Attributes:
        slope: loss of signed CoC per height in the picture, > 0, both by the frame's width [1].
        focus: height of the line in focus above the frame's middle [frame's width].
        roll: of the level lines [rad].
        roll_error: its standard error [rad].
    """

    slope: float
    focus: float
    roll: float
    roll_error: float

    def log(self, cameras: Float64) -> Float64:
        """Logarithm of its likelihood (…,), up to a constant.

        Args:
            cameras: pitch, roll [rad] and log focal length by the frame's width (…, 3).
        """
        pitch, roll, focal = cameras[..., 0], cameras[..., 1], np.exp(cameras[..., 2])
        above = np.maximum(-focal * np.tan(pitch) / np.cos(roll) - self.focus, _FOCUS_ERROR)
        infinity = (np.log(self.slope * above) - _INFINITY[0]) / _INFINITY[1]
        turned = (roll - self.roll) / self.roll_error
        return np.asarray(_robust(turned) + _robust(infinity))


def fit_ground_blur(coc: CocMap) -> GroundBlur | None:
    """The plane that most of a plate's CoC lies on, None where the map does not tell one.

    Args:
        coc: of the plate (H, W).
    """
    height, width = coc.coc_px.shape
    step = max(1, round(_STEP * width / 960))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    blur = coc.coc_px[rows, columns].astype(np.float64) / width
    error = np.maximum(coc.sigma_px[rows, columns].astype(np.float64) / width, _LEAST_ERROR)
    sure = error < _WORST_ERROR
    if sure.sum() < _FEWEST:
        return None
    x = (columns[sure] + 0.5) / width - 0.5
    y = (0.5 * height - rows[sure] - 0.5) / width
    blur, error = blur[sure], error[sure]

    def residuals(plane: Float64) -> Float64:
        return np.asarray((abs(plane[0] * x + plane[1] * y + plane[2]) - blur) / error)

    starts = [np.array([0.0, slope, -slope * row]) for slope in _SLOPES for row in _FOCUSED]
    costs = [float(np.minimum(residuals(start) ** 2, _CUT**2).sum()) for start in starts]
    fitted = least_squares(residuals, starts[int(np.argmin(costs))], loss="cauchy")
    across, slope, offset = fitted.x
    if -slope < _LEAST_SLOPE:
        return None
    jacobian = np.asarray(fitted.jac)
    information = jacobian.T @ jacobian * (_INDEPENDENT / len(x))
    roll_error = math.sqrt(float(np.linalg.inv(information)[0, 0])) / -slope
    if not roll_error < _WORST_ROLL:
        return None
    return GroundBlur(
        slope=-float(slope),
        focus=-float(offset / slope),
        roll=math.atan2(-across, -slope),
        roll_error=max(_ROLL_FLOOR, roll_error),
    )


def _robust(deviation: Float64) -> Float64:
    """Logarithm of a normal density that outliers share, at deviations by its spread."""
    return np.asarray(np.log((1.0 - _OUTLIER) * np.exp(-0.5 * deviation**2) + 0.05 * _OUTLIER))
