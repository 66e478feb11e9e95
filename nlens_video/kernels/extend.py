"""The object's layer made ready to scatter: cut to its reach, its CoC carried past its silhouette.

The transparent pixels around the object spread like it does, as its virtual background: only so can
the weights that arrive at a pixel be renormalised, and alpha stays 1 inside however the CoC varies.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.frames import Bool, Box, Float32
from nlens_video.kernels.disc import MAX_COC_PX, reach


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceLayer:
    """What a scatter kernel reads: the object and the virtual background within reach of it.

    Attributes:
        box: where the arrays lie in the caller's array; reaches beyond it where the object is near
            a border.
        target: the pixels that the object can reach, inside both `box` and the caller's array.
        rgba: premultiplied colour and alpha (h, w, 4), 0 where the object is not.
        radius_px: radius in columns of each pixel's disc (h, w), -1 where a pixel takes no part.
    """

    box: Box
    target: Box
    rgba: Float32
    radius_px: Float32


def blur_reach(coc_px: Float32, alpha: Float32, pixel_aspect: float = 1.0) -> int:
    """Whole pixels by which the blurred object can exceed its silhouette, the larger of both axes.

    Args:
        coc_px: signed CoC diameter (h, w), read only where `alpha` > 0 [px, columns].
        alpha: coverage by the object (h, w).
        pixel_aspect: width of a pixel by its height, > 0 [1].
    """
    largest = float(np.max(np.abs(coc_px), where=alpha > 0.0, initial=0.0))
    return reach(0.5 * min(largest, MAX_COC_PX) * max(1.0, pixel_aspect))


def extend_coc(coc_px: Float32, covered: Bool) -> tuple[Float32, Float32]:
    """Give every pixel the CoC of the nearest covered one.

    Args:
        coc_px: signed CoC diameter (h, w), read only where `covered` [px].
        covered: where the object is (h, w), at least one pixel.

    Returns:
        The CoC everywhere (h, w) [px], and the distance to the nearest covered pixel (h, w), to
        about 2 % [px].
    """
    distance, labels = cv2.distanceTransformWithLabels(
        np.where(covered, np.uint8(0), np.uint8(1)),
        cv2.DIST_L2,
        cv2.DIST_MASK_5,
        labelType=cv2.DIST_LABEL_PIXEL,
    )
    by_label = np.zeros(int(labels.max()) + 1, dtype=np.float32)
    by_label[labels[covered]] = coc_px[covered]
    return by_label[labels], np.asarray(distance, dtype=np.float32)


def prepare(rgba: Float32, coc_px: Float32, pixel_aspect: float) -> SourceLayer | None:
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
    margin = blur_reach(coc_px, rgba[..., 3], pixel_aspect)
    box = _bounds(covered).grown(2 * margin + 1)
    inside = box.intersection(whole)
    source, within = inside.slices_in(whole), inside.slices_in(box)
    shape = (box.height, box.width)
    mask = np.zeros(shape, dtype=np.bool_)
    mask[within] = covered[source]
    coc = np.zeros(shape, dtype=np.float32)
    coc[within] = coc_px[source]
    coc, distance = extend_coc(coc, mask)
    colour = np.zeros((*shape, 4), dtype=np.float32)
    colour[within] = np.where(mask[within][..., None], rgba[source], np.float32(0.0))
    radius = np.float32(0.5) * np.minimum(np.abs(coc), np.float32(MAX_COC_PX))
    radius[_beyond_covered(mask, within) | (distance > 2 * margin + 1)] = -1.0
    target = _bounds(covered).grown(margin).intersection(whole)
    return SourceLayer(box=box, target=target, rgba=colour, radius_px=radius)


def _bounds(covered: Bool) -> Box:
    rows = np.flatnonzero(covered.any(axis=1))
    columns = np.flatnonzero(covered.any(axis=0))
    return Box(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def _beyond_covered(mask: Bool, within: tuple[slice, slice]) -> Bool:
    """Pixels outside `within` whose nearest pixel inside it is covered."""
    rows = np.clip(np.arange(mask.shape[0]), within[0].start, within[0].stop - 1)
    columns = np.clip(np.arange(mask.shape[1]), within[1].start, within[1].stop - 1)
    beyond = mask[rows][:, columns]
    beyond[within] = False
    return beyond
