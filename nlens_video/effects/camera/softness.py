"""Floor softness: blur of the plate's sharpest edges, measured on the plate, applied to the object.

Sensor, codec and resampling soften everything, in focus or not; the renderer's object must not be
sharper than the sharpest edge of the plate. The gradient of a step edge that is blurred by a
Gaussian falls under two further blurs in a ratio that gives its sigma (Zhuo and Sim 2011); two such
ratios of three blurs agree at a step and disagree in texture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, Int64, Picture
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.plate_pictures import PlatePictures

EFFECT = "softness"
THRESHOLD_PX = 1.0  # sigma: twice that of the renderer's own antialiasing
_PICTURES = 4
_BLURS_PX = (0.8, 1.4, 2.2)
_DIFFERENCE_VARIANCE = 1 / 3  # a central difference averages the slope over two pixels [px^2]
_LEAST_SLOPE = 0.02  # of an edge, code values by pixel
_AGREEMENT = 0.25  # of two variances of one step
_SHARPEST = 0.2  # share of the steps; fewer are mistaken for sharper than they are
_BIAS_PX = 0.15  # by which that share lies below the truth, measured on uniformly soft scenes
_LEAST_STEPS = 100
_ANYTHING_SHARP = (0.97, 0.02, 0.2)  # of the steepest places, a few this sharp [px] are enough
_LENS_PX = 1.8  # softer than that, nothing in the plate is in focus, and the lens is to blame
_COST_MS_PER_MEGAPIXEL = 12.0  # measured, of the object's box
_BOX_SHARE = 0.15  # of the frame, that an object's box is taken to cover


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on a shot's first pictures, at least one."""
    still = PlatePictures.of(pictures).still()[0][:_PICTURES]
    mean = sum(still[1:], start=still[0]) / np.float32(len(still))
    grey = cv2.cvtColor(mean, cv2.COLOR_RGB2GRAY)
    sigma_px, evidence = _floor(np.asarray(grey, np.float32))
    height, width = pictures[0].height, pictures[0].width
    return Measurement(
        effect=EFFECT, value=sigma_px, threshold=THRESHOLD_PX, unit="px (sigma)",
        evidence=evidence, model=SharpnessFloor(sigma_px=sigma_px) if sigma_px > 0.0 else None,
        cost_ms=_COST_MS_PER_MEGAPIXEL * _BOX_SHARE * width * height / 1e6,
    )  # fmt: skip


def _floor(grey: Float32) -> tuple[float, str]:
    """Sigma of the sharpest steps [px], 0 where they are sharp or unknown; the evidence."""
    slopes = [_slope(grey, blur) for blur in _BLURS_PX]
    steepness = np.hypot(*slopes[0])
    crest = _crest(*slopes[0], steepness)
    fine, middle, coarse = (np.hypot(across[crest], down[crest]) for across, down in slopes)
    first = _variance(fine, middle, _BLURS_PX[:2])
    second = _variance(middle, coarse, _BLURS_PX[1:])
    share, few, sharp_px = _ANYTHING_SHARP
    steep = fine > float(np.quantile(steepness, share))
    if not steep.any() or np.quantile(first[steep], few) < sharp_px**2:
        return 0.0, "the sharpest edges of the plate are sharp"
    step = np.abs(first - second) < _AGREEMENT * (np.maximum(first, 0.0) + 0.3)
    if step.sum() < _LEAST_STEPS:
        return 0.0, "too few clear edges in the plate"
    variance = np.maximum(0.5 * (first + second)[step], 0.0)
    sigma_px = float(np.sqrt(np.quantile(variance, _SHARPEST))) + _BIAS_PX
    if sigma_px > _LENS_PX:
        return 0.0, "nothing in the plate is in focus, so the camera's softness cannot be measured"
    return sigma_px, f"sharpest of {int(step.sum())} edge pixels"


def _slope(grey: Float32, blur_px: float) -> tuple[Float32, Float32]:
    """Gradient along columns and rows of a blurred picture."""
    blurred = cv2.GaussianBlur(grey, (0, 0), blur_px, borderType=cv2.BORDER_REFLECT)
    across, down = (
        np.asarray(cv2.Sobel(blurred, cv2.CV_32F, dx, 1 - dx, ksize=1, scale=0.5), np.float32)
        for dx in (1, 0)
    )
    return across, down


def _crest(across: Float32, down: Float32, steepness: Float32) -> tuple[Int64, Int64]:
    """Rows and columns of the edges' pixels, at which the gradient is greatest across its edge."""
    row, column = np.nonzero(steepness > _LEAST_SLOPE)
    size = steepness[row, column]
    flat = (np.abs(across[row, column]) >= np.abs(down[row, column])).astype(np.int64)
    padded = np.pad(steepness, 1, mode="edge")
    before = padded[row + flat, column + 1 - flat]
    after = padded[row + 2 - flat, column + 1 + flat]
    greatest = (size >= before) & (size > after)
    return row[greatest], column[greatest]


def _variance(fine: Float32, coarse: Float32, blurs_px: tuple[float, ...]) -> Float32:
    """Variance of an edge's own blur from its slope under two further ones (N,) [px^2]."""
    squared = np.square(fine / np.maximum(coarse, 1e-6))
    first, second = blurs_px
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = (second**2 - squared * first**2) / (squared - 1.0) - _DIFFERENCE_VARIANCE
    far = np.float32(1e3)  # a lesser ratio is no single edge
    return np.asarray(np.where(squared > 1.0, np.minimum(variance, far), far), np.float32)


DRAWN_PX = 0.29  # sigma of a renderer's own antialiasing, a box of a pixel
NEGLIGIBLE_PX = 0.3
_SHARPEST_PART = 0.05  # share of the object's pixels that counts as its sharpest part
_REACH = 3.0  # deviations


class SharpnessFloor(Struct, frozen=True, kw_only=True):
    """Blur of the plate's sharpest edges.

    Attributes:
        sigma_px: standard deviation, as a Gaussian [px].
    """

    sigma_px: float


def missing_sigma(floor: SharpnessFloor, defocused: DefocusedLayer | None) -> float:
    """Sigma of the blur that the object's sharpest part lacks to the plate's, as a Gaussian [px].

    `defocused` is the object with its CoC, None where it is in focus throughout.
    """
    lens_px = 0.0
    if defocused is not None:
        covered = defocused.layer.rgba[..., 3] > 0.0
        if covered.any():
            lens_px = float(np.quantile(np.abs(defocused.coc_px[covered]), _SHARPEST_PART))
    variance = floor.sigma_px**2 - DRAWN_PX**2 - (0.25 * lens_px) ** 2
    return math.sqrt(max(0.0, variance))


def soften(blurred: BlurredLayer, sigma_px: float, frame: Box) -> BlurredLayer:
    """A premultiplied layer blurred by a Gaussian; the same below `NEGLIGIBLE_PX`."""
    if blurred.box.empty or sigma_px < NEGLIGIBLE_PX:
        return blurred
    reach = math.ceil(_REACH * sigma_px)
    held, box = blurred.box, blurred.box.expanded(reach).intersection(frame)
    # beyond the border of the frame the layer is extended
    top, bottom = held.y0 - box.y0, box.y1 - held.y1
    left, right = held.x0 - box.x0, box.x1 - held.x1
    wide = cv2.copyMakeBorder(
        blurred.rgba, top, bottom, left, right, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0)
    )
    side = 2 * reach + 1
    soft = cv2.GaussianBlur(wide, (side, side), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return BlurredLayer(box=box, rgba=np.asarray(soft, np.float32))
