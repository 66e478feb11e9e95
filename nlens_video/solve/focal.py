"""The focal length of a path that does not tell it: from what stands on the ground that it shows.

A camera that moves without a turn sees the same pictures whatever its focal length; the scene only
stretches along the optical axis. The ground stretches with it, so each focal length has a vertical
of its own. Planes among the points are upright by one of them, and lines along the vertical and
the horizontal fit one of them best.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from scipy.interpolate import CubicSpline

from nlens_video.core.layers import Float64
from nlens_video.solve.paths.standing_planes import StandingPlanes
from nlens_video.solve.still.segments import Segments, pooled
from nlens_video.solve.still.vanishing import Mixture

_FOCALS = np.linspace(math.log(0.4), math.log(2.6), 16)
_NEAR = np.linspace(-0.25, 0.25, 13)
_FINE_STEP = 1e-3  # between focal lengths whose probabilities are summed [1]
_ROUGH = math.radians(1.5), math.radians(4.0)  # smoothing, and steps of azimuths
_FINE = math.radians(0.5), math.radians(1.5)
_AHEAD = 0.3  # cosine by which a turned segment lies before the camera
MOST_POOLED = 400
"""Segments of several pictures that are taken together."""
_TEMPER = 0.5  # of the lines of all pictures together: they are of one scene


class KnownFov(Struct, frozen=True):
    """A field of view that need not be measured.

    Attributes:
        focal: focal length by the frame's width [1].
        error: its relative standard error [1].
        given: by the user, else by the file's metadata.
    """

    focal: float
    error: float
    given: bool


def focal_of_scene(
    pictures: list[Segments],
    size: tuple[int, int],
    normal: Float64,
    focal: float,
    prior: tuple[float, float],
    standing: StandingPlanes,
) -> tuple[float, float]:
    """Logarithm of the focal length by the frame's width, and its standard error [1].

    Args:
        pictures: segments of one or several pictures, in the axes of the first.
        size: columns and rows [px].
        normal: of the ground in camera axes, as a focal length shows it (3,).
        focal: that focal length by the frame's width [1].
        prior: logarithm of the focal length and its standard error.
        standing: planes among the points of the path.
    """

    def known(logs: Float64) -> Float64:
        return np.asarray(standing.log(logs) - 0.5 * ((logs - prior[0]) / prior[1]) ** 2)

    whole = Mixture(pooled(pictures, MOST_POOLED), size)
    lines = whole.log_evidence(_cameras(normal, focal, _FOCALS), *_ROUGH)
    fine = _finely(_FOCALS)
    near = fine[int(np.argmax(CubicSpline(_FOCALS, lines)(fine) + known(fine)))] + _NEAR
    cameras = _cameras(normal, focal, near)
    lines = np.zeros(len(near))
    for one in pictures:
        lines += Mixture(one, size).log_evidence(cameras, *_FINE) * (_TEMPER / len(pictures))
    fine = _finely(near)
    values = CubicSpline(near, lines)(fine) + known(fine)
    weights = np.exp(values - values.max())
    middle = float(np.average(fine, weights=weights))
    return middle, math.sqrt(float(np.average((fine - middle) ** 2, weights=weights)))


def turned_segments(
    segments: Segments, turn: Float64, focal: float, size: tuple[int, int]
) -> Segments:
    """Segments as a camera sees them that is turned on the spot; vanishing points turn with it.

    Args:
        segments: of a picture.
        turn: from its axes to those of the other camera (3, 3).
        focal: focal length by the frame's width [1].
        size: columns and rows [px].
    """
    middle, focal_px = np.array(size) / 2.0, focal * size[0]
    flat = (segments.ends - middle) * (1.0, -1.0)
    rays = np.concatenate([flat, np.full((*flat.shape[:2], 1), -focal_px)], axis=2) @ turn.T
    depth = -rays[..., 2:] / focal_px
    ahead = (depth > _AHEAD).all(axis=(1, 2))
    ends = middle + rays[ahead, :, :2] / depth[ahead] * (1.0, -1.0)
    return Segments(ends, segments.error_px[ahead] / depth[ahead].mean(axis=(1, 2)))


def product(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Mean and deviation of the product of two normal densities."""
    weights = 1.0 / one[1] ** 2, 1.0 / other[1] ** 2
    mean = (one[0] * weights[0] + other[0] * weights[1]) / sum(weights)
    return mean, 1.0 / math.sqrt(sum(weights))


def _cameras(normal: Float64, focal: float, logs: Float64) -> Float64:
    """Pitch, roll and log focal length (F, 3) of a scene stretched for other focal lengths."""
    x, y, z = normal[0], normal[1], normal[2] * focal / np.exp(logs)
    pitch = np.arctan2(-z, math.hypot(x, y))
    return np.column_stack([pitch, np.full(len(logs), math.atan2(x, y)), logs])


def _finely(logs: Float64) -> Float64:
    """Logarithms of focal lengths between the first and the last of some."""
    return np.linspace(logs[0], logs[-1], 1 + round(float(logs[-1] - logs[0]) / _FINE_STEP))
