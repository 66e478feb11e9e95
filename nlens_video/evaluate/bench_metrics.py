"""How like two pictures are: PSNR and SSIM of 8-bit code values."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter

from nlens_video.core.layers import Float64

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
