"""Integrals over a density near one of its modes, by adaptive importance sampling.

The mixture of lines has broad shoulders and ridges, where the curvature at the mode tells neither
its spread nor its weight. Draws of a multivariate t distribution are weighted by the density, and
the distribution is fitted to them anew, some rounds long (Cappé et al. 2008, "Adaptive importance
sampling in general mixture classes"). Weights are flattened
where few draws would hold all of them, so that the fit goes to the density step by step.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from scipy.special import gammaln

from nlens_video.core.layers import Float64

_FREEDOM = 5.0  # of the t distribution: its tails hold those of the density
_ROUNDS, _DRAWS, _LAST = 5, 240, 480
_ONE_ERROR = 0.683  # of a normal distribution
_FEWEST, _FEWEST_EACH = 10.0, 3.0  # draws that count at least, and for each dimension
_HALVINGS = 12
_WIDER = 1.3  # than the draws' own covariance [1]


class Draws(Struct, frozen=True):
    """A density near a mode.

    Attributes:
        places: (N, P).
        weights: of the places, of sum 1 (N,).
        log_integral: logarithm of the density's integral.
    """

    places: Float64
    weights: Float64
    log_integral: float


def integrate(log_density: Callable[[Float64], Float64], mode: Float64, spread: Float64) -> Draws:
    """Draw from a density.

    Args:
        log_density: of places (N, P), up to a constant (N,).
        mode: where to begin (P,).
        spread: covariance to begin with (P, P).
    """
    rng = np.random.default_rng(0)
    middle, covariance = mode, spread
    for count in [_DRAWS] * _ROUNDS + [_LAST]:
        root = np.linalg.cholesky(covariance)
        normal = rng.standard_normal((count, len(mode)))
        stretch = np.sqrt(_FREEDOM / rng.chisquare(_FREEDOM, count))
        places = middle + (normal * stretch[:, None]) @ root.T
        squares = (normal**2).sum(axis=1) * stretch**2
        proposed = _log_t(squares, len(mode)) - np.log(np.diag(root)).sum()
        logs = log_density(places) - proposed
        weights = _tempered(logs - logs.max(), _FEWEST + _FEWEST_EACH * len(mode))
        middle = weights @ places
        off = places - middle
        least = 1e-3 * np.diag(np.diag(covariance))
        covariance = _WIDER**2 * (off.T @ (weights[:, None] * off)) + least
    log_integral = float(logs.max() + math.log(np.exp(logs - logs.max()).mean()))
    return Draws(places, weights, log_integral)


def _tempered(logs: Float64, fewest: float) -> Float64:
    """Weights (N,) of sum 1, to a power that leaves so many draws their say."""
    low, high = 0.0, 1.0
    for power in (1.0, *[0.5] * _HALVINGS):
        tried = high if power == 1.0 else power * (low + high)
        weights = np.exp(tried * logs)
        weights /= weights.sum()
        if 1.0 / (weights**2).sum() >= fewest:
            if tried == 1.0:
                break
            low = tried
        else:
            high = tried
    return np.asarray(weights)


def _log_t(squares: Float64, size: int) -> Float64:
    """Logarithm of the density of a t distribution at squared distances from its middle."""
    whole = 0.5 * (_FREEDOM + size)
    scale = gammaln(whole) - gammaln(0.5 * _FREEDOM) - 0.5 * size * math.log(_FREEDOM * math.pi)
    return np.asarray(scale - whole * np.log1p(squares / _FREEDOM))


def nearest_to_all(
    candidates: Float64, places: Float64, weights: Float64, scale: Float64
) -> Float64:
    """The candidate (P,) of some (C, P) that is nearest to places (N, P) by their weights (N,).

    Distances count by a scale (P,), and saturate beyond it: where there are two modes, it is in the
    larger one and not between them.
    """
    apart = abs(candidates[:, None] - places) / scale
    loss = (apart / (1.0 + apart)).sum(axis=2) @ weights
    return np.asarray(candidates[int(np.argmin(loss))])


def one_errors(off: Float64, weights: Float64) -> Float64:
    """Errors (P,) that hold as much of deviations (N, P) by weights (N,) as a normal one does."""
    errors = []
    for column in abs(off).T:
        order = np.argsort(column, kind="stable")
        at = int(np.searchsorted(np.cumsum(weights[order]), _ONE_ERROR))
        errors.append(column[order[min(at, len(order) - 1)]])
    return np.array(errors)
