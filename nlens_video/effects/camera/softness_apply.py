"""Floor softness: the object made as soft as the sharpest thing in the plate, and no softer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer

DRAWN_PX = 0.29  # sigma of a renderer's own antialiasing, a box of a pixel
NEGLIGIBLE_PX = 0.3
_SHARPEST = 0.05  # share of the object's pixels that counts as its sharpest part
_REACH = 3.0  # deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """How soft the sharpest thing in the plate is.

    Attributes:
        sigma_px: deviation of its blur, as a Gaussian [px].
    """

    sigma_px: float


def missing_sigma(floor: Floor, defocused: DefocusedLayer | None) -> float:
    """What the object's sharpest part lacks to the plate's, as a Gaussian [px].

    Args:
        floor: of the plate.
        defocused: the object and its CoC, None where it is in focus throughout.
    """
    lens_px = 0.0
    if defocused is not None:
        covered = defocused.layer.rgba[..., 3] > 0.0
        if covered.any():
            lens_px = float(np.quantile(np.abs(defocused.coc_px[covered]), _SHARPEST))
    variance = floor.sigma_px**2 - DRAWN_PX**2 - (0.25 * lens_px) ** 2
    return math.sqrt(max(0.0, variance))


def softened(blurred: BlurredLayer, sigma_px: float, frame: Box) -> BlurredLayer:
    """Soften a layer.

    Args:
        blurred: premultiplied, inside the frame.
        sigma_px: deviation of the Gaussian; below `NEGLIGIBLE_PX` the very layer comes back [px].
        frame: the frame's own box.
    """
    if blurred.box.empty or sigma_px < NEGLIGIBLE_PX:
        return blurred
    reach = math.ceil(_REACH * sigma_px)
    held, box = blurred.box, blurred.box.grown(reach).intersection(frame)
    # beyond the frame the object goes on as at its border
    top, bottom = held.y0 - box.y0, box.y1 - held.y1
    left, right = held.x0 - box.x0, box.x1 - held.x1
    wide = cv2.copyMakeBorder(
        blurred.rgba, top, bottom, left, right, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0)
    )
    side = 2 * reach + 1
    soft = cv2.GaussianBlur(wide, (side, side), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return BlurredLayer(box=box, rgba=np.asarray(soft, np.float32))
