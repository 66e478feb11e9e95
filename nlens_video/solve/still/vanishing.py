"""Pitch, roll and focal length from line segments: vertical and horizontal vanishing points.

The segments are a mixture of clutter, lines along the vertical, and lines along horizontal
directions, some of them in pairs at right angles, as boxes, tiles and streets have them. How much
there is of each is found for every camera by expectation and maximisation. The posterior is
searched on a grid, its modes are climbed by Newton's method, and draws about each of them tell how
much of the posterior it holds, which camera is nearest to all, and the standard errors.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from nlens_video.core.layers import Float64
from nlens_video.solve.still.line_model import FAMILIES, LineModel
from nlens_video.solve.still.newton import climb, derivatives
from nlens_video.solve.still.prior import CameraPrior
from nlens_video.solve.still.sampling import Draws, integrate, nearest_to_all, one_errors
from nlens_video.solve.still.segments import Segments

_COUNTS = np.array([6.0, 6.0, 3.0, 4.0])  # of each family before any segment is seen
_LEVEL_COUNT, _ALONE = 8.0, 0.1  # of horizontal directions; share of those without a right angle
_PRIOR_WEIGHT = 0.4  # of the counts in the posterior
_GRID_SPREAD = math.radians(2.0)
_PITCHES = np.radians(np.concatenate([np.arange(-60, -30, 4.0), np.arange(-30, 12, 2.5)]))
_ROLLS = np.radians([-8.0, -4.5, -2.0, 0.0, 2.0, 4.5, 8.0])
_FOCALS = np.log(np.array([24.0, 32.0, 43.0, 58.0, 80.0]) / 36.0)
_GRID_AZIMUTHS = np.radians(np.arange(0.0, 90.0, 6.0))
_GRID_ROUNDS, _ROUNDS, _LAST_ROUNDS = 6, 25, 10
_AT_ONCE = 1_000_000  # densities in memory
_MODES = 6
_APART = (0.1, 0.05, 0.35)  # between modes that are refined
_STAGES = tuple(np.radians([(2.0, 3.0), (1.0, 1.5), (0.4, 1.0), (0.0, 0.5)]))
_LEAST_SPREAD, _SMOOTH = math.radians(0.25), math.radians(0.3)
_MOST_DIRECTIONS, _LEAST_SHARE = 8, 0.008
_SQUARE = math.radians(3.0)
_SAME_DIRECTION = math.radians(3.5)
_SAME = 3e-3  # modes that are one [rad, 1]
_LOWEST = 12.0  # below the highest mode: others hold nothing
_SCALE = np.array([math.radians(3.0), math.radians(1.0), 0.15])  # errors that count half


class Horizon(Struct, frozen=True):
    """Attitude and focal length, with standard errors.

    Attributes:
        pitch: elevation of the optical axis [rad].
        roll: turn about it [rad].
        log_focal: logarithm of the focal length by the frame's width [1].
        covariance: of the three (3, 3).
    """

    pitch: float
    roll: float
    log_focal: float
    covariance: Float64

    def pose(self, height: float) -> Float64:
        """World-from-camera matrix (4, 4) of a camera at a height that looks along -Z."""
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("XZ", [self.pitch, self.roll]).as_matrix()
        pose[1, 3] = height
        return pose


class _Directions(Struct, frozen=True):
    """Horizontal directions that a camera sees lines along; some pairs are at right angles.

    Attributes:
        azimuths: of a direction, or of the first of a pair (K,) [rad].
        turned: for each direction the place of its azimuth, and the angle to it (D,) [rad].
        shares: of the families and of the directions among the segments (FAMILIES + D,).
    """

    azimuths: Float64
    turned: list[tuple[int, float]]
    shares: Float64


class _Mode(Struct, frozen=True):
    """A mode of the posterior.

    Attributes:
        place: camera and azimuths (3 + K,).
        found: directions.
        log: logarithm of the posterior.
    """

    place: Float64
    found: _Directions
    log: float


class Mixture:
    """Posterior of the camera, given the segments of a plate."""

    def __init__(
        self, segments: Segments, size: tuple[int, int], prior: CameraPrior | None = None
    ) -> None:
        self._lines = LineModel(segments, size)
        self._prior = CameraPrior() if prior is None else prior

    def solve(self) -> Horizon:
        """The mode or mean that is nearest to all draws, and its errors."""
        modes = self._modes()
        draws = [self._draws(mode) for mode in modes]
        logs = np.array([one.log_integral for one in draws])
        shares = np.exp(logs - logs.max())
        shares /= shares.sum()
        cameras = np.concatenate([one.places[:, :3] for one in draws])
        weights = np.concatenate([
            share * one.weights for share, one in zip(shares, draws, strict=True)
        ])  # fmt: skip
        middle = weights @ cameras
        candidates = [mode.place[:3] for mode in modes]
        candidates += [one.weights @ one.places[:, :3] for one in draws]
        scale = np.maximum(_SCALE, np.sqrt(weights @ (cameras - middle) ** 2))
        best = nearest_to_all(np.array([*candidates, middle]), cameras, weights, scale)
        off = cameras - best
        errors = one_errors(off, weights)
        covariance = off.T @ (weights[:, None] * off)
        scale = errors / np.sqrt(np.diag(covariance))
        return Horizon(
            pitch=float(best[0]),
            roll=float(best[1]),
            log_focal=float(best[2]),
            covariance=covariance * np.outer(scale, scale),
        )

    def log_evidence(self, cameras: Float64, spread: float, step: float) -> Float64:
        """Logarithm of the likelihood of cameras, each with the lines that serve it best (C,).

        Args:
            cameras: pitch, roll [rad] and log focal length by the frame's width (C, 3).
            spread: added to the directions' errors, to smooth the search [rad].
            step: between azimuths of horizontal lines [rad].
        """
        azimuths = np.arange(0.0, 0.5 * math.pi - 0.5 * step, step)
        counts = _first_counts(len(azimuths))
        found = []
        for camera in cameras:
            densities = self._densities(camera, azimuths, spread)
            found.append(self._value(densities, self._shares(densities, counts, _ROUNDS)))
        return np.array(found)

    def _starts(self) -> list[Float64]:
        """The best cameras of a grid, apart from each other."""
        grid = np.meshgrid(_PITCHES, _ROLLS, self._focals(), indexing="ij")
        cameras = np.stack(grid, axis=-1).reshape(-1, 3)
        counts = _first_counts(len(_GRID_AZIMUTHS))
        parts = max(1, len(cameras) * len(self._lines.weights) * len(counts) // _AT_ONCE)
        values = []
        for part in np.array_split(cameras, parts):
            densities = self._densities(part, _GRID_AZIMUTHS, _GRID_SPREAD)
            shares = self._shares(densities, counts, _GRID_ROUNDS)
            values.append(self._value(densities, shares) + self._prior.log(part))
        order = np.argsort(-np.concatenate(values), kind="stable")
        picked: list[Float64] = []
        for camera in cameras[order]:
            if all((abs(camera - one) > _APART).any() for one in picked):
                picked.append(camera)
            if len(picked) == _MODES:
                break
        return picked

    def _focals(self) -> Float64:
        middle, spread = self._prior.focal
        return _FOCALS if spread > 0.1 else np.array([middle])

    def _densities(self, cameras: Float64, azimuths: Float64, spread: float) -> Float64:
        """Of all segments in families, pairs and lone directions (C, FAMILIES + 3 M, N)."""
        both = np.concatenate([azimuths, azimuths + 0.5 * math.pi])
        shape = (*cameras.shape[:-1], len(both))
        level = self._lines.horizontal(cameras[..., None, :], np.broadcast_to(both, shape), spread)
        count = len(azimuths)
        pairs = 0.5 * (level[..., :count, :] + level[..., count:, :])
        return np.concatenate([self._lines.families(cameras, spread), pairs, level], axis=-2)

    def _shares(self, densities: Float64, first: Float64, rounds: int) -> Float64:
        """Shares (…, K) of components (…, K, N) by expectation and maximisation."""
        counts = np.zeros(len(first))
        counts[:FAMILIES] = _PRIOR_WEIGHT * _COUNTS
        shares = np.broadcast_to(first / first.sum(), densities.shape[:-1])
        for _ in range(rounds):
            ratio = self._lines.weights / (shares[..., None, :] @ densities)[..., 0, :]
            shares = shares * (densities @ ratio[..., None])[..., 0] + counts
            shares = shares / shares.sum(axis=-1, keepdims=True)
        return np.asarray(shares)

    def _value(self, densities: Float64, shares: Float64) -> Float64:
        """Logarithm of the likelihood of components (…, K, N) and of their shares (…, K)."""
        total = (shares[..., None, :] @ densities)[..., 0, :]
        families = np.log(shares[..., :FAMILIES]) @ (_PRIOR_WEIGHT * _COUNTS)
        return np.asarray(np.log(total) @ self._lines.weights + families)

    def _modes(self) -> list[_Mode]:
        """Modes of the posterior, the highest first, each once."""
        modes = [self._refined(start) for start in self._starts()]
        kept: list[_Mode] = []
        for one in sorted(modes, key=lambda mode: -mode.log):
            apart = all(abs(one.place[:3] - other.place[:3]).max() > _SAME for other in kept)
            if not kept or (apart and one.log > kept[0].log - _LOWEST):
                kept.append(one)
        return kept

    def _refined(self, camera: Float64) -> _Mode:
        """The mode near a camera (3,)."""
        place, found = camera, _Directions(np.zeros(0), [], _COUNTS / _COUNTS.sum())
        for spread, step in _STAGES:
            found = self._directions(place[:3], max(spread, _LEAST_SPREAD), step)
            place = np.concatenate([place[:3], found.azimuths])
            found = self._reshared(place, found, spread)
            place = climb(partial(self._posterior, found=found, spread=spread), place)
        found = self._reshared(place, found, 0.0)
        return _Mode(place, found, float(self._posterior(place, found, 0.0)))

    def _draws(self, mode: _Mode) -> Draws:
        """The posterior about a mode; each azimuth is one more that has to be found."""
        smooth = partial(self._posterior, found=mode.found, spread=_SMOOTH)
        _, curvature = derivatives(smooth, mode.place, 1e-3)
        values, axes = np.linalg.eigh(-curvature)
        least = float(self._prior.information.min())
        spread = axes @ np.diag(1.0 / np.maximum(abs(values), least)) @ axes.T
        exact = partial(self._posterior, found=mode.found, spread=0.0)
        draws = integrate(exact, mode.place, spread)
        families = float(np.log(mode.found.shares[:FAMILIES]) @ (_PRIOR_WEIGHT * _COUNTS))
        cost = len(mode.found.azimuths) * math.log(math.pi)
        return replace(draws, log_integral=draws.log_integral + families - cost)

    def _directions(self, camera: Float64, spread: float, step: float) -> _Directions:
        """The horizontal directions that hold most lines of a camera (3,)."""
        azimuths = np.arange(0.0, 0.5 * math.pi - 0.5 * step, step)
        count = len(azimuths)
        densities = self._densities(camera, azimuths, spread)
        shares = self._shares(densities, _first_counts(count), _ROUNDS)
        pairs, alone = shares[FAMILIES:][:count], shares[FAMILIES:][count:]
        level = alone + 0.5 * np.concatenate([pairs, pairs])
        every = np.concatenate([azimuths, azimuths + 0.5 * math.pi])
        kept: list[float] = []
        turned: list[tuple[int, float]] = []
        held: list[float] = []
        while len(turned) < _MOST_DIRECTIONS and level.max() > _LEAST_SHARE:
            off = _turn(every - every[level.argmax()])
            near = abs(off) < _SAME_DIRECTION
            held.append(float(level[near].sum()))
            one = every[level.argmax()] + float(level[near] @ off[near]) / held[-1]
            level[near] = 0.0
            square = [k for k, other in enumerate(kept)
                      if abs(_turn(one - other - 0.5 * math.pi)) < _SQUARE
                      and (k, 0.5 * math.pi) not in turned]  # fmt: skip
            turned.append((square[0], 0.5 * math.pi) if square else (len(kept), 0.0))
            if not square:
                kept.append(one)
        total = np.concatenate([shares[:FAMILIES], held])
        return _Directions(np.array(kept), turned, total / total.sum())

    def _components(self, places: Float64, found: _Directions, spread: float) -> Float64:
        """Densities (…, FAMILIES + D, N) at cameras with azimuths (…, 3 + K)."""
        cameras = places[..., :3]
        parts = [self._lines.families(cameras, spread)]
        for azimuth, turn in found.turned:
            one = self._lines.horizontal(cameras, places[..., 3 + azimuth] + turn, spread)
            parts.append(one[..., None, :])
        return np.concatenate(parts, axis=-2)

    def _reshared(self, place: Float64, found: _Directions, spread: float) -> _Directions:
        densities = self._components(place, found, spread)
        return replace(found, shares=self._shares(densities, found.shares, _LAST_ROUNDS))

    def _posterior(self, places: Float64, found: _Directions, spread: float) -> Float64:
        """Logarithm of the posterior at cameras with azimuths (…, 3 + K), with shares that stay."""
        total = found.shares @ self._components(places, found, spread)
        return np.asarray(np.log(total) @ self._lines.weights + self._prior.log(places[..., :3]))


def _first_counts(count: int) -> Float64:
    """Counts of the families, of pairs and of lone directions before any segment is seen."""
    pairs = np.full(count, _LEVEL_COUNT * (1.0 - _ALONE) / count)
    alone = np.full(2 * count, _LEVEL_COUNT * _ALONE / (2 * count))
    return np.concatenate([_COUNTS, pairs, alone])


def _turn(angle: Float64) -> Float64:
    """Angles between lines, from -90 to 90 degrees [rad]."""
    return np.asarray((angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
