"""Baseline: blur as a quadratic of disparity, found by re-blurring the sharp picture.

P. Prakash et al., "Blind Augmentation" (IEEE VR 2025). As its release does: for each pixel the
Gaussian whose re-blur of the sharp picture is nearest to the plate in a small window, then one
polynomial of degree 2 of sigma in disparity, by least squares over the textured pixels. All in
display code.

Its most favourable case: disparity is the true one instead of a monocular estimate, the sharp
picture a pinhole rendering instead of a deblurring network's, and sigma goes as far as its analysis
does; the 15x15 kernel of its compositing would cut it at a CoC of about 17 px. The Gaussian nearest
to a disc is wider than the one of the same variance, so the diameters come out some 15 to 25 % too
large; `best_factor` takes that out with help of the truth.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.evaluate.coc.reblur_ratio import COC_PER_SIGMA, SparseBlur

_COEFFICIENTS = 3
_SIGMAS_PX = np.linspace(0.1, 10.0, 50)
_WINDOW_PX = 5  # in which re-blurred and plate are compared
_TEXTURE_PX, _TEXTURE = 15, 1e-3  # variance counts as texture above this part of the largest


@dataclass(frozen=True, slots=True)
class Quadratic:
    """Blur as a polynomial of degree 2 of the disparity.

    Attributes:
        weights: of the powers 0 to 2 (3,) [px of sigma].
    """

    weights: Float64

    def coc_px(self, disparity: Float32) -> Float32:
        """Unsigned CoC diameter [px] of any shape from disparity, 0 to 1 in the plate [1]."""
        sigma = (_powers(disparity.ravel()) @ self.weights).reshape(disparity.shape)
        return np.asarray(COC_PER_SIGMA * np.maximum(sigma, 0), np.float32)


def fit_quadratic(blur: SparseBlur, disparity: Float32) -> Quadratic:
    """The polynomial of a plate; no blur at all where it is known nowhere.

    Args:
        blur: what the polynomial is fitted on.
        disparity: true disparity, 0 to 1 (H, W) [1].
    """
    if blur.known.sum() < _COEFFICIENTS:
        return Quadratic(np.zeros(_COEFFICIENTS))
    powers = _powers(disparity[blur.known])
    sigma = blur.sigma_px[blur.known].astype(np.float64)
    return Quadratic(np.asarray(np.linalg.lstsq(powers, sigma, rcond=None)[0], np.float64))


def quadratic_coc(blur: SparseBlur, disparity: Float32) -> Float32:
    """CoC diameter of a whole plate (H, W) [px]; all zero where the blur is known nowhere.

    Args:
        blur: what the polynomial is fitted on.
        disparity: true disparity, 0 to 1 (H, W) [1].
    """
    return fit_quadratic(blur, disparity).coc_px(disparity)


def nearest_blur(rgb: Float32, sharp: Float32) -> SparseBlur:
    """For each textured pixel the sigma that brings the sharp picture nearest to the plate.

    Args:
        rgb: the plate, display-coded in [0, 1] (H, W, 3).
        sharp: the same view through a pinhole (H, W, 3).
    """
    least = np.full(rgb.shape[:2], np.inf, np.float32)
    nearest = np.zeros(rgb.shape[:2], np.float32)
    for sigma in _SIGMAS_PX:
        blurred = cv2.GaussianBlur(sharp, (0, 0), float(sigma), borderType=cv2.BORDER_REFLECT)
        error = cv2.blur(np.mean((blurred - rgb) ** 2, axis=2), (_WINDOW_PX, _WINDOW_PX))
        better = error < least
        least[better], nearest[better] = error[better], sigma
    return SparseBlur(sigma_px=nearest, known=_textured(sharp))


def best_factor(coc: Float32, truth: Float32) -> float:
    """The factor that brings a map nearest to the truth in the least-squares sense [1]."""
    return float(np.sum(coc * truth) / max(float(np.sum(coc * coc)), 1e-12))


def _powers(disparity: Float32) -> Float64:
    values = disparity.astype(np.float64)
    return np.stack([np.ones_like(values), values, values**2], axis=-1)


def _textured(sharp: Float32) -> Bool:
    """Where the sharp picture has a variance from which a blur can be read (H, W)."""
    window = (_TEXTURE_PX, _TEXTURE_PX)
    mean = cv2.blur(sharp, window)
    variance = np.maximum(cv2.blur(sharp**2, window) - mean**2, 0).max(axis=2)
    return np.asarray(variance > _TEXTURE * variance.max())
