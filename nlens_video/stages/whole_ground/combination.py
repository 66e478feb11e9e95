"""What tells a lens beside the whole ground, and what that tells, combined by their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.known_lens import LensPrior
from nlens_video.core.layers import Float64
from nlens_video.core.lens_fit import LensFit, Sign
from nlens_video.stages.texture.ground_lens import GroundLens

_CONFLICT = 9.0  # squared distance in errors from which on one of them is wrong
_SHARP_PX = 1.0  # CoC below which either sign makes the same picture
_UNKNOWN_PX = 1e4  # standard error of a CoC that counts for nothing


class _Combined(Struct, frozen=True, eq=False):
    """Slope and intercept (2,), their covariance (2, 2), and what speaks against them."""

    lens: Float64
    covariance: Float64
    against: float


def combined(
    fit: LensFit, own: Sequence[GroundLens], by_ground: Sequence[GroundLens], middle: float,
    source: str,
) -> LensFit | None:  # fmt: skip
    """The lens by both, None where they contradict each other or no lens is between them.

    Where either leaves several lenses open, the two that agree best are combined, and the others
    count as errors by their likelihood.

    Args:
        fit: by the readings. Where its sign is assumed, the lens is on the same side.
        own: lenses that tell of it beside the ground.
        by_ground: lenses by the whole ground, in pixels of the same frame.
        middle: disparity of the ground where the object stands [1 / scene unit].
        source: of these lenses, in words.
    """
    at_object = np.array([middle, 1.0])
    pairs = sorted(
        (pair for one in by_ground for lens in own if (pair := _combined(lens, one)) is not None),
        key=lambda pair: pair.against,
    )
    likely = pairs
    if fit.sign == "assumed":
        given = np.sign(_lens(fit) @ at_object)
        likely = [pair for pair in pairs if np.sign(pair.lens @ at_object) == given]
    if not likely:
        return None
    best = likely[0]
    weights = [math.exp(-0.5 * (pair.against - best.against)) for pair in likely]
    spreads = [
        pair.covariance + np.outer(pair.lens - best.lens, pair.lens - best.lens) for pair in likely
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
    if sign != "resolved":
        by_fit = [_lens(fit), *([] if fit.other is None else [np.array(fit.other)])]
        side = np.sign(best.lens @ at_object)
        for lens in (*(pair.lens for pair in pairs), *by_fit):
            if np.sign(lens @ at_object) != side:
                whole = replace(whole, other=(float(lens[0]), float(lens[1])))
                break
    return replace(whole, sign=sign, sign_margin=margin)


def lenses_of_fit(fit: LensFit) -> tuple[GroundLens, ...]:
    """The lens of a fit, and the one of the other sign where it leaves that open, in its pixels."""
    errors = np.array([fit.slope_stderr, fit.intercept_stderr])
    correlation = np.array([[1.0, fit.correlation], [fit.correlation, 1.0]])
    covariance = np.outer(errors, errors) * correlation
    return tuple(
        GroundLens(slope=slope, intercept=intercept, covariance=covariance)
        for slope, intercept in (
            (fit.slope, fit.intercept),
            *([] if fit.other is None else [fit.other]),
        )
    )


def lens_beforehand(known: LensPrior, fit: LensFit, middle: float) -> GroundLens:
    """What is known of the lens beforehand, in pixels of the fit's frame.

    What is not known has an error of `_UNKNOWN_PX`, and so no weight.

    Args:
        known: perhaps nothing.
        fit: its slope turns the error of the focus into one of the CoC.
        middle: disparity of the ground where the object stands [1 / scene unit].
    """
    open_ = np.diag([(middle / _UNKNOWN_PX) ** 2, _UNKNOWN_PX**-2])
    equations = np.array(known.equations(fit.slope)).reshape(-1, 3)
    rows, told = equations[:, :2], equations[:, 2]
    covariance = np.asarray(np.linalg.inv(rows.T @ rows + open_), np.float64)
    slope, intercept = covariance @ (rows.T @ told + open_ @ _lens(fit))
    return GroundLens(slope=float(slope), intercept=float(intercept), covariance=covariance)


def _lens(fit: LensFit) -> Float64:
    """Slope and intercept (2,)."""
    return np.array([fit.slope, fit.intercept])


def _combined(own: GroundLens, by_ground: GroundLens) -> _Combined | None:
    """The lens by both, None where they contradict each other or it is none."""
    lens = np.array([own.slope, own.intercept])
    other = np.array([by_ground.slope, by_ground.intercept])
    apart = lens - other
    distance = float(apart @ np.linalg.pinv(own.covariance + by_ground.covariance) @ apart)
    if distance > _CONFLICT:
        return None
    of_own, of_ground = np.linalg.pinv(own.covariance), np.linalg.pinv(by_ground.covariance)
    covariance = np.asarray(np.linalg.pinv(of_own + of_ground))
    whole = np.asarray(covariance @ (of_own @ lens + of_ground @ other))
    if whole[0] <= 0.0 or whole[1] > 0.0:
        return None
    return _Combined(whole, covariance, distance + by_ground.unlikelier)


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
