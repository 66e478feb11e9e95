"""How far a CoC estimate is from the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float32, Float64

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
