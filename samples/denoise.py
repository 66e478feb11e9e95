"""Non-local means for rendered layers whose noise has been measured.

Rousselle, Knaus, Zwicker: Adaptive rendering with non-local means filtering, 2012. Distances
between patches count relative to the noise of both pixels: detail above the noise stays.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter
from shot_list import NOISE_SHARE

Floats = npt.NDArray[np.float64]

REACH, PATCH, STRENGTH = 6, 5, 0.7


def noise_variance(picture: Floats, fewer: Floats) -> Floats:
    """Variance (H, W, 3) of a picture, from one with NOISE_SHARE times fewer other rays."""
    squared = (picture - fewer) ** 2 / (1.0 + NOISE_SHARE)
    limit = 9.0 * uniform_filter(squared, (15, 15, 0))
    return np.asarray(uniform_filter(np.minimum(squared, limit), (7, 7, 0)))


def denoise(picture: Floats, variance: Floats) -> Floats:
    """Average every pixel of (H, W, 3) with those whose patches differ by noise alone."""
    if not picture.any():
        return picture
    image, noise = picture.astype(np.float32), variance.astype(np.float32)
    height, width = image.shape[:2]
    pad = ((REACH, REACH), (REACH, REACH), (0, 0))
    wide, wide_noise = np.pad(image, pad, "reflect"), np.pad(noise, pad, "reflect")
    total, weights = np.zeros_like(image), np.zeros((height, width, 1), np.float32)
    tiny = np.float32(1e-8 + 1e-6 * float(np.square(image).mean()))
    for dy in range(2 * REACH + 1):
        for dx in range(2 * REACH + 1):
            other = wide[dy : dy + height, dx : dx + width]
            other_noise = wide_noise[dy : dy + height, dx : dx + width]
            gap = (image - other) ** 2 - (noise + np.minimum(noise, other_noise))
            gap /= tiny + STRENGTH**2 * (noise + other_noise)
            distance = uniform_filter(gap.mean(axis=2), PATCH)
            weight = np.exp(-np.maximum(distance, 0.0))[..., None]
            total += weight * other
            weights += weight
    return np.asarray(total / weights, np.float64)
