"""Search for the lenses by which the ground's texture looks alike at all depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.stages.texture.law import TextureLaw, Unknowns
from nlens_video.stages.texture.solver import Bands, Solution, TextureSolver
from nlens_video.stages.texture.spectra import Bins, Spectra

_BANDS = 10  # parts of the ground, by disparity
_STARTS, _CANDIDATES = 8, 8  # of the solver; minima that are looked at more closely
_ROUNDS = 2  # of weighing the patches
_UNEVEN = 0.15  # variance of the log power between patches of one ground
_BRIGHTER = 0.7  # deviation of the log contrast between them
_BOUND = 3.0  # squared errors of a patch beyond it do not tell one lens from another
_APART_PX, _APART, _STEEPER = 1.0, 0.1, 1.7  # from one start of the solver to another
_SAME_PX = 0.3  # at the object and at infinity, within which two minima are one

Lens = tuple[float, float]
"""Slope [px * scene unit] and intercept [px]."""


class Candidate(Struct, frozen=True, kw_only=True, eq=False):
    """A lens and the patches that look alike by it.

    Attributes:
        solver: of the bands of these patches.
        solution: its minimum.
        weight: of the patches, 1 for those that look alike and are near, to 0 (P,).
        off: summed squared errors of all patches by the law, bounded for each.
    """

    solver: TextureSolver
    solution: Solution
    weight: Float64
    off: float


def find_candidates(
    bins: Bins, patches: Spectra, near: Float64, begin: Sequence[Lens]
) -> list[Candidate]:
    """Lenses, the one by which most of the ground looks alike first.

    Each minimum has its own patches that look alike by it, so all are compared by all patches.

    Args:
        bins: of the spectra.
        patches: of the ground, in units in which the disparity is 1 where the object stands.
        near: weights of the patches beforehand (P,).
        begin: lenses that are looked at beside a grid.
    """
    solver = TextureSolver(bins, _bands(bins, patches, near))
    starts = [*begin, *_apart(solver.scan())]
    minima = sorted((solver.solve(*lens) for lens in starts), key=lambda one: one.cost)
    found = []
    for minimum in _distinct(minima)[:_CANDIDATES]:
        one = _candidate(bins, patches, near, solver, minimum)
        for _ in range(_ROUNDS):
            again = TextureSolver(bins, _bands(bins, patches, one.weight))
            lens = one.solution.unknown
            solution = again.solve(lens.slope, lens.intercept)
            one = _candidate(bins, patches, near, again, solution)
        found.append(one)
    found.sort(key=lambda one: one.off)
    kept = _distinct([one.solution for one in found])
    return [one for one in found if any(one.solution is solution for solution in kept)]


def _candidate(
    bins: Bins, patches: Spectra, near: Float64, solver: TextureSolver, solution: Solution
) -> Candidate:
    """A minimum of bands, by all patches."""
    squared = _squared_errors(bins, patches, solver, solution.unknown)
    bounded = squared / (1.0 + squared / _BOUND)
    return Candidate(
        solver=solver,
        solution=solution,
        weight=near / (1.0 + np.square(np.maximum(squared - 1.0, 0.0))) ** 2,
        off=float(near @ bounded) * len(bins.cells),
    )


def _squared_errors(
    bins: Bins, patches: Spectra, solver: TextureSolver, unknown: Unknowns
) -> Float64:
    """Mean squares of what patches are off by the law, in expected errors (P,)."""
    law = TextureLaw(bins, patches, solver.law.knots)
    bands = solver.law.disparity
    gain, noise = (
        np.interp(patches.disparity, bands, values) for values in (unknown.gain, unknown.noise)
    )
    seen = law.seen(unknown, law.texture(unknown.spectrum), gain)
    whole = np.logaddexp(seen, (unknown.common_noise + noise)[:, None])
    left = patches.log_power + bins.log_bias - whole
    counts = 1.0 / (bins.log_variance + _UNEVEN)
    brighter = (left @ counts) / (counts.sum() + 1.0 / _BRIGHTER**2)
    squares = np.square(left - brighter[:, None]) @ counts + np.square(brighter / _BRIGHTER)
    return np.asarray(squares / len(counts))


def _bands(bins: Bins, patches: Spectra, weight: Float64) -> Bands:
    """Weighted means of the patches, by disparity."""
    parts = np.array_split(np.argsort(patches.disparity, kind="stable"), _BANDS)
    count, bin_count = len(parts), patches.log_power.shape[1]
    disparity, worth, stretch = np.empty(count), np.empty(count), np.empty((count, 2, 2))
    mean, variance = np.empty((count, bin_count)), np.empty((count, bin_count))
    for band, part in enumerate(parts):
        counts = weight[part] + 1e-6
        worth[band] = counts.sum()
        share = counts / worth[band]
        disparity[band] = share @ patches.disparity[part]
        stretch[band] = np.tensordot(share, patches.stretch[part], 1)
        mean[band] = share @ patches.log_power[part]
        spread = share @ np.square(patches.log_power[part] - mean[band])
        # where few look alike they may do so by chance: such a band counts less than they do
        effective = worth[band] / len(part) / np.square(share).sum()
        variance[band] = np.maximum(spread, bins.log_variance + _UNEVEN) / effective
    spectra = Spectra(disparity=disparity, stretch=stretch, log_power=mean)
    return Bands(spectra=spectra, error=np.sqrt(variance), patches=worth)


def _apart(lenses: Sequence[Lens]) -> list[Lens]:
    """The first lenses that differ in the CoC at the object or in slope."""
    kept: list[Lens] = []
    for slope, intercept in lenses:
        coc = slope + intercept
        near = _APART_PX + _APART * abs(coc)
        if all(
            abs(coc - (one + other)) > near or not 1.0 / _STEEPER < slope / one < _STEEPER
            for one, other in kept
        ):
            kept.append((slope, intercept))
        if len(kept) == _STARTS:
            break
    return kept


def _distinct(solutions: Sequence[Solution]) -> list[Solution]:
    """Without those that are the same lens as one before."""
    kept: list[Solution] = []
    for one in solutions:
        lens = one.unknown
        for other in kept:
            steeper = lens.slope - other.unknown.slope
            blurrier = steeper + lens.intercept - other.unknown.intercept
            if abs(steeper) < _SAME_PX and abs(blurrier) < _SAME_PX:
                break
        else:
            kept.append(one)
    return kept
