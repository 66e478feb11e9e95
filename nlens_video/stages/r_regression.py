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
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import NO_PRIOR, LensPrior
from nlens_video.core.layers import Bool, CocMap, Float64
from nlens_video.core.lens_fit import LensFit, Sign
from nlens_video.stages.f_coc import remove_prior
from nlens_video.stages.p_projection import GroundProjection, ground_visibility
from nlens_video.stages.r_robust_v import VCandidate, VFit, with_what_is_open

GRID_COLUMNS = 240  # samples across the frame: the estimate has no finer detail than that
MIN_SAMPLES = 48
FLOOR_PX = 0.3  # least expected error of an estimate
RESOLVED_MARGIN = 0.5  # above 1 never wrong on 135 rendered plates, below 1 in four of ten
UNSURE_PX = 8.0  # an expected error above this, and above the estimate itself, is no evidence
_FARTHEST_SHARE = 0.02  # ground farther than 1 / this times the footprint's distance is left out
_LARGEST_AT_INFINITY = 0.1  # CoC at infinity by the width of the frame: 85 mm f/1.8 at 0.9 m
_AGREEING = 0.25  # of the footprint, left by the loss: half of it or more is off by two errors
_FIRM_ANCHOR = 1.0  # the footprint against the rest, where it has been outvoted
_CLUSTER_SAMPLES = 8  # errors of neighbours are alike: standard errors count clusters, not pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSamples:
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
        infinity_px = _LARGEST_AT_INFINITY * width
        return VFit(self.disparity, self.coc_px, error, share / share.sum(), infinity_px, known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """The fit and its samples."""

    fit: LensFit
    samples: FitSamples


@dataclass(frozen=True, slots=True, kw_only=True)
class FitLens:
    """R as a stage.

    Attributes:
        anchor_weight: weight of the footprint as a whole against the rest of the plane [1].
        whole_plane: fit on everything the plane covers, or (as the paper) on the footprint alone.
    """

    anchor_weight: float = 0.1
    whole_plane: bool = True

    def __call__(
        self, coc: CocMap, ground: GroundProjection, frame: int = 0, known: LensPrior = NO_PRIOR,
        others: Sequence[FitSamples] = (),
    ) -> Regression:  # fmt: skip
        """Fit the lens on one frame.

        Args:
            coc: the plate's CoC (H, W).
            ground: footprint and plane on the same frame.
            frame: index of that frame, kept in the fit.
            known: of the lens beforehand, combined with the plate by its errors.
            others: samples of other frames of a moving camera, which see other ground.

        Raises:
            LensFitError: the plane is not in view, or shows no blur.
        """
        samples = self.samples(coc, ground)
        if others:
            samples = _joined([samples, *others])
        problem, lens = self._solved(samples, coc.coc_px.shape[1], known)
        if lens is None:
            raise LensFitError(
                "the plate shows no blur on the ground under the object; give --fit FILE.json, "
                "--effects none, or --fallback constant"
            )
        covariance = problem.covariance(lens, samples.cluster)
        sign, margin = _sign(problem, lens, float(np.sqrt(covariance[0, 0])))
        other = problem.of_other_sign(lens) if sign == "ambiguous" else None
        if other is not None and known.prefer is not None:
            sign = "assumed"
            if (lens.focus > other.focus) != (known.prefer == "near"):
                lens, other = other, lens
                covariance = problem.covariance(lens, samples.cluster)
        readings = covariance
        if known.usual_slope is not None:
            chance = 0.5 * max(0.0, 1.0 - margin / RESOLVED_MARGIN) if sign == "ambiguous" else 0.0
            # a scene that is not in metres has lenses in use that no frame could show
            most = _LARGEST_AT_INFINITY * coc.coc_px.shape[1] / max(samples.middle, 1e-300)
            usual = min(known.usual_slope, most), samples.middle
            covariance = with_what_is_open(readings, lens, other, chance, *usual)
            if sign == "resolved" and lens.slope < 2.0 * np.sqrt(covariance[0, 0]):
                sign = "ambiguous"
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
            width=coc.coc_px.shape[1],
            height=coc.coc_px.shape[0],
            frame=frame,
            readings_share=_part(readings, covariance, samples.middle),
            sign=sign,
            sign_margin=margin,
            other=None if other is None else (other.slope, -other.slope * other.focus),
            method=f"robust V-fit over {self._where(samples)}"
            + (f", mean of {coc.frames} frames" if coc.frames > 1 else "")
            + (f", {1 + len(others)} frames of a moving camera" if others else "")
            + (f", with {known.source}" if known.in_numbers else ""),
            ground_seen=ground_visibility(
                samples.disparity, samples.coc_px, samples.sigma_px, np.abs(error + samples.coc_px)
            ),
        )
        _check(fit, readings, samples)
        return Regression(fit=fit, samples=replace(samples, weight=weight))

    def samples(self, coc: CocMap, ground: GroundProjection) -> FitSamples:
        """The samples of one frame, of which `others` holds some; arguments as of a fit.

        Raises:
            LensFitError: the plane is not in view.
        """
        return _sample(coc, ground, whole_plane=self.whole_plane)

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

    def _where(self, samples: FitSamples) -> str:
        if not self.whole_plane:
            return "the footprint"
        if not samples.anchor.any():
            return "the ground plane without a footprint in view"
        return "the whole ground plane, anchored by the footprint"


def _joined(parts: Sequence[FitSamples]) -> FitSamples:
    """Samples of several frames; patches of different frames err apart."""
    patches = np.cumsum([0, *(int(part.cluster.max()) + 1 for part in parts)])
    moved = [
        replace(part, cluster=part.cluster + int(first))
        for part, first in zip(parts, patches, strict=False)
    ]
    names = [field.name for field in fields(FitSamples)]
    return FitSamples(**{n: np.concatenate([getattr(part, n) for part in moved]) for n in names})


def _agreeing(problem: VFit, lens: VCandidate, samples: FitSamples) -> float:
    """Mean weight of the footprint's samples under the loss, 0 to 1; 1 where there are none."""
    anchor = samples.anchor
    return float(problem.inlier_weight(lens)[anchor].mean()) if anchor.any() else 1.0


def _sample(coc: CocMap, ground: GroundProjection, *, whole_plane: bool) -> FitSamples:
    """Samples on a regular grid of the part of the frame that the plane covers."""
    height, width = coc.coc_px.shape
    step = max(1, round(width / GRID_COLUMNS))
    if not whole_plane:  # a footprint can be a handful of pixels
        step = max(1, min(step, int(np.sqrt(max(ground.mask.sum(), 1) / MIN_SAMPLES))))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    disparity, anchor = ground.disparity[rows, columns], ground.mask[rows, columns]
    values, sigma = coc.coc_px[rows, columns], coc.sigma_px[rows, columns]
    use = np.isfinite(values) & np.isfinite(sigma) & (disparity > 0)
    if not whole_plane:
        use &= anchor
    elif anchor.any():
        use &= disparity > _FARTHEST_SHARE * np.median(disparity[anchor])
    if use.sum() < MIN_SAMPLES:
        raise LensFitError(
            f"only {int(use.sum())} samples of the ground plane y = {ground.ground_y:g} are in "
            f"view, {MIN_SAMPLES} are needed; check --ground-y and the camera, or give "
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
    there = np.array([disparity, 1.0])
    return float(min(1.0, np.sqrt(there @ readings @ there / max(there @ whole @ there, 1e-300))))


def _check(fit: LensFit, covariance: Float64, samples: FitSamples) -> None:
    """Refuse a fit that does not determine the blur where the object stands."""
    use = samples.anchor if samples.anchor.any() else np.ones_like(samples.anchor)
    jacobian = np.array([samples.middle, 1.0])
    error = float(np.sqrt(jacobian @ covariance @ jacobian))
    blur = abs(fit.slope * jacobian[0] + fit.intercept)
    expected = float(np.median(samples.sigma_px[use]))
    unsure = expected > max(UNSURE_PX, blur)
    if unsure or fit.inlier_fraction < 0.1 or error > max(3.0, 0.5 * blur):
        raise LensFitError(
            f"the ground under the object does not tell the blur (CoC {blur:.1f} px, standard "
            f"error {error:.1f} px, {fit.inlier_fraction:.0%} of {fit.n} samples agree, expected "
            f"error {expected:.1f} px); give --fit FILE.json, another --ground-y, or "
            "--fallback constant"
        )
