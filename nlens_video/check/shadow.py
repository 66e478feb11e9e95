"""Where the result is the plate with less light.

A loss of light reduces code values of luma, colour differences and detail by about one factor.
"""

from __future__ import annotations

import cv2
import numpy as np

from nlens_video.check.frames import Pair
from nlens_video.check.regions import Mask
from nlens_video.core.layers import Bool, Float32

LEAST_TOLERANCE = 1.5
"""Change of a block's mean by conversion and rounding [level]."""
_FLAT = 1.0  # detail below which only noise differs from frame to frame [level]
_DARKEST = 0.1  # remaining share of a code value in the deepest shadow [1]
_TINT = 0.06  # change of hue by a shadow, which has the sky's light and not the lamp's [1]
_MOST = 0.9  # of the region's blocks [1]
_LEAST_BLOCKS = 3  # edge of a square of blocks; a single one of the object may be as dark by chance


def is_shadow(pair: Pair, mask: Mask, tolerance: float) -> bool:
    """Whether a region is the plate with less light."""
    kept, hue, lost, expected = (one[mask] for one in _losses(pair))
    return (
        bool(_darker(pair)[mask].all() and kept.min() > _DARKEST)
        and float(np.quantile(hue, _MOST)) <= tolerance + _TINT * (1.0 - float(kept.mean())) * 255.0
        and float(np.quantile(lost, _MOST)) <= _FLAT + 0.5 * float(expected.mean())
    )


def shadowed(pair: Pair, tolerance: float) -> Mask:
    """Blocks (h, w) of the plate with less light, in areas that are no chance."""
    kept, hue, lost, expected = _losses(pair)
    alike = _darker(pair) & (kept > _DARKEST) & (kept < 1.0)
    alike &= (hue <= tolerance + _TINT * (1.0 - kept) * 255.0) & (lost <= _FLAT + 0.5 * expected)
    square = np.ones((_LEAST_BLOCKS, _LEAST_BLOCKS), np.uint8)
    return cv2.morphologyEx(alike.astype(np.uint8), cv2.MORPH_OPEN, square).astype(bool)


def _darker(pair: Pair) -> Bool:
    """Blocks (h, w) that are no lighter, and as opaque as the plate."""
    opaque = np.abs(pair.alpha_change) <= LEAST_TOLERANCE
    no_lighter = pair.result.colour[..., 0] <= pair.plate.colour[..., 0] + LEAST_TOLERANCE
    return np.asarray(no_lighter & opaque, bool)


def _losses(pair: Pair) -> tuple[Float32, Float32, Float32, Float32]:
    """Of each block (h, w): share of light left, change of hue and detail, detail expected."""
    plate, result = pair.plate.colour, pair.result.colour
    kept = np.asarray(result[..., 0] / np.maximum(plate[..., 0], 1.0), np.float32)
    hue = np.abs(result[..., 1:] - kept[..., None] * plate[..., 1:]).max(axis=2)
    expected = np.asarray(kept * pair.plate.detail, np.float32)
    lost = np.asarray(np.abs(pair.result.detail - expected), np.float32)
    return kept, np.asarray(hue, np.float32), lost, expected
