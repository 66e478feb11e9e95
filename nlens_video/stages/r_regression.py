"""R: the linear lens model from the plate's CoC and the ground's disparity (paper, section 4.2).

The paper turns the estimated, unsigned CoC into a signed one by a rule and fits a least-squares
line on the footprint. Here the V itself is fitted, both sign branches competing (`r_robust_v`). The
whole ground plane takes part under a robust loss that rejects what stands on it; the footprint,
where virtual and real ground coincide for certain, is the anchor.

The network gives the posterior median of the CoC, which shrinks towards the training mean where a
picture holds little evidence. That is right for one pixel, but a line through thousands of shrunken
values is too flat, so the training prior is divided out of the samples first.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import NO_PRIOR, LensPrior
from nlens_video.core.layers import CocMap, Float64
from nlens_video.core.lens_fit import LensFit, Sign
from nlens_video.core.placement import Region
from nlens_video.stages.f_coc import LARGEST_COC_PX
from nlens_video.stages.p_projection import GroundProjection, ground_visibility
from nlens_video.stages.r_robust_v import INDEPENDENT, VCandidate, VFit, add_unresolved_covariance
from nlens_video.stages.r_samples import (
    LARGEST_AT_INFINITY,
    FitSamples,
    inside,
    joined,
    sample_plane,
)
from nlens_video.stages.whole_ground.evidence import Within, combined_with_ground
from nlens_video.stages.whole_ground.network_reading import LensNetwork

RESOLVED_MARGIN = 0.5  # above 1 never wrong on 135 rendered plates, below 1 in four of ten
UNSURE_PX = 8.0  # an expected error above this, and above the estimate itself, is no evidence
_FLAT = 0.9  # of the largest CoC: an expected error beyond it is that of a plain area
_AGREEING = 0.25  # of the footprint, left by the loss: half of it or more is off by two errors
_FIRM_ANCHOR = 1.0  # the footprint against the rest, where it has been outvoted


class Regression(Struct, frozen=True, kw_only=True):
    """The fit and its samples."""

    fit: LensFit
    samples: FitSamples


class FitLens(Struct, frozen=True, kw_only=True):
    """R as a stage.

    Attributes:
        anchor_weight: weight of the footprint as a whole against the rest of the plane [1].
        whole_plane: fit on everything the plane covers, or (as the paper) on the footprint alone.
        region: part of the frame outside of which nothing is fitted on; None for all of it.
        network: reads the lens off the whole ground where the readings are not sure, None for none.
    """

    anchor_weight: float = 0.1
    whole_plane: bool = True
    region: Region | None = None
    network: LensNetwork | None = None

    def __call__(
        self, coc: CocMap, ground: GroundProjection, frame: int = 0, known: LensPrior = NO_PRIOR,
        others: Sequence[FitSamples] = (), *, with_whole_ground: bool = True,
    ) -> Regression:  # fmt: skip
        """Fit the lens on one frame.

        Args:
            coc: the plate's CoC (H, W).
            ground: footprint and plane on the same frame.
            frame: index of that frame, kept in the fit.
            known: of the lens beforehand, combined with the plate by its errors.
            others: samples of other frames of a moving camera, which see other ground.
            with_whole_ground: also by the ground as a whole, where the readings are not sure.

        Raises:
            LensFitError: the plane is not in view, or shows no blur.
        """
        samples = self.samples(coc, ground)
        if others:
            samples = joined([samples, *others])
        where = (
            self._where(samples)
            + (f", mean of {coc.frames} frames" if coc.frames > 1 else "")
            + (f", {1 + len(others)} frames of a moving camera" if others else "")
        )
        size = coc.coc_px.shape[1], coc.coc_px.shape[0]
        found, readings = self._regress(samples, size, where, frame, known, INDEPENDENT)
        both = None
        if with_whole_ground and self.whole_plane:
            both = combined_with_ground(
                found.fit, coc, ground.camera, ground.ground_y, samples.middle,
                known=known, network=None if _flat(coc, samples) else self.network,
                within=self._within(),
            )  # fmt: skip
            if both is not None and _tells(both, both.coc_stderr_px(samples.middle), samples):
                return replace(found, fit=both)
        _check(found.fit, readings, samples)
        return found if both is None else replace(found, fit=both)

    def of_samples(
        self, samples: FitSamples, size: tuple[int, int], where: str, frame: int = 0,
        known: LensPrior = NO_PRIOR, independent: float = INDEPENDENT,
    ) -> Regression:  # fmt: skip
        """Fit the lens on samples of a frame.

        Args:
            samples: of it.
            size: its columns and rows [px].
            where: what the samples are of, in words.
            frame: its index, kept in the fit.
            known: of the lens beforehand, combined with the samples by its errors.
            independent: how many independent samples they are worth [1].

        Raises:
            LensFitError: they show no blur, or do not tell it.
        """
        found, readings = self._regress(samples, size, where, frame, known, independent)
        _check(found.fit, readings, samples)
        return found

    def _regress(
        self, samples: FitSamples, size: tuple[int, int], where: str, frame: int,
        known: LensPrior, independent: float,
    ) -> tuple[Regression, Float64]:  # fmt: skip
        """As `of_samples`, told or not, and the covariance of the readings alone (2, 2)."""
        width, height = size
        problem, lens = self._solved(samples, width, known)
        if lens is None:
            raise LensFitError(
                "the plate shows no blur on the ground under the object; give --fit FILE.json, "
                "--effects none, or --fallback constant"
            )
        readings = problem.covariance(lens, samples.cluster, independent)
        sign, margin = _sign(problem, lens, float(np.sqrt(readings[0, 0])))
        usual = None
        if known.usual_slope is not None:
            # a scene that is not in metres has lenses in use that no frame could show
            most = LARGEST_AT_INFINITY * width / max(samples.middle, 1e-300)
            usual = min(known.usual_slope, most), samples.middle
            if sign == "resolved":
                whole = add_unresolved_covariance(readings, lens, None, 0.0, *usual)
                if lens.slope < 2.0 * np.sqrt(whole[0, 0]):
                    sign = "ambiguous"
        other = problem.of_other_sign(lens) if sign == "ambiguous" else None
        if other is not None and known.prefer is not None:
            sign = "assumed"
            if (lens.focus > other.focus) != (known.prefer == "near"):
                lens, other, margin = other, lens, 0.0
                readings = problem.covariance(lens, samples.cluster, independent)
        covariance = readings
        if usual is not None:
            chance = 0.5 * max(0.0, 1.0 - margin / RESOLVED_MARGIN) if sign == "ambiguous" else 0.0
            covariance = add_unresolved_covariance(readings, lens, other, chance, *usual)
        weight = problem.inlier_weight(lens)
        error = lens.slope * np.abs(samples.disparity - lens.focus) - samples.coc_px
        stderr = np.sqrt(np.diag(covariance))
        fit = LensFit(
            slope=lens.slope,
            intercept=-lens.slope * lens.focus,
            slope_stderr=float(stderr[0]),
            intercept_stderr=float(stderr[1]),
            correlation=float(covariance[0, 1] / max(stderr[0] * stderr[1], 1e-300)),
            rmse_px=float(np.sqrt(np.average(error**2, weights=weight + 1e-12))),
            n=len(error),
            inlier_fraction=float(np.mean(weight > 0.25)),
            width=width,
            height=height,
            frame=frame,
            readings_share=_part(readings, covariance, samples.middle),
            sign=sign,
            sign_margin=margin,
            other=None if other is None else (other.slope, -other.slope * other.focus),
            method=f"robust V-fit over {where}"
            + (f", with {known.source}" if known.in_numbers else ""),
            ground_seen=ground_visibility(
                samples.disparity, samples.coc_px, samples.sigma_px, np.abs(error + samples.coc_px)
            ),
        )
        return Regression(fit=fit, samples=replace(samples, weight=weight)), readings

    def samples(self, coc: CocMap, ground: GroundProjection) -> FitSamples:
        """The samples of one frame, of which `others` holds some; arguments as of a fit.

        Raises:
            LensFitError: the plane is not in view.
        """
        return sample_plane(coc, ground, whole_plane=self.whole_plane, region=self.region)

    def _solved(
        self, samples: FitSamples, width: int, known: LensPrior
    ) -> tuple[VFit, VCandidate | None]:
        """The problem and its solution; the footprint, unlike the plane, cannot be outvoted."""
        problem = samples.problem(self.anchor_weight, width, known)
        lens = problem.solve()
        if lens is None or _agreeing(problem, lens, samples) >= _AGREEING:
            return problem, lens
        anchored = samples.problem(_FIRM_ANCHOR, width, known)
        other = anchored.solve()
        if other is None or _agreeing(anchored, other, samples) < _AGREEING:
            return problem, lens
        return anchored, other

    def _within(self) -> Within | None:
        """Whether places, by the frame's size, lie in the region."""
        return None if (region := self.region) is None else partial(inside, region)

    def _where(self, samples: FitSamples) -> str:
        if self.region is not None:
            return "the ground in the given region"
        if not self.whole_plane:
            return "the footprint"
        if not samples.anchor.any():
            return "the ground plane without a footprint in view"
        return "the whole ground plane, anchored by the footprint"


def _agreeing(problem: VFit, lens: VCandidate, samples: FitSamples) -> float:
    """Mean weight of the footprint's samples under the loss, 0 to 1; 1 where there are none."""
    anchor = samples.anchor
    return float(problem.inlier_weight(lens)[anchor].mean()) if anchor.any() else 1.0


def _sign(problem: VFit, lens: VCandidate, slope_stderr: float) -> tuple[Sign, float]:
    """Whether the data resolve the side of the focus on which the object's ground lies."""
    if lens.slope < 2.0 * slope_stderr:  # one blur at all depths: either sign makes it
        return "ambiguous", 0.0
    if abs(problem.coc_at_median(lens)) < 1.0:
        return "resolved", 1.0  # in focus there: either sign makes the same picture
    margin = problem.sign_margin(lens)
    return ("resolved" if margin >= RESOLVED_MARGIN else "ambiguous"), float(min(margin, 1e6))


def _part(readings: Float64, whole: Float64, disparity: float) -> float:
    """Standard error of the CoC at a disparity of the readings by that of the whole, 0 to 1."""
    return min(1.0, _error(readings, disparity) / max(_error(whole, disparity), 1e-150))


def _error(covariance: Float64, disparity: float) -> float:
    """Standard error of the CoC at a disparity [px]."""
    there = np.array([disparity, 1.0])
    return float(np.sqrt(there @ covariance @ there))


def _tells(fit: LensFit, error: float | Float64, samples: FitSamples) -> bool:
    """Whether a fit with an error of the CoC [px] tells the blur where the object stands."""
    return bool(error <= max(3.0, 0.5 * abs(fit.slope * samples.middle + fit.intercept)))


def _expected_px(samples: FitSamples) -> float:
    """Expected error of the readings where the object stands [px]."""
    use = samples.anchor if samples.anchor.any() else np.ones_like(samples.anchor)
    return float(np.median(samples.sigma_px[use]))


def _flat(coc: CocMap, samples: FitSamples) -> bool:
    """Whether the plate has no contrast, of which a blur could be read, where the object stands."""
    width = coc.coc_px.shape[1] if coc.luma is None else coc.luma.shape[1]
    largest = LARGEST_COC_PX * coc.coc_px.shape[1] / width
    return bool(_expected_px(samples) > _FLAT * largest)


def _check(fit: LensFit, readings: Float64, samples: FitSamples) -> None:
    """Refuse a fit on readings that do not determine the blur where the object stands."""
    error, expected = _error(readings, samples.middle), _expected_px(samples)
    blur = abs(fit.slope * samples.middle + fit.intercept)
    unsure = expected > max(UNSURE_PX, blur)
    if unsure or fit.inlier_fraction < 0.1 or not _tells(fit, error, samples):
        raise LensFitError(
            f"the ground under the object does not tell the blur (CoC {blur:.1f} px, standard "
            f"error {error:.1f} px, {fit.inlier_fraction:.0%} of {fit.n} samples agree, expected "
            f"error {expected:.1f} px); give --fallback constant for the plate's usual blur, "
            "--fit FILE.json, or place it elsewhere (--at, --ground-y)"
        )
