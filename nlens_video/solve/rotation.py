"""A camera that turns on the spot: rotations and the field of view from tracks without parallax."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from nlens_video.core.layers import Float32, Float64
from nlens_video.solve.tracks import Ints, observations

_FOCALS = np.geomspace(0.5, 4.0, 9)  # tried first, by the frame's width [1]
_LOSS_PX = 0.5
_ROUNDS = 4
_FEWEST = 8  # points that two frames share
_FAR_PX = 4.0  # of a start that is worth refining
_MOST_TRACKS = 300  # the longest suffice


@dataclass(frozen=True, slots=True, eq=False)
class RotationPath:
    """A solved rotation.

    Attributes:
        focal_px: focal length [px].
        focal_stderr_px: its standard error [px].
        rotations: camera axes to those of the first frame (F, 3, 3), glTF's.
        residual_px: median distance of an observation from the model [px].
    """

    focal_px: float
    focal_stderr_px: float
    rotations: Float64
    residual_px: float


def solve_rotation(
    tracks: list[dict[int, Float32]],
    frames: list[int],
    size: tuple[int, int],
    focal_px: float | None = None,
) -> RotationPath | None:
    """Fit one focal length and a rotation for each frame.

    Args:
        tracks: positions of points by frame [px].
        frames: those to solve, in order.
        size: columns and rows [px].
        focal_px: focal length where it is known [px].

    Returns:
        None where two frames that follow share fewer than eight points, or where no rotation fits.
    """
    longest = sorted(tracks, key=len, reverse=True)[:_MOST_TRACKS]
    numbers, places, pixels = observations(longest, frames)
    flat = (pixels - np.array(size) / 2.0) * (1.0, -1.0)
    trials = _FOCALS * size[0] if focal_px is None else np.array([focal_px])
    starts = [_chain(numbers, places, flat, len(frames), focal) for focal in trials]
    best = None
    for focal, start in zip(trials, starts, strict=True):
        if start is None:
            return None
        residual = _residuals(numbers, places, flat, focal, start)
        score = float(np.median(np.linalg.norm(residual, axis=1)))
        if best is None or score < best[0]:
            best = score, float(focal), start
    assert best is not None
    if best[0] > _FAR_PX:
        return None
    return _refined(numbers, places, flat, best[1], best[2], known=focal_px is not None)


def resect_rotations(
    tracks: list[dict[int, Float32]],
    keyframes: list[int],
    frames: list[int],
    path: RotationPath,
    size: tuple[int, int],
) -> Float64:
    """Rotations of all frames (F, 3, 3), those between keyframes from the points' mean rays.

    A frame that sees too few points gets the rotation of the frame before it.
    """
    numbers, places, pixels = observations(tracks, keyframes)
    middle = np.array(size) / 2.0
    rays = _rays((pixels - middle) * (1.0, -1.0), path.focal_px)
    turned = np.einsum("nij,nj->ni", path.rotations[places], rays)
    sums = np.zeros((len(tracks), 3))
    np.add.at(sums, numbers, turned)
    known = np.linalg.norm(sums, axis=1) > 0.0
    numbers, places, pixels = observations(tracks, frames)
    rays = _rays((pixels - middle) * (1.0, -1.0), path.focal_px)
    found = [np.eye(3)]
    for frame in range(len(frames)):
        here = np.flatnonzero((places == frame) & known[numbers])
        if len(here) < _FEWEST:
            found.append(found[-1])
            continue
        directions = sums[numbers[here]]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        found.append(_aligned(directions, rays[here], path.focal_px))
    return np.array(found[1:])


def _aligned(a: Float64, b: Float64, focal: float) -> Float64:
    """The rotation that takes unit vectors b to a (N, 3), moving things left out."""
    weights = np.ones(len(a))
    turn = np.eye(3)
    for _ in range(_ROUNDS):
        turn = Rotation.align_vectors(a, b, weights=weights)[0].as_matrix()
        away = focal * np.linalg.norm(a - b @ turn.T, axis=1)
        weights = 1.0 / (1.0 + (away / (_LOSS_PX + np.median(away))) ** 2)
    return turn


def _rays(flat: Float64, focal: float) -> Float64:
    rays = np.column_stack([flat, np.full(len(flat), -focal)])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _chain(numbers: Ints, places: Ints, flat: Float64, count: int, focal: float) -> Float64 | None:
    """Rotations from one frame to the next, multiplied up (F, 3, 3)."""
    rays = _rays(flat, focal)
    rotations = [np.eye(3)]
    for frame in range(1, count):
        first, second = places == frame - 1, places == frame
        _, one, two = np.intersect1d(numbers[first], numbers[second], return_indices=True)
        if len(one) < _FEWEST:
            return None
        a, b = rays[first][one], rays[second][two]
        turn = _aligned(a, b, focal)
        rotations.append(rotations[-1] @ turn)
    return np.array(rotations)


def _residuals(
    numbers: Ints, places: Ints, flat: Float64, focal: float, rotations: Float64
) -> Float64:
    """Observed less modelled positions (N, 2) [px]; a point's ray is the mean of its rays."""
    rays = np.einsum("nij,nj->ni", rotations[places], _rays(flat, focal))
    sums = np.stack(
        [np.bincount(numbers, rays[:, axis], numbers.max() + 1) for axis in range(3)], axis=1
    )
    mean = np.einsum("nji,nj->ni", rotations[places], sums[numbers])
    return np.asarray(flat - focal * mean[:, :2] / np.minimum(mean[:, 2:], -1e-9) * -1.0)


def _refined(
    numbers: Ints, places: Ints, flat: Float64, focal: float, start: Float64,
    *, known: bool,
) -> RotationPath:  # fmt: skip
    """Robust least squares over all rotations, and the focal length unless it is known."""
    count = len(start)

    def unpack(values: Float64) -> tuple[float, Float64]:
        turns = Rotation.from_rotvec(values[1:].reshape(-1, 3)).as_matrix()
        later = np.einsum("nij,njk->nik", start[1:], turns)
        return focal * math.exp(values[0]), np.concatenate([start[:1], later])

    def cost(values: Float64) -> Float64:
        if known:
            values = np.concatenate([[0.0], values[1:]])
        return _residuals(numbers, places, flat, *unpack(values)).ravel()

    found = least_squares(cost, np.zeros(3 * count - 2), loss="cauchy", f_scale=_LOSS_PX)
    solved, rotations = unpack(np.concatenate([[0.0], found.x[1:]]) if known else found.x)
    away = np.linalg.norm(_residuals(numbers, places, flat, solved, rotations), axis=1)
    noise = 1.4826 * float(np.median(away))
    jacobian = np.asarray(found.jac)
    information = jacobian.T @ jacobian + 1e-12 * np.eye(len(found.x))
    variance = float(np.linalg.inv(information)[0, 0]) * noise**2
    return RotationPath(
        focal_px=solved,
        focal_stderr_px=0.0 if known else solved * math.sqrt(max(variance, 0.0)),
        rotations=rotations,
        residual_px=float(np.median(away)),
    )
