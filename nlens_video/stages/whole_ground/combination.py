"""A lens by F's readings and the one by the whole ground, combined by their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Float64
from nlens_video.core.lens_fit import LensFit, Sign
from nlens_video.stages.texture.ground_lens import GroundLens

_CONFLICT = 9.0  # squared distance in errors from which on one of them is wrong
_SHARP_PX = 1.0  # CoC below which either sign makes the same picture


class _Combined(Struct, frozen=True, eq=False):
    """Slope and intercept (2,), their covariance (2, 2), and what speaks against them."""

    lens: Float64
    covariance: Float64
    against: float


def combined(
    fit: LensFit, by_ground: Sequence[GroundLens], middle: float, source: str
) -> LensFit | None:
    """The lens by both, None where they contradict each other or no lens is between them.

    Where the readings or the ground leave several lenses open, the two that agree best are
    combined, and the others count as errors by their likelihood.

    Args:
        fit: by the readings.
        by_ground: lenses by the whole ground, in pixels of the same frame.
        middle: disparity of the ground where the object stands [1 / scene unit].
        source: of these lenses, in words.
    """
    lenses = [np.array([fit.slope, fit.intercept])]
    if fit.other is not None:
        lenses.append(np.array(fit.other))
    own = _covariance(fit)
    pairs = [
        pair
        for one in by_ground
        for lens in lenses
        if (pair := _combined(lens, own, one)) is not None
    ]
    at_object = np.array([middle, 1.0])
    if fit.sign == "assumed":  # the side is given
        side = np.sign(lenses[0] @ at_object)
        pairs = [pair for pair in pairs if np.sign(pair.lens @ at_object) == side]
    if not pairs:
        return None
    best = min(pairs, key=lambda pair: pair.against)
    weights = [math.exp(-0.5 * (pair.against - best.against)) for pair in pairs]
    spreads = [
        pair.covariance + np.outer(pair.lens - best.lens, pair.lens - best.lens) for pair in pairs
    ]
    covariance = np.average(spreads, axis=0, weights=weights)
    errors = np.sqrt(np.diag(covariance))
    whole = replace(
        fit,
        slope=float(best.lens[0]),
        intercept=float(best.lens[1]),
        slope_stderr=float(errors[0]),
        intercept_stderr=float(errors[1]),
        correlation=float(covariance[0, 1] / max(errors[0] * errors[1], 1e-300)),
        readings_share=1.0,
        other=None,
        method=f"{fit.method}, with {source}",
    )
    sign, margin = _sign(whole, fit, middle)
    if sign == "ambiguous":
        side = np.sign(best.lens @ at_object)
        ranked = [pair.lens for pair in sorted(pairs, key=lambda pair: pair.against)]
        beyond = [lens for lens in (*ranked, *lenses) if np.sign(lens @ at_object) != side]
        if beyond:
            whole = replace(whole, other=(float(beyond[0][0]), float(beyond[0][1])))
    return replace(whole, sign=sign, sign_margin=margin)


def _combined(lens: Float64, own: Float64, by_ground: GroundLens) -> _Combined | None:
    """A lens by the readings and one by the ground, None where they are no lens together."""
    other = np.array([by_ground.slope, by_ground.intercept])
    apart = lens - other
    distance = float(apart @ np.linalg.pinv(own + by_ground.covariance) @ apart)
    if distance > _CONFLICT:
        return None
    of_readings, precision = np.linalg.pinv(own), np.linalg.pinv(by_ground.covariance)
    covariance = np.asarray(np.linalg.pinv(of_readings + precision))
    whole = np.asarray(covariance @ (of_readings @ lens + precision @ other))
    if whole[0] <= 0.0 or whole[1] > 0.0:
        return None
    return _Combined(whole, covariance, distance + by_ground.unlikelier)


def _covariance(fit: LensFit) -> Float64:
    """Of slope and intercept (2, 2)."""
    errors = np.array([fit.slope_stderr, fit.intercept_stderr])
    correlation = np.array([[1.0, fit.correlation], [fit.correlation, 1.0]])
    return np.asarray(np.outer(errors, errors) * correlation)


def _sign(whole: LensFit, fit: LensFit, middle: float) -> tuple[Sign, float]:
    """Whether both together tell on which side of the focus the object's ground lies, and margin.

    The margin is the squared CoC there by three times its error. What the readings resolve stays
    so on the same side.
    """
    if fit.sign == "assumed":
        return "assumed", fit.sign_margin
    if not whole.depends_on_depth:
        return "ambiguous", 0.0
    coc, error = whole.slope * middle + whole.intercept, float(whole.coc_stderr_px(middle))
    margin = 1.0 if abs(coc) < _SHARP_PX else (coc / (3.0 * error)) ** 2
    if fit.sign == "resolved" and coc * (fit.slope * middle + fit.intercept) > 0.0:
        return "resolved", max(margin, fit.sign_margin)
    return ("resolved" if margin >= 1.0 else "ambiguous"), margin
