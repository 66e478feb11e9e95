"""Solves spectrum, gains, noise, softness and lens of bands of the ground together."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.stages.texture.law import (
    DIRECTIONS,
    LARGEST_PX,
    MAGNITUDES,
    TextureLaw,
    Unknowns,
    log_disc,
)
from nlens_video.stages.texture.spectra import Bins, Spectra

USUAL_GAIN = 0.3
"""Deviation of the logarithm of a band's contrast."""
USUAL_SOFTNESS_PX, SOFTNESS = 0.5, 0.3
"""Softness, and deviation of its logarithm."""
_BEND, _TURN = 0.7, 2.0  # of the log spectrum: second difference by magnitude, first by direction
_LAW = 0.15  # error of the law in the log power
_NOISE = 0.4  # deviation of the logarithm of a band's noise
_RIDGE = 1e-6  # of unknowns that nothing tells
_OUTLIER = 4.0  # residuals beyond it, in errors, count little
_FOCUSES = np.concatenate([[0.0], np.geomspace(0.15, 4.0, 24)])  # by the usual disparity
_SLOPES = np.geomspace(0.6, 60.0, 18)  # CoC of what is at infinity in px, focused there
_LARGEST_SCANNED_PX = 45.0  # CoC of the scan
_LEAST_SIGNAL = 0.02  # of the power, where it is no more than the noise
_FINEST = 0.42  # frequencies that show the noise [1 / px]
_TEXTURE_THERE = 0.3  # part of the log power there that is taken for the texture's
_STEPS, _TRIALS = 12, 6  # of Levenberg-Marquardt
_LARGEST_STEP = 2.0
_ENOUGH = 0.01  # of cost
_HALF_PX = 0.15  # of the difference quotient by the CoC


class Bands(Struct, frozen=True, kw_only=True, eq=False):
    """Mean spectra of B bands of the ground.

    Attributes:
        spectra: of the bands.
        error: of their log power (B, M).
        patches: how many each is worth (B,).
    """

    spectra: Spectra
    error: Float64
    patches: Float64


class Solution(Struct, frozen=True, kw_only=True, eq=False):
    """A minimum of the cost.

    Attributes:
        cost: twice the negative logarithm of the likelihood and of the priors.
        unknown: all of it.
        covariance: of slope and intercept (2, 2), the others unknown too.
    """

    cost: float
    unknown: Unknowns
    covariance: Float64


class _Linear(Struct, frozen=True, kw_only=True, eq=False):
    """A weighted linear problem of N values and K unknowns.

    Attributes:
        design: (N, K).
        weight: of the values (N,).
        root: Cholesky factor of the normal matrix, priors included (K, K).
        target: values without any blur (N,).
    """

    design: Float64
    weight: Float64
    root: Float64
    target: Float64


class TextureSolver:
    """Fits the law to bands of the ground.

    Args:
        bins: frequencies of the spectra.
        bands: what is fitted to.

    Attributes:
        law: at the bands.
        patches: how many each is worth (B,).
        size: number of measured values, B * M.
    """

    def __init__(self, bins: Bins, bands: Bands) -> None:
        self.law = TextureLaw(bins, bands.spectra)
        self._bins, self.patches = bins, bands.patches
        self._measured = bands.spectra.log_power + bins.log_bias
        self._weight = 1.0 / (bands.error**2 + _LAW**2)
        self._texture = self.law.design()
        self._prior, self._usual = _prior(len(bands.patches))
        self.size = self._measured.size

    def scan(self) -> list[tuple[float, float]]:
        """Slopes [px * scene unit] and intercepts [px] of a grid of lenses, the likeliest first.

        With the noise taken as known the logarithm of the signal is linear in spectrum and gains,
        which are then solved for all lenses at once.
        """
        lenses = self._lenses()
        linear, wanted = self._linear, self._wanted(lenses)
        weighted = linear.weight[:, None] * wanted
        reached = np.linalg.solve(linear.root, linear.design.T @ weighted)
        cost = (wanted * weighted).sum(axis=0) - np.square(reached).sum(axis=0)
        return [(float(lens[0]), float(lens[1])) for lens in lenses[np.argsort(cost)]]

    def solve(self, slope: float, intercept: float) -> Solution:
        """The minimum that Levenberg-Marquardt reaches from a slope and an intercept [px]."""
        vector = self._begin(slope, intercept)
        texture, whole = self._power(vector)
        cost, damping = self._cost(vector, whole), 1e-2
        normal = np.eye(len(vector))
        for _ in range(_STEPS):
            normal, right = self._normal(vector, texture, whole)
            for _ in range(_TRIALS):
                damped = normal + damping * np.diag(np.diag(normal) + _RIDGE)
                step = np.linalg.solve(damped, right)
                step[:-2] = np.clip(step[:-2], -_LARGEST_STEP, _LARGEST_STEP)
                moved = vector + step
                moved[-1] = min(moved[-1], 0.0)  # nothing is focused beyond infinity
                if self._is_lens(*moved[-2:]):
                    found = self._power(moved)
                    new_cost = self._cost(moved, found[1])
                    if new_cost < cost:
                        break
                damping *= 8.0
            else:
                break
            vector, (texture, whole) = moved, found
            gained, cost = cost - new_cost, new_cost
            damping = max(damping / 6.0, _RIDGE)
            if gained < _ENOUGH:
                break
        inverse = np.linalg.inv(normal + 1e-3 * _RIDGE * np.eye(len(normal)))
        covariance = np.asarray(inverse[-2:, -2:], dtype=np.float64)
        return Solution(cost=cost, unknown=Unknowns.of(vector), covariance=covariance)

    @cached_property
    def _noise(self) -> float:
        """A guess of the logarithm of the noise."""
        finest = self._measured[:, self._bins.magnitude > _FINEST]
        return float(np.median(finest, axis=1).min()) - _TEXTURE_THERE

    @cached_property
    def _linear(self) -> _Linear:
        """The signal by spectrum and gains, the noise being that of the guess."""
        bands, bins = self._measured.shape
        signal = np.maximum(1.0 - np.exp(self._noise - self._measured), _LEAST_SIGNAL)
        weight = (self._weight * signal**2).ravel()
        softened = self.law.softened(math.log(USUAL_SOFTNESS_PX))
        gains = np.repeat(np.eye(bands), bins, axis=0)
        design = np.hstack([self._texture.reshape(bands * bins, -1), gains])
        prior = self._prior[:, : design.shape[1]]
        normal = design.T @ (design * weight[:, None]) + prior.T @ prior
        return _Linear(
            design=design,
            weight=weight,
            root=np.linalg.cholesky(normal + _RIDGE * np.eye(len(normal))),
            target=(self._measured + np.log(signal) - self.law.area + softened).ravel(),
        )

    def _wanted(self, lenses: Float64) -> Float64:
        """Logarithm of the signal without the blur of lenses (L, 2): (B * M, L)."""
        coc = np.abs(lenses[:, :1] * self.law.disparity + lenses[:, 1:])
        blur = log_disc(coc[..., None] * self.law.frequency).reshape(len(lenses), -1)
        return np.asarray((self._linear.target - blur).T)

    def _begin(self, slope: float, intercept: float) -> Float64:
        """Unknowns to begin with at a lens."""
        linear = self._linear
        wanted = self._wanted(np.array([[slope, intercept]]))[:, 0]
        reached = np.linalg.solve(linear.root, linear.design.T @ (linear.weight * wanted))
        found = np.linalg.solve(linear.root.T, reached)
        vector = np.zeros(self._prior.shape[1])
        vector[: len(found)] = found
        vector[-4:] = self._noise, math.log(USUAL_SOFTNESS_PX), slope, intercept
        return vector

    def _lenses(self) -> Float64:
        """Slopes and intercepts of the grid (L, 2)."""
        usual = float(np.average(self.law.disparity, weights=self.patches))
        slopes, focuses = (
            values.ravel() for values in np.meshgrid(_SLOPES / usual, _FOCUSES * usual)
        )
        lenses = np.stack([slopes, -slopes * focuses], axis=1)
        coc = np.abs(lenses[:, :1] * self.law.disparity + lenses[:, 1:])
        return np.asarray(lenses[coc.max(axis=1) <= _LARGEST_SCANNED_PX])

    def _power(self, vector: Float64) -> tuple[Float64, Float64]:
        """Logarithm of the power without noise and with it (B, M)."""
        unknown = Unknowns.of(vector)
        seen = self.law.seen(unknown, self._texture @ unknown.spectrum, unknown.gain)
        return seen, np.logaddexp(seen, (unknown.common_noise + unknown.noise)[:, None])

    def _cost(self, vector: Float64, whole: Float64) -> float:
        """Of unknowns by which the log power is `whole` (B, M); grows slowly for outliers."""
        squared = np.square(self._measured - whole) * self._weight
        off = self._prior @ vector - self._usual
        return float(_OUTLIER**2 * np.log1p(squared / _OUTLIER**2).sum() + off @ off)

    def _normal(self, vector: Float64, seen: Float64, whole: Float64) -> tuple[Float64, Float64]:
        """Normal matrix and right side of the step."""
        design = self._jacobian(Unknowns.of(vector), np.exp(seen - whole))
        left = self._measured - whole
        weight = self._weight / (1.0 + np.square(left) * self._weight / _OUTLIER**2)
        normal = design.T @ (design * weight.reshape(-1, 1)) + self._prior.T @ self._prior
        right = design.T @ (weight * left).ravel()
        return normal, right - self._prior.T @ (self._prior @ vector - self._usual)

    def _jacobian(self, unknown: Unknowns, share: Float64) -> Float64:
        """Derivative of the log power by the unknowns (B * M, N); `share`: of the texture in it."""
        knots, bands = len(unknown.spectrum), np.arange(len(unknown.gain))
        design = np.zeros((*share.shape, knots + 2 * len(bands) + 4))
        np.multiply(self._texture, share[..., None], out=design[..., :knots])
        design[bands, :, knots + bands] = share
        design[bands, :, knots + len(bands) + bands] = design[..., -4] = 1.0 - share
        design[..., -3] = -2.0 * share * self.law.softened(unknown.softness)
        signed = (unknown.slope * self.law.disparity + unknown.intercept)[:, None]
        low, high = np.maximum(np.abs(signed) - _HALF_PX, 0.0), np.abs(signed) + _HALF_PX
        rise = log_disc(high * self.law.frequency) - log_disc(low * self.law.frequency)
        by_coc = share * rise / (high - low) * np.sign(signed)
        design[..., -2], design[..., -1] = by_coc * self.law.disparity[:, None], by_coc
        return design.reshape(share.size, -1)

    def _is_lens(self, slope: float, intercept: float) -> bool:
        """Whether nearer ground has the larger signed CoC, and none one beyond the table."""
        coc = np.abs(slope * self.law.disparity + intercept)
        return bool(slope > 0.0 and coc.max() < LARGEST_PX)


def _prior(bands: int) -> tuple[Float64, Float64]:
    """Usual values as rows (Q, N) and right sides (Q,), each of unit error."""
    knots = MAGNITUDES * DIRECTIONS
    grid = np.eye(knots).reshape(MAGNITUDES, DIRECTIONS, knots)
    bend = np.diff(grid, 2, axis=0).reshape(-1, knots) / _BEND
    turn = (grid - np.roll(grid, 1, axis=1)).reshape(-1, knots) / _TURN
    smooth = len(bend) + len(turn)
    rows = np.zeros((smooth + 2 * bands + 1, knots + 2 * bands + 4))
    rows[:smooth, :knots] = np.vstack([bend, turn])
    deviations = np.repeat([USUAL_GAIN, _NOISE], bands)
    rows[smooth:-1, knots : knots + 2 * bands] = np.diag(1.0 / deviations)
    rows[-1, -3] = 1.0 / SOFTNESS
    usual = np.zeros(len(rows))
    usual[-1] = math.log(USUAL_SOFTNESS_PX) / SOFTNESS
    return rows, usual
