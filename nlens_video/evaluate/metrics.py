"""Error measures: of CoC maps, of pictures (PSNR, SSIM), and intervals of a mean over scenes."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from scipy.ndimage import uniform_filter
from scipy.stats import t as student

from nlens_video.core.layers import Bool, Float32, Float64, UInt8
from nlens_video.evaluate.report import NONE

BLURRED_PX = 2.0  # relative errors are counted where the true CoC exceeds this
LEVEL = 0.95  # of the intervals
WINDOW = 7  # of SSIM [px]
_PEAK = 255.0
_C1, _C2 = (0.01 * _PEAK) ** 2, (0.03 * _PEAK) ** 2


class BinnedErrors(Struct, frozen=True, kw_only=True):
    """Errors sorted into bins of another quantity; all arrays (B,), bins without a pixel left out.

    Attributes:
        at_px: mean of that quantity in the bin [px].
        mean_abs_px: mean of |error| [px].
        quartiles_px: lower quartile, median and upper quartile of the signed error (B, 3) [px].
        bias_px: mean of the signed error [px].
        count: pixels in the bin.
    """

    at_px: Float64
    mean_abs_px: Float64
    quartiles_px: Float64
    bias_px: Float64
    count: npt.NDArray[np.int64]


def coc_figures(coc: Float32, truth: Float32, sigma: Float32 | None = None) -> dict[str, float]:
    """Errors of an unsigned CoC map where the truth is known; nan where a figure is not defined.

    Args:
        coc: estimated diameter (H, W) [px].
        truth: true diameter (H, W), nan where it is not known [px].
        sigma: expected error of the estimate (H, W) [px].

    Returns:
        rmse_px over the whole plate [px]; confident_rmse_px over the half with the smallest sigma
        [px]; bias_px, the mean of estimate - truth [px]; relative_percent, the median of
        |error| / truth where the truth exceeds 2 px [%].
    """
    known = np.isfinite(truth)
    truth = truth[known]
    error = np.asarray(coc, np.float64)[known] - truth
    blurred = truth > BLURRED_PX
    relative = np.abs(error[blurred]) / truth[blurred]
    return {
        "rmse_px": _rms(error),
        "confident_rmse_px": (
            math.nan if sigma is None else _rms(error[sigma[known] <= np.median(sigma[known])])
        ),
        "bias_px": float(error.mean()),
        "relative_percent": 100 * float(np.median(relative)) if relative.size else math.nan,
    }


def rms_within(coc: Float32, truth: Float32, mask: Bool) -> float:
    """RMSE of a CoC map (H, W) where a mask is set and the truth is no nan; nan for none [px]."""
    mask = mask & np.isfinite(truth)
    return _rms(np.asarray(coc, np.float64)[mask] - truth[mask]) if mask.any() else math.nan


def binned_errors(error: Float32, by: Float32, edges: Float64, fewest: int = 1) -> BinnedErrors:
    """Sort errors into bins.

    Args:
        error: estimate - truth (N,) [px].
        by: what the bins are of (N,) [px].
        edges: rising edges of the bins (B + 1,); what lies outside is left out [px].
        fewest: pixels below which a bin is left out, unless none has as many [1].
    """
    number = np.digitize(by, edges) - 1
    bins = [number == at for at in range(len(edges) - 1)]
    least = max(1, min(fewest, max(int(one.sum()) for one in bins)))
    kept = [one for one in bins if one.sum() >= least]
    quartiles = [np.quantile(error[one], (0.25, 0.5, 0.75)) for one in kept]
    return BinnedErrors(
        at_px=np.array([by[one].mean() for one in kept], np.float64),
        mean_abs_px=np.array([np.abs(error[one]).mean() for one in kept], np.float64),
        quartiles_px=np.array(quartiles, np.float64).reshape(-1, 3),
        bias_px=np.array([error[one].mean() for one in kept], np.float64),
        count=np.array([one.sum() for one in kept], np.int64),
    )


def _rms(error: Float64) -> float:
    return float(np.sqrt(np.mean(error**2)))


class Interval(Struct, frozen=True, kw_only=True):
    """A mean over scenes and how far the truth may be from it.

    Attributes:
        mean: of the scenes' means, nan where there is none.
        half: half the width of the interval, nan for fewer than two scenes.
        scenes: how many.
    """

    mean: float
    half: float
    scenes: int

    def text(self, digits: int) -> str:
        """Mean and half width, such as `34.7 ± 2.1`; the mean alone where no width is known."""
        if not math.isfinite(self.mean):
            return NONE
        width = f" ± {self.half:.{digits}f}" if math.isfinite(self.half) else ""
        return f"{self.mean:.{digits}f}{width}"


def over_scenes(figures: Iterable[tuple[str, float]]) -> Interval:
    """Student's interval of the mean over scenes, each the mean of its plates' finite figures."""
    by_scene: dict[str, list[float]] = defaultdict(list)
    for scene, figure in figures:
        if math.isfinite(figure):
            by_scene[scene].append(figure)
    means = np.array([np.mean(values) for values in by_scene.values()], np.float64)
    count = len(means)
    if count < 2:
        return Interval(mean=float(means[0]) if count else math.nan, half=math.nan, scenes=count)
    reach = float(student.ppf(0.5 + 0.5 * LEVEL, count - 1))
    half = reach * float(means.std(ddof=1)) / math.sqrt(count)
    return Interval(mean=float(means.mean()), half=half, scenes=count)


def psnr(picture: UInt8, truth: UInt8) -> float:
    """Peak signal-to-noise ratio of code values (..., C), infinite for equal pictures [dB]."""
    return psnr_of_error(picture.astype(np.float64) - truth)


def psnr_of_error(error: Float64) -> float:
    """Peak signal-to-noise ratio of code values that are off by `error` (any shape) [dB]."""
    mean = float(np.mean(error**2))
    return 10.0 * math.log10(_PEAK**2 / mean) if mean else math.inf


def ssim(picture: UInt8, truth: UInt8) -> float:
    """Structural similarity (Wang et al. 2004), the mean over pixels and channels, 1 at most [1].

    Windows of 7 x 7 equal weights, sample covariance, windows that lie within the picture: what
    scikit-image computes by default, and the paper's figures with it.
    """
    return float(ssim_map(picture, truth).mean())


def ssim_map(picture: UInt8, truth: UInt8) -> Float64:
    """Structural similarity of each window within the picture (h - 6, w - 6, C) [1].

    Both pictures are code values (h, w, C), h and w at least 7.
    """
    if min(truth.shape[:2]) < WINDOW:
        raise ValueError(f"{truth.shape[:2]} pixels: SSIM needs {WINDOW} each way")
    count = WINDOW * WINDOW
    unbiased = count / (count - 1)
    a, b = picture.astype(np.float64), truth.astype(np.float64)
    mean_a, mean_b = _mean(a), _mean(b)
    var_a = unbiased * (_mean(a * a) - mean_a * mean_a)
    var_b = unbiased * (_mean(b * b) - mean_b * mean_b)
    covariance = unbiased * (_mean(a * b) - mean_a * mean_b)
    likeness = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)
    likeness /= (mean_a**2 + mean_b**2 + _C1) * (var_a + var_b + _C2)
    rim = WINDOW // 2
    return np.asarray(likeness[rim:-rim, rim:-rim], np.float64)


def _mean(values: Float64) -> Float64:
    """Mean over the window around each pixel, channel by channel."""
    return np.asarray(uniform_filter(values, size=(WINDOW, WINDOW, 1)))
