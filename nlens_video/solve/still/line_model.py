"""How probable the directions of line segments are, for cameras that may have taken them.

A segment is clutter, or it lies along the vertical or along a horizontal direction. Clutter on a
foreshortened ground lies near the image's horizontal and standing clutter near the vertical, so
both are broad components beside a uniform one; without them a camera that looks straight ahead
would explain everything.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Bool, Float64
from nlens_video.solve.still.segments import Segments

FAMILIES = 4
"""Families that `LineModel.families` tells: three of clutter, and lines along the vertical."""
_FLAT_SPREAD, _UPRIGHT_SPREAD = math.radians(14.0), math.radians(7.0)
_DIRECTION_ERROR = math.radians(0.2)
_TEMPER = 0.6  # neighbouring segments are not independent
_ALIKE, _MOST_ALIKE = 0.1, 20.0  # sine between lines; so many of a direction tell all they can
_BESIDE = 0.03  # of the frame's width: parallel edges so near are of one thing, and lean with it
_LONG, _LONGEST = 0.08, 3.0  # of the frame's width counts as one segment; most a segment counts


class LineModel:
    """Densities of the segments of a picture.

    Attributes:
        weights: how much each segment counts (N,) [1].
    """

    def __init__(self, segments: Segments, size: tuple[int, int]) -> None:
        width, height = size
        flat = (segments.ends - (0.5 * width, 0.5 * height)) * (1.0, -1.0)
        lengths = segments.lengths
        self._middles = flat.mean(axis=1) / width
        self._along = (flat[:, 1] - flat[:, 0]) / lengths[:, None]
        self._variance = 2.0 * (segments.error_px / lengths) ** 2 + _DIRECTION_ERROR**2
        weights = np.minimum(_LONGEST, lengths / (_LONG * width))
        x, y = self._along.T
        parallel = abs(np.outer(x, y) - np.outer(y, x)) < _ALIKE
        weights = weights / np.sqrt(self._neighbours(parallel, lengths / width))
        alike = parallel @ weights
        self.weights = _TEMPER * weights * np.minimum(1.0, _MOST_ALIKE / np.maximum(alike, 1e-9))

    def _neighbours(self, parallel: Bool, lengths: Float64) -> Float64:
        """How many parallel segments lie beside each, itself among them (N,): one thing's edges."""
        offset = self._middles[:, None] - self._middles
        x, y = self._along.T
        at = abs(offset[..., 0] * x + offset[..., 1] * y)
        across = offset[..., 0] * y - offset[..., 1] * x
        gap = np.maximum(at - 0.5 * (lengths[:, None] + lengths), 0.0)
        near = np.exp(-0.5 * (across**2 + gap**2) / _BESIDE**2)
        return np.asarray((near * parallel).sum(axis=1))

    def families(self, cameras: Float64, spread: float) -> Float64:
        """Densities (…, FAMILIES, N) of uniform, level and upright clutter and of the vertical.

        Args:
            cameras: pitch, roll [rad] and log focal length by the frame's width (…, 3).
            spread: added to the directions' errors, to smooth a search [rad].
        """
        pitch, roll = cameras[..., 0], cameras[..., 1]
        across, _ = _level_axes(cameras)
        up = np.stack(
            [np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll), -np.sin(pitch)], axis=-1
        )
        upright = self._squared_sines(up, cameras)
        flat = across[..., 0, None] * self._along[:, 1] - across[..., 1, None] * self._along[:, 0]
        return np.stack(
            [
                np.full_like(upright, 1.0 / math.pi),
                _normal(flat**2, _FLAT_SPREAD**2),
                _normal(upright, _UPRIGHT_SPREAD**2),
                _normal(upright, self._variance + spread**2),
            ],
            axis=-2,
        )

    def horizontal(self, cameras: Float64, azimuths: Float64, spread: float) -> Float64:
        """Densities (…, N) of lines along horizontal directions.

        Args:
            cameras: as for `families`, (…, 3).
            azimuths: from the direction across the view (…,) [rad].
            spread: as for `families` [rad].
        """
        across, away = _level_axes(cameras)
        direction = across * np.cos(azimuths)[..., None] + away * np.sin(azimuths)[..., None]
        return _normal(self._squared_sines(direction, cameras), self._variance + spread**2)

    def _squared_sines(self, direction: Float64, cameras: Float64) -> Float64:
        """Squared sine between each segment and the line to a vanishing point (…, N)."""
        focal, depth = np.exp(cameras[..., 2]), direction[..., 2, None]
        x = (focal * direction[..., 0])[..., None] + depth * self._middles[:, 0]
        y = (focal * direction[..., 1])[..., None] + depth * self._middles[:, 1]
        cross = x * self._along[:, 1] - y * self._along[:, 0]
        return np.asarray(cross**2 / (x**2 + y**2 + 1e-12))


def _level_axes(cameras: Float64) -> tuple[Float64, Float64]:
    """Horizontal directions across the view and away from it, in camera axes (…, 3)."""
    pitch, roll = cameras[..., 0], cameras[..., 1]
    across = np.stack([np.cos(roll), -np.sin(roll), np.zeros_like(roll)], axis=-1)
    away = np.stack(
        [np.sin(pitch) * np.sin(roll), np.sin(pitch) * np.cos(roll), np.cos(pitch)], axis=-1
    )
    return across, away


def _normal(squares: Float64, variance: Float64 | float) -> Float64:
    return np.asarray(np.exp(-0.5 * squares / variance) / np.sqrt(2.0 * math.pi * variance))
