"""The vertical of a camera that turns on the spot: the axis that it pans about.

A head that pans and tilts keeps the picture's rows level, so the directions to the right of all
frames lie in the horizontal plane. How far they leave one plane tells how well a hand kept it.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.solve.still.prior import CameraPrior

_LEVEL = math.radians(1.2)  # of the axis of a head, by its spirit level
_TRACKED = math.radians(0.02)  # error of a tracked turn
_STRANGE = 1e-5  # likelihood that is left for turns about any axis
_FEWEST = 3  # frames


class TurnAxis(Struct, frozen=True, eq=False):
    """What the turns of a camera tell of the vertical in the axes of its first frame.

    Attributes:
        across: unit vectors that are level, the middle of the directions to the right first (2, 3).
        errors: standard errors of their elevations (2,) [rad].
    """

    across: Float64
    errors: Float64

    def log(self, cameras: Float64) -> Float64:
        """Logarithm of its likelihood (…,), up to a constant.

        Args:
            cameras: pitch, roll [rad] and log focal length by the frame's width (…, 3).
        """
        pitch, roll = cameras[..., 0], cameras[..., 1]
        up = np.stack(
            [np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch), -np.sin(pitch)], axis=-1
        )
        away = np.arcsin(np.clip(up @ self.across.T, -1.0, 1.0)) / self.errors
        return np.asarray(np.log(np.exp(-0.5 * (away**2).sum(axis=-1)) + _STRANGE))


class TurningPrior(CameraPrior, frozen=True):
    """Prior of a camera whose turns tell of its attitude.

    Attributes:
        axis: None where they tell nothing.
    """

    axis: TurnAxis | None = None

    def log(self, cameras: Float64) -> Float64:
        """Logarithm of the density (…,), up to a constant, as of `CameraPrior`."""
        log = CameraPrior.log(self, cameras)
        return log if self.axis is None else log + self.axis.log(cameras)


def turn_axis(rotations: Float64) -> TurnAxis | None:
    """The axis of a path of rotations, None for fewer than three frames.

    Args:
        rotations: camera axes to those of the first frame (F, 3, 3).
    """
    if len(rotations) < _FEWEST:
        return None
    _, spreads, axes = np.linalg.svd(rotations[:, :, 0], full_matrices=False)
    along, out = spreads[1:] / math.sqrt(len(rotations))
    out = math.hypot(out, _TRACKED)
    errors = np.array([math.hypot(_LEVEL, out), math.hypot(_LEVEL, out / max(along, 1e-9))])
    return TurnAxis(axes[:2], np.minimum(errors, 0.5 * math.pi))
