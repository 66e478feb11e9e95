"""Planes that stand on the ground of a path, and the focal length by which they are upright.

The inverse depth of a plane is affine in the picture, a x + b y + c, whatever the focal length f:
another one stretches all depths alike. The plane's normal is (a f, b f, -c) in camera axes, so that
planes at right angles have (a a' + b b') f² + c c' = 0. Walls, boards and boxes stand at right
angles to the ground, which tells f where the path alone does not: along a straight line, without a
turn.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Float64
from nlens_video.solve.paths.bundle import Bundle
from nlens_video.solve.points.observations import Ints

_TRACK_PX = 0.2  # error of a track that its frames share; from planes of known clips
_LEAST_LEVER_PX = 3.0  # that a point moves for a change of its depth by e: less tells no depth
_OFF_GROUND, _OFF_PLANE = 4.0, 2.5  # by the error of an inverse depth [1]
_NEIGHBOURS, _TRIES = 12, 6  # of a point, among which its plane is looked for
_LEAST_AREA = 1e-5  # that three points span, by the frame's width squared [1]
_WIDE = 0.25  # from a point to others of its plane [frame's width]
_FEWEST, _MOST_PLANES = 10, 16
_MOST = 600  # points that are looked at, evenly
_ROUNDS = 3
_LEAST_INFORMATION = 1e-12  # of the whole: points of one line leave their plane's turn open [1]
_UPRIGHT = (0.5, math.radians(0.5)), (0.3, math.radians(5.0))  # share of planes, and how they lean
_ANY = 0.2  # share of the planes that stand anyhow


class StandingPlanes(Struct, frozen=True, eq=False):
    """Planes among the points of a path, in the axes of its first keyframe.

    Attributes:
        ground: a, b and c of the ground's inverse depth by place in the picture, from its middle
            to the right and up, by the frame's width (3,).
        planes: the same of other planes (K, 3).
        covariances: of these (K, 3, 3).
    """

    ground: Float64
    planes: Float64
    covariances: Float64

    def log(self, logs: Float64) -> Float64:
        """Logarithm of the likelihood of focal lengths (…,), up to a constant.

        Args:
            logs: logarithms of focal lengths by the frame's width (…,).
        """
        total = np.zeros(np.shape(logs))
        stretch = np.stack([np.exp(logs), np.exp(logs), -np.ones_like(logs)], axis=-1)
        up = self.ground * stretch
        up /= np.linalg.norm(up, axis=-1, keepdims=True)
        for plane, covariance in zip(self.planes, self.covariances, strict=True):
            normal = plane * stretch
            length = np.linalg.norm(normal, axis=-1, keepdims=True)
            rise = (normal * up).sum(axis=-1)  # sine of the normal's elevation
            slope = (up - rise[..., None] * normal / length) * stretch / length
            rise = rise / length[..., 0]
            variance = np.einsum("...i,ij,...j->...", slope, covariance, slope)
            density = np.full_like(rise, 0.5 * _ANY)
            for share, lean in _UPRIGHT:
                square = variance + lean**2
                density += share * np.exp(-0.5 * rise**2 / square) / np.sqrt(2 * math.pi * square)
            total += np.log(density)
        return np.asarray(total)


def standing_planes(bundle: Bundle, ground: tuple[Float64, float]) -> StandingPlanes:
    """Planes of a path's points that are not on its ground; there may be none.

    Args:
        bundle: a path with one focal length.
        ground: its normal (3,) and offset: points x of the ground have normal · x = offset.
    """
    focal = float(np.median(bundle.focals_px)) / bundle.size[0]
    first = bundle.poses[bundle.solved[0]]
    normal = first[:3, :3].T @ ground[0]
    offset = ground[1] - float(ground[0] @ first[:3, 3])
    level = normal * (1.0 / focal, 1.0 / focal, -1.0) / offset
    local = (bundle.points - first[:3, 3]) @ first[:3, :3]
    lever = _levers_px(bundle)
    kept = np.flatnonzero((lever > _LEAST_LEVER_PX) & (local[:, 2] < 0.0))
    inverse = -1.0 / local[kept, 2]
    places = np.column_stack([focal * local[kept, :2] * inverse[:, None], np.ones(len(kept))])
    error = _TRACK_PX / lever[kept] * inverse
    off = np.flatnonzero(abs(places @ level - inverse) > _OFF_GROUND * error)
    off = off[:: 1 + len(off) // _MOST]
    found = _planes(places[off], inverse[off], error[off])
    return StandingPlanes(
        level,
        np.array([plane for plane, _ in found]).reshape(-1, 3),
        np.array([covariance for _, covariance in found]).reshape(-1, 3, 3),
    )


def _levers_px(bundle: Bundle) -> Float64:
    """How far each point moves at most, in any picture, for a change of its depth by e (P,) [px].

    The depth is that from the first keyframe; a point that is not solved moves by 0.
    """
    numbers, poses = bundle.table.numbers, bundle.poses[bundle.table.places]
    eye, points = bundle.poses[bundle.solved[0]][:3, 3], bundle.points[numbers]
    local = np.einsum("nji,nj->ni", poses[:, :3, :3], points - poses[:, :3, 3])
    away = np.einsum("nji,nj->ni", poses[:, :3, :3], points - eye)
    # d (x / z) by the logarithm of the depth, along the ray from the first eye
    moved = (away[:, :2] - local[:, :2] * (away[:, 2:] / local[:, 2:])) / local[:, 2:]
    lengths = bundle.focals_px[bundle.table.places] * np.linalg.norm(moved, axis=1)
    levers = np.zeros(len(bundle.points))
    np.maximum.at(levers, numbers, np.nan_to_num(lengths))
    return levers


def _planes(places: Float64, inverse: Float64, error: Float64) -> list[tuple[Float64, Float64]]:
    """Planes (3,) that most points share, each point in one at most, and their covariances.

    Args:
        places: of points in the picture, and 1 (N, 3).
        inverse: inverse depths (N,).
        error: standard errors of these (N,).
    """
    if len(places) < _FEWEST:
        return []
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    tried, seeds = _tried(places, inverse, apart)
    free = np.ones(len(places), np.bool_)
    holds = abs(tried @ places.T - inverse) < _OFF_PLANE * error
    holds &= (apart < _WIDE)[seeds]
    found: list[tuple[Float64, Float64]] = []
    while len(found) < _MOST_PLANES and len(tried):
        counts = np.count_nonzero(holds & free, axis=1)
        best = int(np.argmax(counts))
        if counts[best] < _FEWEST:
            break
        found.append(_fitted(places, inverse, error, holds[best] & free))
        free &= ~holds[best]
    return found


def _tried(places: Float64, inverse: Float64, apart: Float64) -> tuple[Float64, Ints]:
    """Planes (M, 3) through three neighbours each, and the point that each is of (M,)."""
    rng = np.random.default_rng(0)
    near = np.argsort(apart, axis=1, kind="stable")[:, :_NEIGHBOURS]
    seeds = np.repeat(np.arange(len(places)), _TRIES)
    order = np.argsort(rng.random((len(seeds), near.shape[1])), axis=1)[:, :3]
    three = near[seeds[:, None], order]
    spread = abs(np.linalg.det(places[three])) > _LEAST_AREA
    three = three[spread]
    return np.linalg.solve(places[three], inverse[three][..., None])[..., 0], seeds[spread]


def _fitted(
    places: Float64, inverse: Float64, error: Float64, used: Bool
) -> tuple[Float64, Float64]:
    """The plane (3,) of some points by robust least squares, and its covariance (3, 3)."""
    x, y = places[used] / error[used, None], inverse[used] / error[used]
    weights: Float64 = np.ones(len(y))
    for _ in range(_ROUNDS):
        information = x.T @ (weights[:, None] * x)
        information += _LEAST_INFORMATION * np.trace(information) * np.eye(3)
        plane = np.linalg.solve(information, x.T @ (weights * y))
        weights = 1.0 / (1.0 + (x @ plane - y) ** 2)
    return np.asarray(plane), np.asarray(np.linalg.inv(information))
