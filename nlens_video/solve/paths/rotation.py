"""A camera that turns on the spot: rotations and the field of view from tracks without parallax."""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from nlens_video.core.layers import Float64
from nlens_video.solve.paths.least_cauchy import least_cauchy
from nlens_video.solve.points.evenly import evenly
from nlens_video.solve.points.observations import Ints, Table

_FOCALS = np.geomspace(0.5, 4.0, 9)  # tried first, by the frame's width [1]
_LOSS_PX = 0.5
_ROUNDS = 4
_FEWEST = 8  # points that two frames share
_FAR_PX = 4.0  # of a start that is worth refining


class RotationPath(Struct, frozen=True, eq=False):
    """A solved rotation.

    Attributes:
        focals_px: focal length of each frame (F,) [px].
        focal_error: standard error of the first one [1].
        rotations: camera axes to those of the first frame (F, 3, 3), glTF's.
        residual_px: median distance of an observation from the model [px].
    """

    focals_px: Float64
    focal_error: float
    rotations: Float64
    residual_px: float


def solve_rotation(
    table: Table,
    count: int,
    size: tuple[int, int],
    focal_px: float | None = None,
    *,
    zooms: bool = False,
) -> RotationPath | None:
    """Fit a rotation for each frame, and one focal length or one for each.

    Args:
        table: observations.
        count: number of frames.
        size: columns and rows [px].
        focal_px: focal length of the first frame where it is known [px].
        zooms: whether the focal length changes.

    Returns:
        None where two frames that follow share fewer than eight points, or where no rotation fits.
    """
    used = evenly(table, count, size)
    if not used.any():
        return None
    data = _Data(table.numbers[used], table.places[used], _flat(table.pixels[used], size))
    scales = data.scales(count) if zooms else np.ones(count)
    if scales is None:
        return None
    trials = _FOCALS * size[0] if focal_px is None else np.array([focal_px])
    best = None
    for focal in trials:
        start = data.chain(focal * scales)
        if start is None:
            return None
        score = data.score(focal * scales, start)
        if best is None or score < best[0]:
            best = score, focal * scales, start
    assert best is not None
    if best[0] > _FAR_PX:
        return None
    return data.refined(best[1], best[2], known=focal_px is not None, zooms=zooms)


def resect_rotation(
    directions: Float64, pixels: Float64, size: tuple[int, int], focal_px: float, *, zooms: bool
) -> tuple[Float64, float] | None:
    """Rotation (3, 3) and focal length [px] of a frame that sees points in known directions.

    Args:
        directions: unit vectors in the axes of the first frame (N, 3).
        pixels: positions of the points (N, 2) [px].
        size: columns and rows [px].
        focal_px: focal length, or about that where it changes [px].
        zooms: whether the focal length changes.

    Returns:
        None for fewer than eight points.
    """
    if len(directions) < _FEWEST:
        return None
    flat = _flat(pixels, size)
    turn = _aligned(directions, _rays(flat, np.float64(focal_px)), focal_px)
    for _ in range(_ROUNDS if zooms else 0):
        local = directions @ turn
        expected = focal_px * local[:, :2] / -local[:, 2:]
        away = np.linalg.norm(flat - expected, axis=1)
        weights = 1.0 / (1.0 + (away / (_LOSS_PX + np.median(away))) ** 2)
        products = (flat * expected).sum(axis=1), (expected**2).sum(axis=1)
        focal_px *= float((weights * products[0]).sum() / (weights * products[1]).sum())
        turn = _aligned(directions, _rays(flat, np.float64(focal_px)), focal_px)
    return turn, focal_px


def point_directions(table: Table, path: RotationPath, size: tuple[int, int]) -> Float64:
    """Mean direction of each point in the axes of the first frame (P, 3)."""
    rays = _rays(_flat(table.pixels, size), path.focals_px[table.places])
    turned = np.einsum("nij,nj->ni", path.rotations[table.places], rays)
    sums = np.zeros((len(table.names), 3))
    np.add.at(sums, table.numbers, turned)
    return np.asarray(sums / np.linalg.norm(sums, axis=1, keepdims=True))


def _flat(pixels: Float64, size: tuple[int, int]) -> Float64:
    return np.asarray((pixels - np.array(size) / 2.0) * (1.0, -1.0))


def _rays(flat: Float64, focal: Float64 | np.float64) -> Float64:
    rays = np.column_stack([flat, np.broadcast_to(-focal, len(flat))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _aligned(a: Float64, b: Float64, focal: float) -> Float64:
    """The rotation that takes unit vectors b to a (N, 3), moving things left out."""
    weights = np.ones(len(a))
    turn = np.eye(3)
    for _ in range(_ROUNDS):
        turn = Rotation.align_vectors(a, b, weights=weights)[0].as_matrix()
        away = focal * np.linalg.norm(a - b @ turn.T, axis=1)
        weights = 1.0 / (1.0 + (away / (_LOSS_PX + np.median(away))) ** 2)
    return turn


class _Data(Struct, frozen=True, eq=False):
    """Points, frames and positions from the frame's middle, Y up, of the observations (N,)."""

    numbers: Ints
    places: Ints
    flat: Float64

    def shared(self, place: int) -> tuple[Ints, Ints] | None:
        """Observations of the points that a frame shares with the one before it."""
        first, second = (np.flatnonzero(self.places == n) for n in (place - 1, place))
        _, one, two = np.intersect1d(self.numbers[first], self.numbers[second], return_indices=True)
        return None if len(one) < _FEWEST else (first[one], second[two])

    def scales(self, count: int) -> Float64 | None:
        """How much larger each frame shows things than the first (F,)."""
        found = [1.0]
        for place in range(1, count):
            shared = self.shared(place)
            if shared is None:
                return None
            similarity, _ = cv2.estimateAffinePartial2D(self.flat[shared[0]], self.flat[shared[1]])
            if similarity is None:
                return None
            found.append(found[-1] * math.hypot(similarity[0, 0], similarity[1, 0]))
        return np.array(found)

    def chain(self, focals: Float64) -> Float64 | None:
        """Rotations from one frame to the next, multiplied up (F, 3, 3)."""
        rays = _rays(self.flat, focals[self.places])
        rotations = [np.eye(3)]
        for place in range(1, len(focals)):
            shared = self.shared(place)
            if shared is None:
                return None
            turn = _aligned(rays[shared[0]], rays[shared[1]], float(focals[place]))
            rotations.append(rotations[-1] @ turn)
        return np.array(rotations)

    def score(self, focals: Float64, rotations: Float64) -> float:
        """Median distance of an observation from the model [px]."""
        return float(np.median(np.linalg.norm(self.residuals(focals, rotations), axis=1)))

    def residuals(self, focals: Float64, rotations: Float64) -> Float64:
        """Observed less modelled positions (N, 2) [px]; a point's ray is the mean of its rays."""
        turns, focal = rotations[self.places], focals[self.places]
        rays = np.einsum("nij,nj->ni", turns, _rays(self.flat, focal))
        sums = np.stack([np.bincount(self.numbers, rays[:, axis]) for axis in range(3)], axis=1)
        mean = np.einsum("nji,nj->ni", turns, sums[self.numbers])
        expected = focal[:, None] * mean[:, :2] / np.maximum(-mean[:, 2:], 1e-9)
        return np.asarray(self.flat - expected)

    def slopes(self, focals: Float64, rotations: Float64) -> Float64:
        """Derivatives of the residuals (N, 2, F + 3 F) by each frame's focal length and turn.

        By the logarithm of the focal length, and by a small rotation of the frame's own axes.
        """
        count, points = len(focals), int(self.numbers.max()) + 1
        turns, focal = rotations[self.places], focals[self.places]
        local = _rays(self.flat, focal)
        longer = local * local[:, 2:]  # a ray leans to the axis as the focal length grows
        longer[:, 2] -= 1.0
        longer *= -local[:, 2:]
        moves = np.concatenate([longer[:, :, None], -_crossing(local)], axis=2)
        moves = turns @ moves
        columns = np.column_stack([self.places, count + 3 * self.places[:, None] + range(3)])
        sums = np.zeros((points * 4 * count, 3))
        np.add.at(sums, self.numbers[:, None] * 4 * count + columns, moves.transpose(0, 2, 1))
        rays = np.einsum("nij,nj->ni", turns, local)
        whole = np.stack([np.bincount(self.numbers, rays[:, axis]) for axis in range(3)], axis=1)
        mean = np.einsum("nji,nj->ni", turns, whole[self.numbers])
        depth = np.maximum(-mean[:, 2:], 1e-9)
        flat = mean[:, :2] / depth
        shown = np.zeros((len(flat), 2, 3))
        shown[:, 0, 0] = shown[:, 1, 1] = 1.0
        shown[:, :, 2] = flat
        shown *= (focal / depth[:, 0])[:, None, None]
        moved = sums.reshape(points, 4 * count, 3).transpose(0, 2, 1)[self.numbers]
        found = (shown @ turns.transpose(0, 2, 1)) @ moved
        own = np.concatenate([(focal[:, None] * flat)[:, :, None], shown @ _crossing(mean)], axis=2)
        every = np.arange(len(flat))[:, None]
        found[every, :, columns] += own.transpose(0, 2, 1)
        return np.asarray(-found)

    def refined(self, focals: Float64, start: Float64, *, known: bool, zooms: bool) -> RotationPath:
        """Robust least squares over all rotations, and the focal lengths that are not known."""
        count = len(start)
        free = np.zeros(1 + 4 * count, np.bool_)  # one for all focal lengths, each, three turns
        free[0], free[2 : 1 + count], free[4 + count :] = not known, zooms, True

        def moved(path: _Path, step: Float64) -> _Path:
            whole = np.zeros(len(free))
            whole[free] = step
            turns = Rotation.from_rotvec(whole[1 + count :].reshape(-1, 3)).as_matrix()
            return path[0] * np.exp(whole[0] + whole[1 : 1 + count]), path[1] @ turns

        def slopes(path: _Path) -> Float64:
            each = self.slopes(*path)
            whole = np.concatenate([each[:, :, :count].sum(axis=2, keepdims=True), each], axis=2)
            return np.asarray(whole.reshape(-1, len(free)).T[free], np.float64)

        (solved, rotations), information = least_cauchy(
            lambda path: self.residuals(*path).ravel(), slopes, moved, (focals, start), _LOSS_PX
        )
        median = self.score(solved, rotations)
        variance = float(np.linalg.inv(information)[0, 0]) * (1.4826 * median) ** 2
        return RotationPath(
            focals_px=solved,
            focal_error=0.0 if known else math.sqrt(max(variance, 0.0)),
            rotations=rotations,
            residual_px=median,
        )


_Path = tuple[Float64, Float64]
"""Focal lengths (F,) [px] and rotations (F, 3, 3)."""


def _crossing(vectors: Float64) -> Float64:
    """Matrices (N, 3, 3) whose products with other vectors are cross products."""
    found = np.zeros((len(vectors), 3, 3))
    for one, two, three in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[:, one, two], found[:, two, one] = -vectors[:, three], vectors[:, three]
    return found
