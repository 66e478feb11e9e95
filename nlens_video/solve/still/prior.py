"""What is known of a camera before its picture's lines are looked at."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.solve.still.ground_blur import GroundBlur
from nlens_video.solve.still.picture_cue import PictureCue

FOCAL_PRIOR = math.log(45.0 / 36.0), 0.4
"""Logarithm of the focal length by the frame's width, and its spread, where nothing is known."""
_FLAT = 1.6  # of that spread: lenses of 24 to 85 mm are about as likely as each other
_HIGHEST, _HIGHEST_SOFT = -3.0, 1.5  # pitch: a camera that shows the ground looks down [deg]
_LOWEST, _LOWEST_SOFT = -50.0, 4.0  # [deg]
_LEVEL, _LEVEL_SPREAD, _TILTED_SPREAD = 0.95, 1.2, 7.0  # share of level cameras; roll [deg]
_INFORMATION = math.radians(16.0) ** -2, math.radians(2.5) ** -2


class CameraPrior(Struct, frozen=True):
    """Prior of pitch, roll and focal length.

    Attributes:
        focal: logarithm of the focal length by the frame's width, and its spread.
        blur: what the plate's blur tells, None without it.
        picture: what the picture looks like it was taken by, None without it.
    """

    focal: tuple[float, float] = FOCAL_PRIOR
    blur: GroundBlur | None = None
    picture: PictureCue | None = None

    def log(self, cameras: Float64) -> Float64:
        """Logarithm of the density (…,), up to a constant.

        Args:
            cameras: pitch, roll [rad] and log focal length by the frame's width (…, 3).
        """
        pitch, roll = np.degrees(cameras[..., 0]), np.degrees(cameras[..., 1])
        off = (cameras[..., 2] - self.focal[0]) / self.focal[1]
        unknown = self.focal == FOCAL_PRIOR
        log = -0.5 * (off / _FLAT) ** 4 if unknown else -0.5 * off**2
        log = log - np.logaddexp(0.0, (pitch - _HIGHEST) / _HIGHEST_SOFT)
        log = log - np.logaddexp(0.0, (_LOWEST - pitch) / _LOWEST_SOFT)
        log = log + np.log(
            _LEVEL / _LEVEL_SPREAD * np.exp(-0.5 * (roll / _LEVEL_SPREAD) ** 2)
            + (1.0 - _LEVEL) / _TILTED_SPREAD * np.exp(-0.5 * (roll / _TILTED_SPREAD) ** 2)
        )
        for cue in (self.blur, self.picture):
            if cue is not None:
                log = log + cue.log(cameras)
        return np.asarray(log)

    @property
    def information(self) -> Float64:
        """Diagonal (3,) of the information that it holds at least."""
        return np.array([*_INFORMATION, self.focal[1] ** -2])
