"""How far a CoC estimate is from the truth."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter
from scipy.stats import t as student

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.evaluate.tables import NONE

BLURRED_PX = 2.0  # relative errors are counted where the true CoC exceeds this


@dataclass(frozen=True, slots=True, kw_only=True)
class CocFigures:
    """Errors of a CoC map against the truth.

    Attributes:
        rmse_px: root mean square error over the whole plate [px of diameter].
        confident_rmse_px: over the half with the smallest sigma, nan without a sigma [px].
        bias_px: mean of estimate - truth over the whole plate [px].
        relative: median of |error| / truth where the truth exceeds 2 px, nan where none does [1].
    """

    rmse_px: float
    confident_rmse_px: float
    bias_px: float
    relative: float


@dataclass(frozen=True, slots=True, kw_only=True)
class BinnedErrors:
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


def coc_figures(coc: Float32, truth: Float32, sigma: Float32 | None = None) -> CocFigures:
    """Compare an unsigned CoC map with the unsigned truth.

    Args:
        coc: estimated diameter (H, W) [px].
        truth: true diameter (H, W) [px].
        sigma: expected error of the estimate (H, W) [px].
    """
    error = np.asarray(coc, np.float64) - truth
    blurred = truth > BLURRED_PX
    relative = np.nan
    if blurred.any():
        relative = float(np.median(np.abs(error[blurred]) / truth[blurred]))
    confident = np.nan
    if sigma is not None:
        confident = _rms(error[sigma <= np.median(sigma)])
    return CocFigures(
        rmse_px=_rms(error),
        confident_rmse_px=confident,
        bias_px=float(error.mean()),
        relative=relative,
    )


def rms_within(coc: Float32, truth: Float32, mask: Bool) -> float:
    """Root mean square error over part of the frame, nan where that is empty [px].

    Args:
        coc: estimated diameter, both signed or both not (H, W) [px].
        truth: true diameter (H, W) [px].
        mask: pixels that count, such as those that the object covers wholly (H, W).
    """
    if not mask.any():
        return float("nan")
    return _rms(np.asarray(coc, np.float64)[mask] - truth[mask])


def binned_errors(error: Float32, by: Float32, edges: Float64) -> BinnedErrors:
    """Sort errors into bins.

    Args:
        error: estimate - truth, any shape [px].
        by: what the bins are of, the same shape [px].
        edges: rising edges of the bins (B + 1,); what lies outside is left out [px].
    """
    error, by = error.ravel(), by.ravel()
    number = np.digitize(by, edges) - 1
    rows = [number == at for at in range(len(edges) - 1)]
    kept = [row for row in rows if row.any()]
    return BinnedErrors(
        at_px=np.array([by[row].mean() for row in kept], np.float64),
        mean_abs_px=np.array([np.abs(error[row]).mean() for row in kept], np.float64),
        quartiles_px=np.array(
            [np.quantile(error[row], (0.25, 0.5, 0.75)) for row in kept], np.float64
        ).reshape(-1, 3),
        bias_px=np.array([error[row].mean() for row in kept], np.float64),
        count=np.array([row.sum() for row in kept], np.int64),
    )


def _rms(error: Float64) -> float:
    return float(np.sqrt(np.mean(error**2)))


LEVEL = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
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
    """Student's interval of the mean over scenes, each scene the mean of its plates.

    Args:
        figures: scene and figure of each plate; what is not finite is left out.
    """
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


UInt8 = npt.NDArray[np.uint8]

WINDOW = 7
_PEAK = 255.0
_C1, _C2 = (0.01 * _PEAK) ** 2, (0.03 * _PEAK) ** 2


def psnr(picture: UInt8, truth: UInt8) -> float:
    """Peak signal-to-noise ratio over all channels, infinite for equal pictures [dB].

    Args:
        picture: code values (..., C).
        truth: code values (..., C).
    """
    mean = float(np.mean((picture.astype(np.float64) - truth) ** 2))
    return 10.0 * math.log10(_PEAK**2 / mean) if mean else math.inf


def ssim(picture: UInt8, truth: UInt8) -> float:
    """Structural similarity (Wang et al. 2004), the mean over pixels and channels, 1 at most [1].

    Windows of 7 x 7 equal weights, sample covariance, windows that lie within the picture: what
    scikit-image computes by default, and the paper's figures with it.

    Args:
        picture: code values (h, w, C), h and w at least 7.
        truth: code values (h, w, C).
    """
    return float(ssim_map(picture, truth).mean())


def ssim_map(picture: UInt8, truth: UInt8) -> Float64:
    """Structural similarity of each window that lies within the picture (h - 6, w - 6, C) [1].

    Args:
        picture: code values (h, w, C), h and w at least 7.
        truth: code values (h, w, C).
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
