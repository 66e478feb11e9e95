"""What the texture of the ground tells of the lens, and how sure.

F reads the blur place by place. It takes a pattern that is soft in itself for a blurred one, fine
grain for a sharp one, and noise on a plain ground for sharpness. But a ground shows much the same
texture everywhere: where it is nearer the pattern is larger, by a law that the camera tells, and
where it is farther from the focal plane it is blurrier, by the lens model. So the whole plane tells
one spectrum and one lens (`law`). Noise that is white, as that of a sensor, is told from texture;
what a codec or a denoiser left is not, and such a picture is not read.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64
from nlens_video.scene.camera import Camera
from nlens_video.stages.texture.law import TextureLaw, Unknowns
from nlens_video.stages.texture.solver import (
    MODEL,
    SOFTNESS,
    USUAL_GAIN,
    USUAL_SOFTNESS_PX,
    Bands,
    Solution,
    TextureSolver,
)
from nlens_video.stages.texture.spectra import Bins, Spectra, fall_of_the_finest, ground_spectra

_FEWEST = 40  # patches
_BANDS, _NOISE_BANDS = 10, 8  # parts of the ground, by disparity
_LEAST_FALL = -0.15  # of the finest detail of the flattest part: below it no noise is white
_ROUNDS, _STARTS = 3, 3  # of weighing the patches; of the solver
_BRIGHTER = 0.7  # deviation of the log contrast within the ground
_APART_PX, _APART, _STEEPER = 1.0, 0.1, 1.7  # from one start of the solver to another
_SAME_PX = 0.3  # at the object and at infinity, within which two minima are one
# stated errors, measured on rendered plates (docs/evaluation/lens-fit.md)
_FINE_COST = 0.25  # by the number of values, of a ground that is alike everywhere
_LEAST_ERROR_PX, _RELATIVE_ERROR = 0.2, 0.05
_READINGS = 2.0  # times the covariance's own errors
_LEVER = 0.5  # of the disparity, over which the CoC errs by as much again
_FLAT, _FLAT_T2 = 6.0, 4.0  # variance grows by a / (b + t^2), t being the slope by its error


class TextureLens(Struct, frozen=True, kw_only=True, eq=False):
    """The lens model by the ground's texture.

    Attributes:
        slope: [px * scene unit].
        intercept: [px].
        covariance: of slope and intercept (2, 2).
        unlikelier: than the likeliest: twice the difference of the logarithms, >= 0 [1].
    """

    slope: float
    intercept: float
    covariance: Float64
    unlikelier: float = 0.0

    def scaled(self, ratio: float) -> TextureLens:
        """For a picture that is wider by a factor."""
        return TextureLens(
            slope=ratio * self.slope,
            intercept=ratio * self.intercept,
            covariance=ratio**2 * self.covariance,
            unlikelier=self.unlikelier,
        )


def read_texture(
    luma: Float32, camera: Camera, ground_y: float, middle: float
) -> tuple[TextureLens, ...]:
    """Lenses that the texture of the ground may have been seen by, the likeliest first.

    None where the picture shows no texture, or noise that is not white.

    Args:
        luma: the picture, display-coded [code value, 0 to 1] (H, W).
        camera: of a picture of this size.
        ground_y: height of the ground [scene unit].
        middle: disparity of the ground where the object stands, > 0 [1 / scene unit].
    """
    bins, patches = ground_spectra(luma, camera, ground_y)
    if len(patches.disparity) < _FEWEST:
        return ()
    parts = np.array_split(np.argsort(patches.disparity, kind="stable"), _NOISE_BANDS)
    if max(fall_of_the_finest(bins, patches.log_power[part]) for part in parts) < _LEAST_FALL:
        return ()
    # the farther the ground, the likelier it is no longer the plane on which the object stands
    near = np.minimum(patches.disparity / middle, 1.0) ** 2
    solver, found = _solve(bins, patches, near, middle)
    return tuple(
        TextureLens(
            slope=one.unknown.slope,
            intercept=one.unknown.intercept,
            covariance=_stated_covariance(one, solver, middle),
            unlikelier=(one.cost - found[0].cost) / _READINGS**2,
        )
        for one in found
    )


def _solve(
    bins: Bins, patches: Spectra, near: Float64, middle: float
) -> tuple[TextureSolver, list[Solution]]:
    """Likely lenses, once what does not look like the rest of the ground counts little."""
    weight = near
    solver = TextureSolver(bins, _bands(bins, patches, weight))
    found = _minima(solver, _apart(solver.scan(), middle))
    for turn in range(1, _ROUNDS):
        weight = near * _likeness(bins, patches, solver, found[0].unknown)
        solver = TextureSolver(bins, _bands(bins, patches, weight))
        starts = [(found[0].unknown.slope, found[0].unknown.intercept)]
        if turn == _ROUNDS - 1:
            starts += _apart(solver.scan(), middle)
        found = _minima(solver, starts)
    return solver, [
        one
        for at, one in enumerate(found)
        if not any(_alike(one, other, middle) for other in found[:at])
    ]


def _minima(solver: TextureSolver, starts: list[tuple[float, float]]) -> list[Solution]:
    """Where the solver comes to from some lenses, the least cost first."""
    return sorted((solver.solve(*start) for start in starts), key=lambda one: one.cost)


def _alike(one: Solution, other: Solution, middle: float) -> bool:
    """Whether two minima are the same lens."""
    apart = one.unknown.slope - other.unknown.slope
    place = apart * middle + one.unknown.intercept - other.unknown.intercept
    return abs(place) < _SAME_PX and abs(apart) * middle < _SAME_PX


def _bands(bins: Bins, patches: Spectra, weight: Float64) -> Bands:
    """Weighted means of the patches, by disparity."""
    least = _log_variance(bins) + MODEL
    parts = np.array_split(np.argsort(patches.disparity, kind="stable"), _BANDS)
    count, bin_count = len(parts), patches.log_power.shape[1]
    disparity, worth = np.empty(count), np.empty(count)
    stretch = np.empty((count, 2, 2))
    mean, variance = np.empty((count, bin_count)), np.empty((count, bin_count))
    for band, part in enumerate(parts):
        counts = weight[part] + 1e-6
        worth[band] = counts.sum()
        share = counts / worth[band]
        disparity[band] = share @ patches.disparity[part]
        stretch[band] = np.tensordot(share, patches.stretch[part], 1)
        mean[band] = share @ patches.log_power[part]
        spread = share @ np.square(patches.log_power[part] - mean[band])
        # a band of few good patches is one whose good ones may be by chance
        effective = worth[band] / len(part) / np.square(share).sum()
        variance[band] = np.maximum(spread, least) / effective
    spectra = Spectra(disparity=disparity, stretch=stretch, log_power=mean)
    return Bands(spectra=spectra, error=np.sqrt(variance), patches=worth)


def _likeness(bins: Bins, patches: Spectra, solver: TextureSolver, unknown: Unknowns) -> Float64:
    """Weights of patches (P,), 1 for those that look like the ground by the law, else to 0."""
    law = TextureLaw(bins, patches, solver.law.knots)
    bands = solver.law.disparity
    gain, noise = (
        np.interp(patches.disparity, bands, values) for values in (unknown.gain, unknown.noise)
    )
    seen = law.seen(unknown, law.texture(unknown.spectrum), gain)
    whole = np.logaddexp(seen, (unknown.common_noise + noise)[:, None])
    left = patches.log_power + 0.5 / bins.cells - whole
    counts = 1.0 / (_log_variance(bins) + MODEL)
    brighter = (left @ counts) / (counts.sum() + 1.0 / _BRIGHTER**2)
    squared = np.square(left - brighter[:, None]) @ counts + np.square(brighter / _BRIGHTER)
    excess = np.maximum(squared / len(counts) - 1.0, 0.0)
    return np.asarray(1.0 / (1.0 + np.square(excess)) ** 2)


def _log_variance(bins: Bins) -> Float64:
    """Variance of the logarithm of a mean of independent powers (M,): the trigamma function."""
    count = bins.cells
    return np.asarray(1.0 / count + 0.5 / count**2 + 1.0 / (6.0 * count**3))


def _apart(lenses: list[tuple[float, float]], middle: float) -> list[tuple[float, float]]:
    """The first lenses that differ in CoC or slope."""
    kept: list[tuple[float, float]] = []
    for slope, intercept in lenses:
        place = slope * middle + intercept
        near = _APART_PX + _APART * abs(place)
        if all(
            abs(place - (one * middle + other)) > near
            or not 1.0 / _STEEPER < slope / one < _STEEPER
            for one, other in kept
        ):
            kept.append((slope, intercept))
        if len(kept) == _STARTS:
            break
    return kept


def _stated_covariance(found: Solution, solver: TextureSolver, middle: float) -> Float64:
    """Covariance of slope and intercept with what a ground that is not alike everywhere adds.

    Such a ground shows: values are off, contrasts differ, or the softness is unusual.
    """
    unknown, own = found.unknown, found.covariance
    mean = np.average(unknown.gain, weights=solver.patches)
    uneven = np.average(np.square(unknown.gain - mean), weights=solver.patches)
    gain = math.sqrt(float(uneven)) / USUAL_GAIN
    soft = 0.5 * (unknown.softness - math.log(USUAL_SOFTNESS_PX)) / SOFTNESS
    misfit = max(1.0, found.cost / solver.size / _FINE_COST) ** 1.5
    error = _LEAST_ERROR_PX * misfit * math.sqrt(1.0 + gain**2 + soft**2)
    error = math.hypot(error, _RELATIVE_ERROR * (unknown.slope * middle + unknown.intercept))
    flat = 1.0 + _FLAT / (_FLAT_T2 + unknown.slope**2 / max(own[0, 0], 1e-300))
    # errors of the slope and of the CoC at `middle`, apart
    to_intercept = np.array([[1.0, 0.0], [-middle, 1.0]])
    of_law = np.diag([(error / (_LEVER * middle)) ** 2, error**2])
    return np.asarray(_READINGS**2 * flat * own + to_intercept @ of_law @ to_intercept.T)
