"""Pitch, roll and focal length from line segments: vertical and horizontal vanishing points.

The segments are a mixture: lines along the vertical, lines along a few horizontal directions,
clutter. Clutter on a foreshortened ground lies near the image's horizontal and standing clutter
near the vertical, so both are broad components beside a uniform one; without them a camera that
looks straight ahead would explain everything. The posterior is searched on a grid and refined by
Newton's method; standard errors come from its curvature and from the spread of its modes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.solve.segments import Segments

_UNIFORM, _FLAT, _UPRIGHT, _VERTICAL, _HORIZONTAL = 0.25, 0.2, 0.1, 0.15, 0.12
_FLAT_SPREAD, _UPRIGHT_SPREAD = math.radians(14.0), math.radians(7.0)
_DIRECTIONS = 4
_DIRECTION_ERROR = math.radians(0.2)
_TEMPER = 0.5  # neighbouring segments are not independent
_LONG = 0.08  # of the frame's width: shorter segments count less
_RIGHT_ANGLE = math.radians(0.7)
_GRID_SPREAD = math.radians(2.5)
_PITCHES = np.radians(np.concatenate([np.arange(-62, -30, 4.0), np.arange(-30, 16, 2.0)]))
_ROLLS = np.radians(np.arange(-8, 9, 2.0))
_FOCALS = np.log(np.array([24.0, 35.0, 50.0, 80.0]) / 36.0)
_YAWS = np.radians(np.arange(0, 180, 5.0))
_MODES = 12
_PITCH_PRIOR = math.radians(-15.0), math.radians(18.0)
FOCAL_PRIOR = math.log(40.0 / 36.0), 0.45
"""Logarithm of the focal length by the frame's width, and its spread, where nothing is known."""


@dataclass(frozen=True, slots=True)
class Horizon:
    """Attitude and focal length, with standard errors.

    Attributes:
        pitch: elevation of the optical axis [rad].
        roll: turn about it [rad].
        log_focal: logarithm of the focal length by the frame's width [1].
        covariance: of the three (3, 3).
        share: of the posterior that the best mode holds [1].
    """

    pitch: float
    roll: float
    log_focal: float
    covariance: Float64
    share: float


class Mixture:
    """Posterior of the camera, given the segments of a plate."""

    def __init__(
        self,
        segments: Segments,
        size: tuple[int, int],
        focal: tuple[float, float] = FOCAL_PRIOR,
    ) -> None:
        width, height = size
        flat = (segments.ends - (0.5 * width, 0.5 * height)) * (1.0, -1.0)
        along = flat[:, 1] - flat[:, 0]
        lengths = segments.lengths
        self._middles = flat.mean(axis=1) / width
        self._along = along / lengths[:, None]
        self._variance = 2.0 * (segments.error_px / lengths) ** 2 + _DIRECTION_ERROR**2
        self._weights = _TEMPER * np.minimum(1.0, lengths / (_LONG * width))
        self._focal = focal

    def solve(self) -> Horizon:
        """The best camera and its errors."""
        modes = [self._refined(start) for start in self._starts()]
        logs = np.array([value + 0.5 * np.linalg.slogdet(spread)[1] for value, _, spread in modes])
        found: list[tuple[float, Float64, Float64]] = []
        for log, (_, camera, spread) in sorted(
            zip(logs, modes, strict=True), key=lambda pair: -pair[0]
        ):
            known = any(abs(camera[:3] - other[:3]).max() < 3e-3 for _, other, _ in found)
            if not known:
                found.append((math.exp(log - logs.max()), camera[:3], spread[:3, :3]))
        shares = np.array([one[0] for one in found])
        shares /= shares.sum()
        best = found[0][1]
        covariance = sum(
            share * (spread + np.outer(camera - best, camera - best))
            for share, (_, camera, spread) in zip(shares, found, strict=True)
        )
        return Horizon(
            pitch=float(best[0]),
            roll=float(best[1]),
            log_focal=float(best[2]),
            covariance=np.asarray(covariance),
            share=float(shares[0]),
        )

    def log_posterior(self, cameras: Float64, spread: float = 0.0) -> Float64:
        """Logarithm of the posterior, up to a constant.

        Args:
            cameras: pitch, roll, log focal length, then azimuths of horizontal lines (…, 3 + K).
            spread: added to the directions' errors, to smooth the search [rad].
        """
        pitch, roll, focal = cameras[..., 0], cameras[..., 1], np.exp(cameras[..., 2])
        count = cameras.shape[-1] - 3
        total = self._clutter(pitch, roll, focal, spread)
        for k in range(count):
            total = total + _HORIZONTAL * self._horizontal(
                pitch, roll, focal, cameras[..., 3 + k], spread
            )
        return self._sum(total, count) + self._prior(cameras)

    def _sum(self, total: Float64, count: int) -> Float64:
        whole = _UNIFORM + _FLAT + _UPRIGHT + _VERTICAL + count * _HORIZONTAL
        return np.asarray((self._weights * np.log(total / whole)).sum(axis=-1))

    def _prior(self, cameras: Float64) -> Float64:
        pitch, roll = cameras[..., 0], np.degrees(cameras[..., 1])
        log = -0.5 * ((cameras[..., 2] - self._focal[0]) / self._focal[1]) ** 2
        log = log - 0.5 * ((pitch - _PITCH_PRIOR[0]) / _PITCH_PRIOR[1]) ** 2
        log = log + np.log(
            0.8 / 1.5 * np.exp(-0.5 * (roll / 1.5) ** 2)
            + 0.2 / 8.0 * np.exp(-0.5 * (roll / 8.0) ** 2)
        )
        for k in range(3, cameras.shape[-1]):
            for j in range(3, k):
                turn = np.cos(cameras[..., k] - cameras[..., j]) / _RIGHT_ANGLE
                peak = math.sqrt(0.5 * math.pi) / _RIGHT_ANGLE
                log = log + np.log(0.5 + 0.5 * peak * np.exp(-0.5 * turn**2))
        return np.asarray(log)

    def _clutter(self, pitch: Float64, roll: Float64, focal: Float64, spread: float) -> Float64:
        """Density of what is not horizontal: clutter, and lines along the vertical."""
        across, _ = _level_axes(pitch, roll)
        up = np.stack(
            [np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll), -np.sin(pitch)], axis=-1
        )
        upright = self._squared_sines(up, focal)
        flat = across[..., 0, None] * self._along[:, 1] - across[..., 1, None] * self._along[:, 0]
        return np.asarray(
            _UNIFORM / math.pi
            + _FLAT * _normal(flat**2, _FLAT_SPREAD**2)
            + _UPRIGHT * _normal(upright, _UPRIGHT_SPREAD**2)
            + _VERTICAL * _normal(upright, self._variance + spread**2)
        )

    def _horizontal(
        self, pitch: Float64, roll: Float64, focal: Float64, yaw: Float64, spread: float
    ) -> Float64:
        """Density of lines along one horizontal direction."""
        across, away = _level_axes(pitch, roll)
        direction = across * np.cos(yaw)[..., None] + away * np.sin(yaw)[..., None]
        return _normal(self._squared_sines(direction, focal), self._variance + spread**2)

    def _squared_sines(self, direction: Float64, focal: Float64) -> Float64:
        """Squared sine between each segment and the line to a vanishing point (…, N)."""
        x = (focal * direction[..., 0])[..., None] + direction[..., 2, None] * self._middles[:, 0]
        y = (focal * direction[..., 1])[..., None] + direction[..., 2, None] * self._middles[:, 1]
        cross = x * self._along[:, 1] - y * self._along[:, 0]
        return np.asarray(cross**2 / (x**2 + y**2 + 1e-12))

    def _starts(self) -> list[Float64]:
        """The best cameras of a grid, with the azimuths that serve each best."""
        grid = np.stack(np.meshgrid(_PITCHES, _ROLLS, self._focals(), indexing="ij"), axis=-1)
        cameras = grid.reshape(-1, 3)
        rows = []
        for part in np.array_split(cameras, max(1, len(cameras) * len(self._weights) // 60000)):
            pitch, roll, focal = part[:, 0], part[:, 1], np.exp(part[:, 2])
            total = self._clutter(pitch, roll, focal, _GRID_SPREAD)
            lines = _HORIZONTAL * self._horizontal(
                pitch[:, None], roll[:, None], focal[:, None],
                np.broadcast_to(_YAWS, (len(part), len(_YAWS))), _GRID_SPREAD,
            )  # fmt: skip
            chosen = []
            for count in range(1, _DIRECTIONS + 1):
                best = self._sum(total[:, None] + lines, count).argmax(axis=1)
                total = total + lines[np.arange(len(part)), best]
                chosen.append(_YAWS[best])
            values = self._sum(total, _DIRECTIONS) + self._prior(part)
            rows.append(np.column_stack([values, part, np.stack(chosen, axis=1)]))
        table = np.concatenate(rows)
        picked: list[Float64] = []
        for row in table[np.argsort(-table[:, 0])]:
            if all((abs(row[1:4] - one[:3]) > (0.1, 0.07, 0.3)).any() for one in picked):
                picked.append(row[1:])
            if len(picked) == _MODES:
                break
        return picked

    def _focals(self) -> Float64:
        middle, spread = self._focal
        return _FOCALS if spread > 0.1 else np.array([middle])

    def _refined(self, start: Float64) -> tuple[float, Float64, Float64]:
        """A mode: its value, camera with distinct azimuths, and covariance."""
        camera = start
        for spread in np.radians((2.0, 1.0, 0.4, 0.0)):
            camera = self._climb(_distinct(camera), float(spread))
        _, curvature = self._derivatives(camera, math.radians(0.3), 1e-3)
        values, axes = np.linalg.eigh(-curvature)
        covariance = axes @ np.diag(1.0 / np.maximum(values, 4.0)) @ axes.T
        return float(self.log_posterior(camera)), camera, covariance

    def _climb(self, camera: Float64, spread: float) -> Float64:
        """Newton's method with a step that always gains."""
        value, damping = float(self.log_posterior(camera, spread)), 1e-2
        for _ in range(6):
            slope, curvature = self._derivatives(camera, spread, 2e-4)
            values, axes = np.linalg.eigh(-curvature)
            gained = 0.0
            for _ in range(5):
                step = axes @ ((axes.T @ slope) / (np.maximum(abs(values), 1.0) + damping))
                tried = camera + np.clip(step, -0.1, 0.1)
                found = float(self.log_posterior(tried, spread))
                if found > value:
                    camera, gained, value, damping = tried, found - value, found, 0.3 * damping
                    break
                damping = max(10.0 * damping, 10.0)
            if gained < 1e-3:
                break
        return camera

    def _derivatives(self, camera: Float64, spread: float, step: float) -> tuple[Float64, Float64]:
        """Gradient (P,) and Hessian (P, P) by central differences."""
        count = len(camera)
        shifts = step * np.eye(count)
        pairs = [(i, j) for i in range(count) for j in range(i)]
        places = [camera, *(camera + shifts), *(camera - shifts)]
        for i, j in pairs:
            both, apart = shifts[i] + shifts[j], shifts[i] - shifts[j]
            places += [camera + both, camera - both, camera + apart, camera - apart]
        values = self.log_posterior(np.array(places), spread)
        up, down = values[1 : 1 + count], values[1 + count : 1 + 2 * count]
        hessian = np.diag((up + down - 2.0 * values[0]) / step**2)
        mixed = values[1 + 2 * count :].reshape(-1, 4)
        for (i, j), (a, b, c, d) in zip(pairs, mixed, strict=True):
            hessian[i, j] = hessian[j, i] = (a + b - c - d) / (4.0 * step**2)
        return (up - down) / (2.0 * step), hessian


def _level_axes(pitch: Float64, roll: Float64) -> tuple[Float64, Float64]:
    """Horizontal directions across the view and away from it, in camera axes (…, 3)."""
    none = np.zeros_like(pitch)
    across = np.stack(np.broadcast_arrays(np.cos(roll), -np.sin(roll), none), axis=-1)
    away = np.stack(
        [np.sin(pitch) * np.sin(roll), np.sin(pitch) * np.cos(roll), np.cos(pitch) + 0.0 * roll],
        axis=-1,
    )
    return across, away


def _normal(squares: Float64, variance: Float64 | float) -> Float64:
    return np.asarray(np.exp(-0.5 * squares / variance) / np.sqrt(2.0 * math.pi * variance))


def _distinct(camera: Float64) -> Float64:
    """The camera with azimuths that have come together taken as one."""
    kept: list[float] = []
    for yaw in camera[3:]:
        if all(abs(math.sin(yaw - other)) > math.radians(1.5) for other in kept):
            kept.append(float(yaw))
    return np.concatenate([camera[:3], kept])
