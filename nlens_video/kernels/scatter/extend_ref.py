"""The object's layer made ready to scatter, in the slow, obvious way: defines `extend`.

The transparent pixels around the object spread like it does, as its virtual background: only so can
the weights that arrive at a pixel be renormalised, and alpha stays 1 inside however the CoC varies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.core.aperture import ROUND, Aperture
from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.kernels.scatter.disc import MAX_COC_PX
from nlens_video.kernels.scatter.tables import coverage

Index = npt.NDArray[np.intp]

SKEW_FADE_PX = 1.5
"""CoC at which the skew of a disc is half in force [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceLayer:
    """What a scatter kernel reads: the object and the virtual background within reach of it.

    Attributes:
        box: where the arrays lie in the caller's array; reaches beyond it where the object is near
            a border.
        target: the pixels that the object can reach, inside both `box` and the caller's array.
        rgba: premultiplied colour and alpha (h, w, 4), 0 where the object is not.
        radius_px: signed radius in columns of each pixel's disc (h, w), NaN where a pixel takes no
            part [px].
        skew: how the light of a disc grows along columns and rows (h, w, 2), see `coc_skew`
            [1 / px].
        margin: how far discs reach at most [px].
    """

    box: Box
    target: Box
    margin: int
    rgba: Float32
    radius_px: Float32
    skew: Float32


def nearest_covered(covered: Bool) -> tuple[Index, Float32]:
    """Find each pixel's nearest covered one.

    Args:
        covered: where the object is (h, w), at least one pixel.

    Returns:
        Its place in the flattened array (h, w), and the distance to it (h, w), to about 2 % [px].
    """
    distance, labels = cv2.distanceTransformWithLabels(
        np.where(covered, np.uint8(0), np.uint8(1)),
        cv2.DIST_L2,
        cv2.DIST_MASK_5,
        labelType=cv2.DIST_LABEL_PIXEL,
    )
    place_of_label = np.zeros(int(labels.max()) + 1, dtype=np.intp)
    place_of_label[labels[covered]] = np.flatnonzero(covered)
    return place_of_label[labels], np.asarray(distance, dtype=np.float32)


@njit(cache=True, nogil=True)
def _step(before: np.float32, here: np.float32, after: np.float32) -> np.float32 | float:
    """The smaller of the steps to both neighbours, 0 where they disagree; NaN: no neighbour."""
    rise, fall = after - here, here - before
    if math.isnan(rise):
        return 0.0 if math.isnan(fall) else fall
    if math.isnan(fall):
        return rise
    if rise * fall <= 0.0:
        return 0.0
    return rise if abs(rise) < abs(fall) else fall


@njit(cache=True, nogil=True)
def coc_skew(coc_px: Float32) -> Float32:
    """How unevenly the lens fills each pixel's disc, because the CoC is not the same beside it.

    From the point u of the aperture, |u| <= 1, the pixel at p appears at p + coc / 2 * u, enlarged
    by the determinant of that map, 1 + u . grad(coc) / 2. So the point d = coc / 2 * u of the disc
    gets 1 + skew . d times its even share, skew = grad(coc) / coc. The gradient is limited: no step
    at a depth edge counts as slope, and none is steeper than 1 px a pixel.

    Args:
        coc_px: signed CoC diameter (h, w), NaN where the object is not [px].

    Returns:
        Skew along columns and rows (h, w, 2), fading out below `SKEW_FADE_PX`, where pixels are
        larger than discs; 0 where the object is not [1 / px].
    """
    height, width = coc_px.shape
    skew = np.zeros((height, width, 2), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            here = coc_px[y, x]
            if math.isnan(here):
                continue
            left = coc_px[y, x - 1] if x > 0 else np.float32(np.nan)
            right = coc_px[y, x + 1] if x + 1 < width else np.float32(np.nan)
            above = coc_px[y - 1, x] if y > 0 else np.float32(np.nan)
            below = coc_px[y + 1, x] if y + 1 < height else np.float32(np.nan)
            along, down = _step(left, here, right), _step(above, here, below)
            damped = here / (here * here + SKEW_FADE_PX * SKEW_FADE_PX)
            damped /= max(1.0, math.sqrt(along * along + down * down))
            skew[y, x, 0] = along * damped
            skew[y, x, 1] = down * damped
    return skew


def prepare(
    rgba: Float32, coc_px: Float32, pixel_aspect: float, aperture: Aperture = ROUND
) -> SourceLayer | None:
    """Check a layer and cut it to what can matter; None where it holds no covered pixel.

    Beyond a border of the array transparent pixels go on as virtual background; covered ones are
    not invented, so that weights there are renormalised with what lies inside.

    Raises:
        ValueError: shapes that do not belong together, values that are not finite.
    """
    if rgba.ndim != 3 or rgba.shape[2] != 4 or coc_px.shape != rgba.shape[:2]:
        raise ValueError(f"{rgba.shape = } must be (h, w, 4) and {coc_px.shape = } its (h, w)")
    if not (np.isfinite(pixel_aspect) and pixel_aspect > 0.0):
        raise ValueError(f"{pixel_aspect = } must be a positive number")
    covered = rgba[..., 3] > 0.0
    if not (np.isfinite(rgba).all() and np.isfinite(coc_px[covered]).all()):
        raise ValueError(
            "the layer holds colours or, where it is covered, CoCs that are not finite"
        )
    if not covered.any():
        return None
    whole = Box(0, 0, rgba.shape[1], rgba.shape[0])
    largest = 0.5 * min(float(np.abs(coc_px[covered]).max()), MAX_COC_PX)
    weights = coverage(aperture, largest * max(1.0, pixel_aspect), 1.0)
    margin = max(weights.shape) // 2
    box = Box.of(covered).expanded(2 * margin + 1)
    inside = box.intersection(whole)
    source, within = inside.slices_in(whole), inside.slices_in(box)
    shape = (box.height, box.width)
    mask = np.zeros(shape, dtype=np.bool_)
    mask[within] = covered[source]
    coc = np.full(shape, np.nan, dtype=np.float32)
    coc[within] = np.where(mask[within], coc_px[source], np.float32(np.nan))
    colour = np.zeros((*shape, 4), dtype=np.float32)
    colour[within] = np.where(mask[within][..., None], rgba[source], np.float32(0.0))
    nearest, distance = nearest_covered(mask)
    limit = np.float32(0.5 * MAX_COC_PX)
    radius = np.clip(np.float32(0.5) * coc.ravel()[nearest], -limit, limit)
    radius[_beyond_covered(mask, within) | (distance > 2 * margin + 1)] = np.nan
    skew = coc_skew(coc)  # even where the object is not: the CoC is carried on as it is
    target = Box.of(covered).expanded(margin).intersection(whole)
    return SourceLayer(
        box=box, target=target, margin=margin, rgba=colour, radius_px=radius, skew=skew
    )


def _beyond_covered(mask: Bool, within: tuple[slice, slice]) -> Bool:
    """Pixels outside `within` whose nearest pixel inside it is covered."""
    rows = np.clip(np.arange(mask.shape[0]), within[0].start, within[0].stop - 1)
    columns = np.clip(np.arange(mask.shape[1]), within[1].start, within[1].stop - 1)
    beyond = mask[rows][:, columns]
    beyond[within] = False
    return beyond
