"""R: the linear lens model from the plate's CoC and the ground's disparity (paper, section 4.2).

The paper turns the estimated, unsigned CoC into a signed one by a rule and fits a least-squares
line. Here the V itself is fitted: coc = |slope * (disparity - focus)|, slope > 0, focus >= 0
(nothing is nearer than the lens or farther than infinity), so both sign branches compete and the
data decide between them. The whole ground plane takes part under a loss that shrugs off what
stands on it; the footprint, where virtual and real ground are known to coincide, is the anchor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.errors import LensFitError
from nlens_video.frames import Bool, CocMap, Float64
from nlens_video.lens import LensFit, Sign
from nlens_video.stages.p_projection import GroundProjection

GRID_COLUMNS = 240  # samples across the frame: the estimate has no finer detail than that
MIN_SAMPLES = 48
FLOOR_PX = 0.3  # an estimate is never trusted further than this
CUTOFF = 2.0  # residuals beyond this many expected errors stop counting
RESOLVED_MARGIN = 0.05
_FOCUS_STEPS = 160
_SLOPE_QUANTILES = (0.08, 0.2, 0.35, 0.5, 0.65, 0.8, 0.92)
_SCAN_SAMPLES = 3000
_CLUSTER_SAMPLES = 8  # errors of neighbours are alike: standard errors count clusters, not pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSamples:
    """What entered the fit, for plots and checks; all arrays (N,).

    Attributes:
        disparity: of the ground plane [1 / scene unit].
        coc_px: estimated unsigned diameter [px].
        sigma_px: its expected error [px].
        anchor: whether the sample lies in the footprint.
        weight: what the robust loss left of it, 0 to 1 [1].
        cluster: index of the patch of the frame that it belongs to.
    """

    disparity: Float64
    coc_px: Float64
    sigma_px: Float64
    anchor: Bool
    weight: Float64
    cluster: Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """The fit and what it was made from."""

    fit: LensFit
    samples: FitSamples


@dataclass(frozen=True, slots=True, kw_only=True)
class FitLens:
    """R as a stage.

    Attributes:
        anchor_weight: weight of the footprint as a whole against the rest of the plane [1].
        whole_plane: fit on everything the plane covers, or (as the paper) on the footprint alone.
    """

    anchor_weight: float = 1.0
    whole_plane: bool = True

    def __call__(self, coc: CocMap, ground: GroundProjection, frame: int = 0) -> Regression:
        """Fit the lens on one frame.

        Args:
            coc: the plate's CoC (H, W).
            ground: footprint and plane on the same frame.
            frame: index of that frame, kept in the fit.

        Raises:
            LensFitError: the plane is not in view, or nothing on it tells the blur.
        """
        samples = _sample(coc, ground, whole_plane=self.whole_plane)
        problem = _Problem.of(samples, self.anchor_weight)
        best = _search(problem)
        slope, focus = _refine(problem, *best)
        sign, margin = _sign(problem, slope, focus)
        weight = problem.kept(slope, focus)
        covariance = _covariance(problem, samples, slope, focus)
        error = np.abs(slope * np.abs(samples.disparity - focus) - samples.coc_px)
        where = "the whole ground plane, anchored by the footprint"
        if not self.whole_plane:
            where = "the footprint"
        elif not samples.anchor.any():
            where = "the ground plane without a footprint in view"
        fit = LensFit(
            slope=slope,
            intercept=-slope * focus,
            slope_stderr=float(np.sqrt(covariance[0, 0])),
            intercept_stderr=float(np.sqrt(covariance[1, 1])),
            rmse_px=float(np.sqrt(np.average(error**2, weights=weight + 1e-12))),
            n=len(error),
            inlier_fraction=float(np.mean(weight > 0.25)),
            width=coc.coc_px.shape[1],
            height=coc.coc_px.shape[0],
            frame=frame,
            sign=sign,
            sign_margin=margin,
            method=f"robust V-fit over {where}",
        )
        _check(fit, covariance, samples)
        samples = _replace_weight(samples, weight)
        return Regression(fit=fit, samples=samples)


def constant_fit(coc: CocMap, ground: GroundProjection | None, frame: int = 0) -> LensFit:
    """The fallback: one CoC for every depth, the plate's confident median, behind the focus.

    Args:
        coc: the plate's CoC (H, W).
        ground: where to look first; the whole plate when its footprint is empty.
        frame: index of that frame, kept in the fit.
    """
    use = (
        ground.mask if ground is not None and ground.mask.any() else np.ones_like(coc.coc_px, bool)
    )
    values, sigma = coc.coc_px[use], coc.sigma_px[use]
    confident = values[sigma <= np.quantile(sigma, 0.5)]
    height, width = coc.coc_px.shape
    return LensFit(
        slope=0.0,
        intercept=-float(np.median(confident)),
        rmse_px=float(np.median(sigma)),
        n=int(confident.size),
        inlier_fraction=0.5,
        width=width,
        height=height,
        frame=frame,
        sign="assumed",
        method="constant CoC: no usable fit, the plate's confident median",
    )


def _sample(coc: CocMap, ground: GroundProjection, *, whole_plane: bool) -> FitSamples:
    """Samples on a regular grid of the part of the frame that the plane covers."""
    height, width = coc.coc_px.shape
    step = max(1, round(width / GRID_COLUMNS))
    if not whole_plane:  # a footprint can be a handful of pixels
        step = max(1, min(step, int(np.sqrt(max(ground.mask.sum(), 1) / MIN_SAMPLES))))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    disparity = ground.disparity[rows, columns]
    anchor = ground.mask[rows, columns]
    reference = float(np.median(ground.disparity[ground.mask])) if ground.mask.any() else 0.0
    use = disparity > 0.02 * reference if whole_plane else anchor
    use &= np.isfinite(coc.coc_px[rows, columns]) & np.isfinite(coc.sigma_px[rows, columns])
    use &= disparity > 0
    if use.sum() < MIN_SAMPLES:
        raise LensFitError(
            f"only {int(use.sum())} samples of the ground plane y = {ground.ground_y:g} are in "
            f"view, {MIN_SAMPLES} are needed; check --ground-y and the camera, or give "
            "--fit FILE.json or --fallback constant"
        )
    patches = (rows // (step * _CLUSTER_SAMPLES)) * 100_000 + columns // (step * _CLUSTER_SAMPLES)
    return FitSamples(
        disparity=disparity[use].astype(np.float64),
        coc_px=coc.coc_px[rows, columns][use].astype(np.float64),
        sigma_px=coc.sigma_px[rows, columns][use].astype(np.float64),
        anchor=anchor[use],
        weight=np.ones(int(use.sum())),
        cluster=patches[use].astype(np.float64),
    )


def _replace_weight(samples: FitSamples, weight: Float64) -> FitSamples:
    return FitSamples(
        disparity=samples.disparity,
        coc_px=samples.coc_px,
        sigma_px=samples.sigma_px,
        anchor=samples.anchor,
        weight=weight,
        cluster=samples.cluster,
    )


@dataclass(frozen=True, slots=True)
class _Problem:
    """The robust cost in units in which the disparity's largest value is 1."""

    disparity: Float64
    coc_px: Float64
    error_px: Float64  # expected error of a sample
    share: Float64  # share of a sample in the cost, sums to 1

    @classmethod
    def of(cls, samples: FitSamples, anchor_weight: float) -> _Problem:
        error = np.hypot(samples.sigma_px, FLOOR_PX)
        share = np.full(len(error), 1.0 / len(error))
        if samples.anchor.any():
            share = share + anchor_weight * samples.anchor / samples.anchor.sum()
        return cls(samples.disparity, samples.coc_px, error, share / share.sum())

    def thinned(self) -> _Problem:
        """At most `_SCAN_SAMPLES` of the samples, picked in proportion to their share."""
        if len(self.share) <= _SCAN_SAMPLES:
            return self
        edges = np.cumsum(self.share)
        picked = np.searchsorted(
            edges, (np.arange(_SCAN_SAMPLES) + 0.5) / _SCAN_SAMPLES * edges[-1]
        )
        picked = np.minimum(picked, len(edges) - 1)
        even = np.full(_SCAN_SAMPLES, 1.0 / _SCAN_SAMPLES)
        return _Problem(self.disparity[picked], self.coc_px[picked], self.error_px[picked], even)

    def squared(self, slope: float, focus: float) -> Float64:
        """Squared residuals in expected errors (N,)."""
        residual = slope * np.abs(self.disparity - focus) - self.coc_px
        return np.asarray((residual / self.error_px) ** 2)

    def cost(self, slope: float, focus: float) -> float:
        """Geman-McClure: quadratic near zero, a constant far out."""
        squared = self.squared(slope, focus)
        return float(np.sum(self.share * squared / (squared + CUTOFF**2)))

    def kept(self, slope: float, focus: float) -> Float64:
        """What the loss leaves of each sample (N,), 1 for an inlier, 0 for an outlier."""
        return np.asarray((CUTOFF**2 / (self.squared(slope, focus) + CUTOFF**2)) ** 2)


def _search(problem: _Problem, allowed: tuple[float, float] | None = None) -> tuple[float, float]:
    """Best (slope, focus) on a grid over focus disparities and robust slopes."""
    thin = problem.thinned()
    top = float(thin.disparity.max())
    # beyond the nearest ground the focus is looked for on a geometric scale: the V is a line there
    inside = np.linspace(0.0, top, _FOCUS_STEPS)
    beyond = top * np.geomspace(1.02, 8.0, _FOCUS_STEPS // 5)
    best, best_cost = (0.0, 0.0), np.inf
    for focus in np.concatenate([inside, beyond]):
        if allowed is not None and not allowed[0] <= focus <= allowed[1]:
            continue
        distance = np.abs(thin.disparity - focus)
        useful = distance > 0.01 * top
        if not useful.any():
            continue
        slopes = np.quantile(thin.coc_px[useful] / distance[useful], _SLOPE_QUANTILES)
        residual = (slopes[:, None] * distance - thin.coc_px) / thin.error_px
        squared = residual**2
        costs = (squared / (squared + CUTOFF**2)).mean(axis=1)
        at = int(np.argmin(costs))
        if costs[at] < best_cost:
            best, best_cost = (float(slopes[at]), float(focus)), float(costs[at])
    return best


def _refine(problem: _Problem, slope: float, focus: float) -> tuple[float, float]:
    """Iteratively reweighted least squares on (slope, intercept) from a grid point."""
    cost = problem.cost(slope, focus)
    for _ in range(40):
        weight = problem.kept(slope, focus) * problem.share / problem.error_px**2
        sign = np.where(problem.disparity >= focus, 1.0, -1.0)
        design = np.stack([sign * problem.disparity, sign], axis=1)
        normal = design.T @ (design * weight[:, None])
        scale = np.sqrt(np.diag(normal)) + 1e-300
        system = normal / np.outer(scale, scale) + 1e-9 * np.eye(2)
        solution = np.linalg.solve(system, (design.T @ (weight * problem.coc_px)) / scale) / scale
        new_slope, new_intercept = float(solution[0]), float(solution[1])
        if new_slope <= 0:
            break
        new_focus = max(0.0, -new_intercept / new_slope)
        if new_focus == 0.0:  # focus at infinity: the line goes through the origin
            x = problem.disparity
            new_slope = float((weight * x * problem.coc_px).sum() / (weight * x * x).sum())
        new_cost = problem.cost(new_slope, new_focus)
        if new_cost >= cost - 1e-12:
            break
        slope, focus, cost = new_slope, new_focus, new_cost
    return slope, focus


def _sign(problem: _Problem, slope: float, focus: float) -> tuple[Sign, float]:
    """How much worse the best lens fits that blurs the anchor with the other sign."""
    middle = _weighted_median(problem.disparity, problem.share)
    signed = slope * (middle - focus)
    if abs(signed) < 1.0:  # in focus there: both signs mean the same picture
        return "resolved", 1.0
    top = float(problem.disparity.max())
    other_side = (middle, 8.0 * top) if signed > 0 else (0.0, middle)
    other = _refine_within(problem, _search(problem, other_side), other_side)
    if other is None:
        return "resolved", 1.0
    best_cost = problem.cost(slope, focus)
    margin = (problem.cost(*other) - best_cost) / max(best_cost, 1e-6)
    return ("resolved" if margin >= RESOLVED_MARGIN else "ambiguous"), float(max(margin, 0.0))


def _refine_within(
    problem: _Problem, start: tuple[float, float], allowed: tuple[float, float]
) -> tuple[float, float] | None:
    """Refine, unless the descent leaves the allowed range of focus disparities."""
    if start[0] <= 0:
        return None
    refined = _refine(problem, *start)
    return refined if allowed[0] <= refined[1] <= allowed[1] else start


def _weighted_median(values: Float64, weights: Float64) -> float:
    order = np.argsort(values)
    edges = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(edges, 0.5 * edges[-1])])


def _covariance(problem: _Problem, samples: FitSamples, slope: float, focus: float) -> Float64:
    """Cluster-robust (sandwich) covariance (2, 2) of slope and intercept."""
    squared = problem.squared(slope, focus)
    weight = problem.kept(slope, focus) * problem.share / problem.error_px**2
    # a redescending loss is flatter than its weights say: its true curvature goes in the middle
    curvature = weight * (1 - 4 * squared / (squared + CUTOFF**2))
    sign = np.where(problem.disparity >= focus, 1.0, -1.0)
    design = np.stack([sign * problem.disparity, sign], axis=1)
    residual = slope * np.abs(problem.disparity - focus) - problem.coc_px
    scale = np.array([problem.disparity.max(), 1.0])
    hessian = (design / scale).T @ ((design / scale) * curvature[:, None])
    if np.linalg.eigvalsh(hessian)[0] <= 0:
        hessian = (design / scale).T @ ((design / scale) * weight[:, None])
    bread = np.linalg.pinv(hessian)
    _, cluster = np.unique(samples.cluster, return_inverse=True)
    scores = np.zeros((cluster.max() + 1, 2))
    np.add.at(scores, cluster, (design / scale) * (weight * residual)[:, None])
    covariance = bread @ (scores.T @ scores) @ bread / np.outer(scale, scale)
    return np.asarray(covariance)


def _check(fit: LensFit, covariance: Float64, samples: FitSamples) -> None:
    """Refuse a fit that says nothing about the blur where the object stands."""
    use = samples.anchor if samples.anchor.any() else np.ones_like(samples.anchor)
    jacobian = np.array([float(np.median(samples.disparity[use])), 1.0])
    error = float(np.sqrt(jacobian @ covariance @ jacobian))
    blur = abs(fit.slope * jacobian[0] + fit.intercept)
    expected = float(np.median(samples.sigma_px[use]))
    if fit.inlier_fraction < 0.1 or error > max(3.0, 0.5 * blur) or fit.slope <= 0:
        raise LensFitError(
            f"the ground under the object does not tell the blur (CoC {blur:.1f} px, standard "
            f"error {error:.1f} px, {fit.inlier_fraction:.0%} of {fit.n} samples agree, expected "
            f"error {expected:.1f} px); give --fit FILE.json, another --ground-y, or "
            "--fallback constant"
        )
