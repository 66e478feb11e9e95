"""The robust V: coc = slope * |disparity - focus| through samples of which many may be wrong.

slope > 0 and focus >= 0 is what optics says for certain (nearer points blur with the positive sign,
and nothing lies beyond infinity), so both arms of the V compete for every sample. It also says how
large the CoC at infinity can be: beyond a tenth of the frame's width only the fastest lenses get,
close up. That is a weak prior on the intercept; without it samples of a short span of disparity,
as of a ground seen from above, would let the line swing. What is known of the lens beforehand is a
prior by its own errors.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.known_lens import NO_PRIOR, LensPrior
from nlens_video.core.layers import Float64

INDEPENDENT = 4.0
"""Independent samples that a plate is worth: with 4.6 only 93 % of plates lie within two errors."""

CUTOFF = 2.0  # residuals beyond this many expected errors stop counting
_FOCUS_STEPS = 160
_SLOPE_QUANTILES = np.array([0.08, 0.2, 0.35, 0.5, 0.65, 0.8, 0.92])
_SCAN_SAMPLES = 3000
_FARTHEST_FOCUS = 8.0  # of the largest disparity: nearer focus planes look alike from the data
_STEPS = 40
_USUAL_FOCUS = 0.4  # deviation of the logarithm of the focused distance from the object's
_COMMON_ERROR, _COMMON_ERROR_T2 = 6.0, 4.0  # of all readings: variance grows by a / (b + t^2)
_TOLD_POWER = 6  # at two standard errors a slope is even odds, at four a certainty
_PRIOR_SHARE = 0.02  # of the prior against all samples together: one sample in fifty clusters


class VCandidate(Struct, frozen=True):
    """A candidate: slope [px * scene unit] > 0 and focus disparity [1 / scene unit] >= 0."""

    slope: float
    focus: float


class VFit(Struct, frozen=True):
    """Samples and the robust cost of a candidate; all arrays (N,).

    Attributes:
        disparity: > 0 [1 / scene unit].
        coc_px: unsigned diameter [px].
        error_px: expected error of the diameter, > 0 [px].
        share: share of each sample in the cost; sums to 1 [1].
        infinity_px: deviation of the prior on the CoC at infinity [px].
        known: what is known of the lens beforehand.
    """

    disparity: Float64
    coc_px: Float64
    error_px: Float64
    share: Float64
    infinity_px: float = np.inf
    known: LensPrior = NO_PRIOR

    def solve(self) -> VCandidate | None:
        """The best candidate, None where no slope above zero fits at all."""
        return self._within(0.0, np.inf)

    def cost(self, lens: VCandidate) -> float:
        """Geman-McClure (quadratic for small residuals, constant for large ones) and the prior."""
        squared = self._squared(lens)
        robust = float(np.sum(self.share * squared / (squared + CUTOFF**2)))
        return robust + float(self._prior(np.array(lens.slope), lens.focus))

    def inlier_weight(self, lens: VCandidate) -> Float64:
        """What the loss leaves of each sample (N,), 1 for an inlier, 0 for an outlier."""
        return np.asarray((CUTOFF**2 / (self._squared(lens) + CUTOFF**2)) ** 2)

    def sign_margin(self, lens: VCandidate) -> float:
        """Relative cost by which the best lens of the other sign fits worse; inf if there is none.

        The sign is that of the CoC at the weighted median of the disparities.
        """
        other = self.of_other_sign(lens)
        if other is None:
            return np.inf
        cost = self.cost(lens)
        return max(0.0, (self.cost(other) - cost) / max(cost, 1e-6))

    def of_other_sign(self, lens: VCandidate) -> VCandidate | None:
        """The best lens of the other sign, if there is one."""
        middle = _weighted_median(self.disparity, self.share)
        if lens.focus < middle:
            return self._within(middle, np.inf)
        return self._within(0.0, middle)

    def coc_at_median(self, lens: VCandidate) -> float:
        """Signed CoC at the weighted median of the disparities [px]."""
        return lens.slope * (_weighted_median(self.disparity, self.share) - lens.focus)

    def covariance(
        self, lens: VCandidate, cluster: npt.NDArray[np.int64], independent: float = INDEPENDENT
    ) -> Float64:
        """Covariance of (slope, intercept), (2, 2): of local errors and of those all share.

        What neighbours err alike shows in the residuals (cluster-robust, a sandwich). What a whole
        picture is misread by does not, since the line follows it: for that the samples count
        together as a few that err by their expected error.

        Args:
            lens: the solution.
            cluster: which samples err alike (N,).
            independent: how many independent samples all of them are worth [1].
        """
        squared = self._squared(lens)
        weight = self.inlier_weight(lens) * self.share / self.error_px**2
        # a redescending loss is flatter than its weights say: its true curvature is the bread
        curvature = weight * (1 - 4 * squared / (squared + CUTOFF**2))
        scale = np.array([self.disparity.max(), 1.0])
        design = self._design(lens) / scale
        prior = np.diag([0.0, _PRIOR_SHARE / self.infinity_px**2])
        hessian = design.T @ (design * curvature[:, None]) + prior
        if np.linalg.eigvalsh(hessian)[0] <= 0:
            hessian = design.T @ (design * weight[:, None]) + prior
        residual = lens.slope * np.abs(self.disparity - lens.focus) - self.coc_px
        _, patch = np.unique(cluster, return_inverse=True)
        scores = np.zeros((int(patch.max()) + 1, 2))
        np.add.at(scores, patch, design * (weight * residual)[:, None])
        bread = np.linalg.pinv(hessian)
        meat = scores.T @ scores + _PRIOR_SHARE * prior
        shared = np.linalg.pinv(design.T @ (design * weight[:, None]) + prior) / independent
        covariance = (bread @ meat @ bread + shared) / np.outer(scale, scale)
        rows = np.array(self.known.equations(lens.slope)).reshape(-1, 3)[:, :2]
        if not len(rows):
            return np.asarray(covariance)
        return np.asarray(np.linalg.pinv(np.linalg.pinv(covariance) + rows.T @ rows))

    def _within(self, low: float, high: float) -> VCandidate | None:
        """The best candidate with its focus between two disparities."""
        start = self._thinned()._scan(low, high)
        if start is None:
            return None
        refined = self._refine(start)
        return refined if low <= refined.focus <= high else start

    def _prior(self, slope: Float64, focus: float) -> Float64:
        """Cost of the CoC at infinity and of what is known, as of the cost's quadratic part."""
        cost = _PRIOR_SHARE * (slope * focus / self.infinity_px) ** 2
        known = self.known
        for told, value in (
            (known.slope, slope), (known.focus, focus), (known.intercept, -slope * focus),
        ):  # fmt: skip
            if told is not None:
                cost = cost + ((value - told.value) / told.error) ** 2 / INDEPENDENT
        return np.asarray(cost / CUTOFF**2)

    def _squared(self, lens: VCandidate) -> Float64:
        """Squared residuals in expected errors (N,)."""
        residual = lens.slope * np.abs(self.disparity - lens.focus) - self.coc_px
        return np.asarray((residual / self.error_px) ** 2)

    def _design(self, lens: VCandidate) -> Float64:
        """Derivative of the unsigned CoC by slope and intercept (N, 2)."""
        sign = np.where(self.disparity >= lens.focus, 1.0, -1.0)
        return np.stack([sign * self.disparity, sign], axis=1)

    def _thinned(self) -> VFit:
        """At most `_SCAN_SAMPLES` of the samples, picked in proportion to their share."""
        if len(self.share) <= _SCAN_SAMPLES:
            return self
        edges = np.cumsum(self.share)
        shares = (np.arange(_SCAN_SAMPLES) + 0.5) / _SCAN_SAMPLES * edges[-1]
        picked = np.minimum(np.searchsorted(edges, shares), len(edges) - 1)
        even = np.full(_SCAN_SAMPLES, 1.0 / _SCAN_SAMPLES)
        return replace(
            self,
            disparity=self.disparity[picked],
            coc_px=self.coc_px[picked],
            error_px=self.error_px[picked],
            share=even,
        )

    def _scan(self, low: float, high: float) -> VCandidate | None:
        """The best of a grid over focus disparities and, for each, quantiles of the slope."""
        top = float(self.disparity.max())
        # beyond the nearest sample only one arm is seen: a geometric scale is fine enough
        inside = np.linspace(0.0, top, _FOCUS_STEPS)
        beyond = top * np.geomspace(1.02, _FARTHEST_FOCUS, _FOCUS_STEPS // 5)
        best, best_cost = None, np.inf
        told = [] if self.known.focus is None else [self.known.focus.value]
        for focus in np.concatenate([inside, beyond, told]):
            distance = np.abs(self.disparity - focus)
            useful = distance > 0.01 * top
            if not low <= focus <= high or not useful.any():
                continue
            ratios = np.sort(self.coc_px[useful] / distance[useful])
            places = _SLOPE_QUANTILES * (len(ratios) - 1)
            slopes = np.interp(places, np.arange(len(ratios)), ratios)  # as the slower np.quantile
            if self.known.slope is not None:
                slopes = np.append(slopes, self.known.slope.value)
            squared = ((slopes[:, None] * distance - self.coc_px) / self.error_px) ** 2
            costs = (squared / (squared + CUTOFF**2)) @ self.share + self._prior(slopes, focus)
            at = int(np.argmin(costs))
            if costs[at] < best_cost and slopes[at] > 0:
                best, best_cost = VCandidate(float(slopes[at]), float(focus)), float(costs[at])
        return best

    def _refine(self, lens: VCandidate) -> VCandidate:
        """Iteratively reweighted least squares from a grid point, while the cost falls."""
        cost = self.cost(lens)
        for _ in range(_STEPS):
            weight = self.inlier_weight(lens) * self.share / self.error_px**2
            candidate = self._least_squares(lens, weight)
            if candidate is None or (new_cost := self.cost(candidate)) >= cost - 1e-12:
                break
            lens, cost = candidate, new_cost
        return lens

    def _least_squares(self, lens: VCandidate, weight: Float64) -> VCandidate | None:
        """Weighted least squares on the arms of the V on which a candidate puts the samples."""
        design = self._design(lens)
        known = np.array(self.known.equations(lens.slope)).reshape(-1, 3)
        rows, told = known[:, :2], known[:, 2]
        normal = design.T @ (design * weight[:, None]) + rows.T @ rows / INDEPENDENT
        normal[1, 1] += _PRIOR_SHARE / self.infinity_px**2
        right = design.T @ (weight * self.coc_px) + rows.T @ told / INDEPENDENT
        scale = np.sqrt(np.diag(normal)) + 1e-300
        system = normal / np.outer(scale, scale) + 1e-9 * np.eye(2)
        solution = np.linalg.solve(system, right / scale) / scale
        slope, intercept = float(solution[0]), float(solution[1])
        if slope <= 0:
            return None
        if intercept <= 0:
            return VCandidate(slope, -intercept / slope)
        # the nearest lens that optics allows is focused at infinity: a line through the origin
        x = self.disparity
        slope = float((weight * x * self.coc_px).sum() / (weight * x * x).sum())
        return VCandidate(slope, 0.0) if slope > 0 else None


def add_unresolved_covariance(
    covariance: Float64, lens: VCandidate, other: VCandidate | None, chance: float,
    usual_slope: float, disparity: float,
) -> Float64:  # fmt: skip
    """Covariance of (slope, intercept) with what the readings leave open (2, 2).

    Fine grain, noise and mirrors make a network read too little blur at all depths alike, and no
    residual shows it. A slope that is told from zero says that it has not happened; where there is
    none, the lens may be any that is in use, focused about as far as the object stands. In between
    grounds that are hard to read are misread more than their expected errors say.

    Args:
        covariance: of the readings (2, 2).
        lens: the solution.
        other: the best lens of the other sign, where the sign is open.
        chance: that it is the other one, 0 to 1 [1].
        usual_slope: root mean square slope of lenses in use [px * scene unit].
        disparity: of the object's ground [1 / scene unit].
    """
    t_value = lens.slope / max(float(np.sqrt(covariance[0, 0])), 1e-300)
    misread = 1.0 / (1.0 + min(0.5 * t_value, 1e6) ** _TOLD_POWER)
    mean = disparity * np.exp(0.5 * _USUAL_FOCUS**2)
    square = disparity**2 * np.exp(2.0 * _USUAL_FOCUS**2)
    usual = usual_slope**2 * np.array([[1.0, -mean], [-mean, square]])
    common = 1.0 + _COMMON_ERROR / (_COMMON_ERROR_T2 + t_value * t_value)
    whole = covariance * common + misread * usual
    if other is not None:
        step = np.array([other.slope, -other.slope * other.focus])
        step -= np.array([lens.slope, -lens.slope * lens.focus])
        whole = whole + chance * np.outer(step, step)
    return np.asarray(whole)


def _weighted_median(values: Float64, weights: Float64) -> float:
    order = np.argsort(values)
    edges = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(edges, 0.5 * edges[-1])])
