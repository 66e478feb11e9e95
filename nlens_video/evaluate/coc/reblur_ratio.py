"""Classical baseline: blur at edges from the ratio of gradients before and after a re-blur.

S. Zhuo and T. Sim, "Defocus map estimation from a single image", Pattern Recognition 44 (2011).
A step edge blurred by a Gaussian of sigma has its gradient peak proportional to 1 / sigma, so the
ratio of two re-blurred gradients gives sigma. Noise and the sampled derivative ask for a Gaussian
before each gradient, so both gradients are taken of re-blurred pictures with known sigmas.

Simplified against the paper: the sparse map is propagated by an edge-aware weighted least squares
smoother (Min et al. 2014, `cv2.ximgproc`) instead of the matting Laplacian.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Float32

COC_PER_SIGMA = 4.0  # a disc of diameter D has a variance of D^2 / 16 along each axis
LARGEST_SIGMA_PX = 16.0  # of CoC 64 px: what the network is made for
# Sigmas of the re-blur: of 1/1.5, 2/3, 3/4.5 and 4/6 these serve rendered plates best (RMSE 7.2,
# 5.3, 5.3 and 5.5 px); small ones are lost in the grain where the blur is large.
_FIRST_PX, _SECOND_PX = 2.0, 3.0
_DIFFERENCE_VARIANCE = 1 / 3  # a central difference averages the slope over two pixels [px^2]
_CANNY_TOP = 16000  # it takes gradients as whole numbers of 16 bits
_HIGH, _LOW = 0.1, 0.04  # Canny's thresholds, parts of the largest gradient
_BILATERAL_PX, _BILATERAL_CODES = 7.0, 26.0  # of the joint bilateral filter of the sparse map
_SMOOTH, _SMOOTH_CODES = 8000.0, 8.0  # of the propagation


@dataclass(frozen=True, slots=True, kw_only=True)
class SparseBlur:
    """Blur where it can be read.

    Attributes:
        sigma_px: sigma of the Gaussian blur (H, W), any number where it is not known [px].
        known: pixels at which it is known (H, W).
    """

    sigma_px: Float32
    known: Bool


def edge_blur(rgb: Float32) -> SparseBlur:
    """Sigma of the blur at a picture's edges.

    Args:
        rgb: display-coded picture in [0, 1] (H, W, 3).
    """
    grey = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.float32)
    first, second = _gradient(grey, _FIRST_PX), _gradient(grey, _SECOND_PX)
    edges = _edges(grey) & (second > 1e-6)
    squared = np.square(np.divide(first, second, out=np.ones_like(first), where=edges))
    with np.errstate(divide="ignore", invalid="ignore"):
        # R^2 = (sigma^2 + second^2) / (sigma^2 + first^2), sigma that of picture and difference
        variance = (_SECOND_PX**2 - squared * _FIRST_PX**2) / (squared - 1) - _DIFFERENCE_VARIANCE
    edges &= squared > 1  # a lesser ratio is no single edge
    sigma = np.sqrt(np.clip(np.where(edges, variance, 0), 0, LARGEST_SIGMA_PX**2))
    return SparseBlur(sigma_px=np.asarray(sigma, np.float32), known=edges)


def reblur_ratio_coc(rgb: Float32) -> Float32:
    """CoC diameter of a whole picture (H, W) [px of the picture]; no edge at all gives zeros.

    Args:
        rgb: display-coded picture in [0, 1] (H, W, 3).
    """
    sparse = edge_blur(rgb)
    if not sparse.known.any():
        return np.zeros(rgb.shape[:2], np.float32)
    guide = np.asarray(np.round(255 * np.clip(rgb, 0, 1)), np.uint8)
    known = sparse.known.astype(np.float32)
    codes = guide.astype(np.float32)
    filtered, weight = (
        cv2.ximgproc.jointBilateralFilter(codes, values, -1, _BILATERAL_CODES, _BILATERAL_PX)
        for values in (sparse.sigma_px * known, known)
    )
    at_edges = np.where(sparse.known, filtered / np.maximum(weight, 1e-6), 0).astype(np.float32)
    spread, weight = (
        cv2.ximgproc.fastGlobalSmootherFilter(guide, values, _SMOOTH, _SMOOTH_CODES)
        for values in (at_edges, known)
    )
    reached = weight > 1e-6
    middle = float(np.median(at_edges[sparse.known]))
    sigma = np.where(reached, spread / np.maximum(weight, 1e-6), middle)
    return np.asarray(COC_PER_SIGMA * np.clip(sigma, 0, LARGEST_SIGMA_PX), np.float32)


def _gradient(grey: Float32, sigma: float) -> Float32:
    """Magnitude of the gradient of a re-blurred picture, by central differences."""
    blurred = cv2.GaussianBlur(grey, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    across, down = (
        cv2.Sobel(blurred, cv2.CV_32F, dx, 1 - dx, ksize=1, borderType=cv2.BORDER_REFLECT)
        for dx in (1, 0)
    )
    return np.hypot(across, down)


def _edges(grey: Float32) -> Bool:
    """Canny's edges, its thresholds parts of the largest gradient."""
    blurred = cv2.GaussianBlur(grey, (0, 0), _FIRST_PX, borderType=cv2.BORDER_REFLECT)
    across, down = (cv2.Sobel(blurred, cv2.CV_32F, dx, 1 - dx) for dx in (1, 0))
    top = float(np.abs(np.stack([across, down])).max())
    if top < 1e-4:
        return np.zeros(grey.shape, np.bool_)
    unit = _CANNY_TOP / top
    dx, dy = (np.asarray(np.round(unit * part), np.int16) for part in (across, down))
    found = cv2.Canny(dx, dy, _LOW * _CANNY_TOP, _HIGH * _CANNY_TOP, L2gradient=True)
    return np.asarray(found > 0)
