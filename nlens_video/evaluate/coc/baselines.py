"""Baselines of stages F and R: published estimates of the CoC, and the paper's own line.

Re-blur ratio: S. Zhuo and T. Sim, "Defocus map estimation from a single image", Pattern Recognition
44 (2011). A step edge blurred by a Gaussian of sigma has its gradient peak proportional to
1 / sigma, so the ratio of two re-blurred gradients gives sigma. Noise and the sampled derivative
ask for a Gaussian before each gradient, so both gradients are taken of re-blurred pictures with
known sigmas. The sparse map is propagated twice: as in the paper by the matting Laplacian, at a
width of 320 px at most (`matting`), and simplified by an edge-aware weighted least squares smoother
(Min et al. 2014, `cv2.ximgproc`) at full size.

Quadratic: P. Prakash et al., "Blind Augmentation" (IEEE VR 2025). As its release does: for each
pixel the Gaussian whose re-blur of the sharp picture is nearest to the plate in a small window,
then one polynomial of degree 2 of sigma in disparity, by least squares over the textured pixels.
All in display code. Its most favourable case: disparity is the true one instead of a monocular
estimate, the sharp picture a pinhole rendering instead of a deblurring network's, and sigma goes as
far as its analysis does; the 15x15 kernel of its compositing would cut it at a CoC of about 17 px.
The Gaussian nearest to a disc is wider than the one of the same variance, so the diameters come out
some 15 to 25 % too large; `best_factor` takes that out with help of the truth.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Bool, CocMap, Float32, Float64, UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.coc.matting import spread_by_matting
from nlens_video.evaluate.plates import Plate
from nlens_video.stages.p_projection import GroundProjection

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
_COEFFICIENTS = 3
_SIGMAS_PX = np.linspace(0.1, 10.0, 50)
_WINDOW_PX = 5  # in which re-blurred and plate are compared
_TEXTURE_PX, _TEXTURE = 15, 1e-3  # variance counts as texture above this part of the largest
IN_FOCUS_PX = 2.0  # the paper does not state how small a CoC is "in focus"
_SMALLEST = 0.05  # share of the samples taken for the smallest CoC; one alone would be noise
_MIN_SAMPLES = 48


class SparseBlur(Struct, frozen=True, kw_only=True):
    """Sigma of a Gaussian blur (H, W) [px], any number where it is not `known` (H, W)."""

    sigma_px: Float32
    known: Bool


def edge_blur(rgb: Float32) -> SparseBlur:
    """Sigma of the blur at the edges of a display-coded picture in [0, 1] (H, W, 3)."""
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
    """CoC diameter (H, W) of a display-coded picture in [0, 1] [px]; no edge at all gives zeros.

    Propagated from the edges by the smoother.
    """
    sparse = filtered(rgb, edge_blur(rgb))
    if not sparse.known.any():
        return np.zeros(rgb.shape[:2], np.float32)
    guide = _codes(rgb)
    known = sparse.known.astype(np.float32)
    spread, weight = (
        cv2.ximgproc.fastGlobalSmootherFilter(guide, values, _SMOOTH, _SMOOTH_CODES)
        for values in (sparse.sigma_px * known, known)
    )
    reached = weight > 1e-6
    middle = float(np.median(sparse.sigma_px[sparse.known]))
    sigma = np.where(reached, spread / np.maximum(weight, 1e-6), middle)
    return np.asarray(COC_PER_SIGMA * np.clip(sigma, 0, LARGEST_SIGMA_PX), np.float32)


def matting_coc(rgb: Float32) -> Float32:
    """As `reblur_ratio_coc`, propagated by the matting Laplacian."""
    sparse = filtered(rgb, edge_blur(rgb))
    if not sparse.known.any():
        return np.zeros(rgb.shape[:2], np.float32)
    sigma = spread_by_matting(rgb, sparse.sigma_px, sparse.known)
    return np.asarray(COC_PER_SIGMA * np.clip(sigma, 0, LARGEST_SIGMA_PX), np.float32)


def filtered(rgb: Float32, sparse: SparseBlur) -> SparseBlur:
    """The sparse blur after a joint bilateral filter, against outliers among the edges."""
    known = sparse.known.astype(np.float32)
    codes = _codes(rgb).astype(np.float32)
    sums, weight = (
        cv2.ximgproc.jointBilateralFilter(codes, values, -1, _BILATERAL_CODES, _BILATERAL_PX)
        for values in (sparse.sigma_px * known, known)
    )
    sigma = np.where(sparse.known, sums / np.maximum(weight, 1e-6), 0)
    return SparseBlur(sigma_px=np.asarray(sigma, np.float32), known=sparse.known)


def _codes(rgb: Float32) -> UInt8:
    return np.asarray(np.round(255 * np.clip(rgb, 0, 1)), np.uint8)


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


def _textured(sharp: Float32) -> Bool:
    """Where the sharp picture has a variance from which a blur can be read (H, W)."""
    window = (_TEXTURE_PX, _TEXTURE_PX)
    mean = cv2.blur(sharp, window)
    variance = np.maximum(cv2.blur(sharp**2, window) - mean**2, 0).max(axis=2)
    return np.asarray(variance > _TEXTURE * variance.max())


class Quadratic(Struct, frozen=True):
    """Sigma as a polynomial of disparity: weights of its powers 0 to 2 (3,) [px]."""

    weights: Float64

    @classmethod
    def fit(cls, blur: SparseBlur, disparity: Float32) -> Quadratic:
        """The polynomial of a plate of disparity 0 to 1, or nan (H, W); 0 for no known blur."""
        known = blur.known & np.isfinite(disparity)
        if known.sum() < _COEFFICIENTS:
            return cls(np.zeros(_COEFFICIENTS))
        weights = np.linalg.lstsq(_powers(disparity[known]), blur.sigma_px[known], rcond=None)[0]
        return cls(np.asarray(weights, np.float64))

    def coc_px(self, disparity: Float32) -> Float32:
        """Unsigned CoC diameter [px] of any shape from disparity, 0 to 1 in the plate [1]."""
        sigma = (_powers(disparity.ravel()) @ self.weights).reshape(disparity.shape)
        return np.asarray(COC_PER_SIGMA * np.maximum(sigma, 0), np.float32)


def quadratic_coc(blur: SparseBlur, disparity: Float32) -> Float32:
    """CoC diameter (H, W) of the plate whose blur and disparity, 0 to 1 (H, W), are given [px]."""
    return Quadratic.fit(blur, disparity).coc_px(disparity)


def _powers(disparity: Float32) -> Float64:
    values = disparity.astype(np.float64)
    return np.stack([np.ones_like(values), values, values**2], axis=-1)


def best_factor(coc: Float32, truth: Float32) -> float:
    """The factor that brings a map nearest to the truth, where known, by least squares [1]."""
    return float(np.nansum(coc * truth) / max(float(np.sum(coc[np.isfinite(truth)] ** 2)), 1e-12))


def best_constant(truth: Float32) -> Float32:
    """The constant map (H, W) with the least RMSE against a true CoC (H, W), its mean [px].

    It is taken from the truth: an estimate has to beat it before it says anything about the plate.
    """
    return np.full(truth.shape, np.nanmean(truth), np.float32)


class Baseline(Struct, frozen=True, kw_only=True):
    """A way to estimate the CoC of a whole plate.

    Attributes:
        name: of its row.
        given: its inputs beside the plate, in words; empty if none.
        estimate: unsigned CoC (H, W) [px], None on a plate that lacks what it needs.
        also_scaled: whether it is also shown with the factor that suits the truth best.
    """

    name: str
    given: str = ""
    estimate: Callable[[Plate], Float32 | None]
    also_scaled: bool = False


def _from_sharp(plate: Plate) -> Float32 | None:
    if plate.sharp is None:
        return None
    return quadratic_coc(nearest_blur(plate.rgb, plate.sharp), plate.relative_disparity)


BASELINES = (
    Baseline(
        name="Zhuo & Sim 2011, re-blur ratio", estimate=lambda plate: reblur_ratio_coc(plate.rgb)
    ),
    Baseline(name="Zhuo & Sim 2011, matting", estimate=lambda plate: matting_coc(plate.rgb)),
    Baseline(
        name="Blind Augmentation on edges",
        given="the true depth of every pixel, and reads the blur at edges by the re-blur ratio",
        estimate=lambda plate: quadratic_coc(edge_blur(plate.rgb), plate.relative_disparity),
    ),
    Baseline(
        name="Blind Augmentation on the sharp picture",
        given="the true depth of every pixel and the true sharp picture of the same view",
        estimate=_from_sharp,
        also_scaled=True,
    ),
    Baseline(
        name="best constant",
        given="the mean of the true CoC",
        estimate=lambda plate: best_constant(plate.true_coc_px),
    ),
)
SCALED = ", best factor"
NOTE = (
    f"{'; '.join(f'{base.name} is given {base.given}' for base in BASELINES if base.given)}. With "
    "the best factor its diameters are also scaled by the factor that suits the truth of that "
    "plate best. A dash: no sharp picture was rendered. Our estimate and Zhuo & Sim's are given "
    "the plate alone."
)


def fit_line(coc: CocMap, ground: GroundProjection) -> LensFit:
    """The paper's regression (section 4.2) on the footprint: signs by a rule, then least squares.

    No small CoC within the footprint: all of it lies on one side of the focus, and the slope of the
    line through the unsigned CoC tells which. Otherwise what lies beyond the smallest CoC is
    negative.

    Args:
        coc: the plate's CoC (H, W); its sigma is not used.
        ground: footprint and plane on the same frame.

    Raises:
        LensFitError: too small a footprint.
    """
    unsigned = coc.coc_px[ground.mask].astype(np.float64)
    disparity = ground.disparity[ground.mask]
    if len(unsigned) < _MIN_SAMPLES:
        raise LensFitError(f"{len(unsigned)} px of footprint, {_MIN_SAMPLES} are needed")
    smallest = unsigned <= np.quantile(unsigned, _SMALLEST)
    signed = unsigned
    if unsigned[smallest].max() < IN_FOCUS_PX:
        signed = np.where(disparity < np.median(disparity[smallest]), -unsigned, unsigned)
    design = np.stack([disparity, np.ones_like(disparity)], axis=1)
    slope, intercept = np.linalg.lstsq(design, signed, rcond=None)[0].tolist()
    if signed is unsigned and slope < 0:  # blur grows with distance: all lies behind the focus
        slope, intercept, signed = -slope, -intercept, -unsigned
    residual = slope * disparity + intercept - signed
    height, width = coc.coc_px.shape
    return LensFit(
        slope=slope, intercept=intercept, rmse_px=float(np.sqrt(np.mean(residual**2))),
        n=len(unsigned), width=width, height=height, sign="assumed",
        method="the paper's rule and least-squares line on the footprint",
    )  # fmt: skip
