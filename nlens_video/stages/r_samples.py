"""Samples of the lens fit: where the plate's CoC and the ground's disparity are both known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import NO_PRIOR, LensPrior
from nlens_video.core.layers import Bool, CocMap, CocPrior, Float64
from nlens_video.core.placement import Region
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_robust_v import VFit

GRID_COLUMNS = 240  # samples across the frame: the estimate has no finer detail than that
MIN_SAMPLES = 48
FLOOR_PX = 0.3  # least expected error of an estimate
LARGEST_AT_INFINITY = 0.1  # CoC at infinity by the width of the frame: 85 mm f/1.8 at 0.9 m
_FARTHEST_SHARE = 0.02  # ground farther than 1 / this times the footprint's distance is left out
_CLUSTER_SAMPLES = 8  # errors of neighbours are alike: standard errors count clusters, not pixels
_MOST_SHRUNK = 0.8  # a posterior this wide, as a share of the prior's width, holds no evidence
_LAPLACE = math.sqrt(2.0)  # deviation of a Laplace distribution by its mean absolute error


class FitSamples(Struct, frozen=True, kw_only=True):
    """Samples of the fit, for plots and checks; all arrays (N,).

    Attributes:
        disparity: of the ground plane [1 / scene unit].
        coc_px: unsigned diameter, without the training prior [px].
        sigma_px: its expected error [px].
        anchor: whether the sample lies in the footprint.
        weight: of the robust loss, 0 to 1 [1].
        cluster: number of the patch of the frame that it belongs to.
    """

    disparity: Float64
    coc_px: Float64
    sigma_px: Float64
    anchor: Bool
    weight: Float64
    cluster: npt.NDArray[np.int64]

    @property
    def middle(self) -> float:
        """Median disparity of the footprint, of the plane where there is none."""
        return float(
            np.median(self.disparity[self.anchor] if self.anchor.any() else self.disparity)
        )

    def problem(self, anchor_weight: float, width: int, known: LensPrior = NO_PRIOR) -> VFit:
        """The robust fit of these samples on a frame of some width [px], with what is known.

        `anchor_weight` is that of the footprint as a whole against the rest of the plane [1].
        Ground beyond the footprint counts less with the square of the distance: the farther, the
        likelier it is no longer the plane on which the object stands.
        """
        share = np.minimum(self.disparity / self.middle, 1.0) ** 2
        share /= share.sum()
        if self.anchor.any():
            share = share + anchor_weight * self.anchor / self.anchor.sum()
        error = np.hypot(self.sigma_px, FLOOR_PX)
        infinity_px = LARGEST_AT_INFINITY * width
        return VFit(self.disparity, self.coc_px, error, share / share.sum(), infinity_px, known)


def joined(parts: Sequence[FitSamples]) -> FitSamples:
    """Samples of several frames; patches of different frames err apart."""
    patches = np.cumsum([0, *(int(part.cluster.max()) + 1 for part in parts)])
    moved = [
        replace(part, cluster=part.cluster + int(first))
        for part, first in zip(parts, patches, strict=False)
    ]
    names = FitSamples.__struct_fields__
    return FitSamples(**{n: np.concatenate([getattr(part, n) for part in moved]) for n in names})


def sample_plane(
    coc: CocMap, ground: GroundProjection, *, whole_plane: bool, region: Region | None = None
) -> FitSamples:
    """Samples on a regular grid of the part of the frame that the plane covers.

    Args:
        coc: the plate's CoC (H, W).
        ground: footprint and plane.
        whole_plane: not only of the footprint.
        region: outside of which there is none; None for the whole frame.

    Raises:
        LensFitError: too few are in view.
    """
    height, width = coc.coc_px.shape
    step = max(1, round(width / GRID_COLUMNS))
    if not whole_plane:  # a footprint can be a handful of pixels
        step = max(1, min(step, int(np.sqrt(max(ground.mask.sum(), 1) / MIN_SAMPLES))))
    if region is not None:
        step = max(1, min(step, int(np.sqrt(_area(region) * width * height / MIN_SAMPLES) / 2)))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    disparity = ground.disparity_of(columns[0], rows[:, 0])
    anchor = ground.mask[rows, columns]
    values, sigma = coc.coc_px[rows, columns], coc.sigma_px[rows, columns]
    use = np.isfinite(values) & np.isfinite(sigma) & (disparity > 0)
    if not whole_plane:
        use &= anchor
    elif anchor.any():
        use &= disparity > _FARTHEST_SHARE * np.median(disparity[anchor])
    where = "view"
    if region is not None:
        use &= inside(region, (columns + 0.5) / width, (rows + 0.5) / height)
        where = "the region of --fit-region"
    if use.sum() < MIN_SAMPLES:
        raise LensFitError(
            f"only {int(use.sum())} samples of the ground plane y = {ground.ground_y:g} are in "
            f"{where}, {MIN_SAMPLES} are needed; check --ground-y and the camera, or give "
            "--fit FILE.json or --fallback constant"
        )
    patch = step * _CLUSTER_SAMPLES
    debiased, error = values[use].astype(np.float64), sigma[use].astype(np.float64)
    if coc.prior is not None:
        debiased, error = remove_prior(debiased, error, coc.prior)
    return FitSamples(
        disparity=disparity[use].astype(np.float64),
        coc_px=debiased,
        sigma_px=error,
        anchor=anchor[use],
        weight=np.ones(int(use.sum())),
        cluster=((rows // patch) * width + columns // patch)[use].astype(np.int64),
    )


def inside(region: Region, columns: Float64, rows: Float64) -> Bool:
    """Whether points lie in a region: an even number of its edges to their right, or an odd one.

    Args:
        region: a polygon.
        columns: of the points, any shape [frame width].
        rows: of the points, of that shape [frame height].
    """
    found = np.zeros(np.shape(columns), bool)
    for (x0, y0), (x1, y1) in _edges(region):
        if y0 != y1:
            crossed = (y0 <= rows) != (y1 <= rows)
            found ^= crossed & (columns < x0 + (rows - y0) * ((x1 - x0) / (y1 - y0)))
    return found


def _area(region: Region) -> float:
    """Share of the frame [1]."""
    return 0.5 * abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in _edges(region)))


def _edges(region: Region) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    corners = region.corners
    return list(zip(corners, (*corners[1:], corners[0]), strict=True))


def remove_prior(coc_px: Float64, sigma_px: Float64, prior: CocPrior) -> tuple[Float64, Float64]:
    """Divide the training prior out of posterior estimates.

    Prior and posterior are about normal in log(1 + CoC), so precisions subtract, as do means
    weighted by them.

    Args:
        coc_px: estimated unsigned CoC diameter (N,) [px of the frame].
        sigma_px: its expected absolute error (N,) [px of the frame].
        prior: distribution of CoC in training.

    Returns:
        Diameter and expected absolute error (N,) of the likelihood alone [px of the frame].
    """
    coc, sigma = coc_px / prior.scale, sigma_px / prior.scale
    wide = _LAPLACE * sigma / (1 + coc)
    share = np.minimum(wide / prior.deviation, _MOST_SHRUNK) ** 2
    log_coc = np.log1p(coc)
    log_coc = log_coc + (log_coc - prior.mean) * share / (1 - share)
    debiased = np.expm1(np.maximum(log_coc, 0.0))
    error = sigma * (1 + debiased) / (1 + coc) / np.sqrt(1 - share)
    return debiased * prior.scale, error * prior.scale
