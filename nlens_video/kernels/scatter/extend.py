"""Source layer of the scatter: cropped to its reach, the CoC extended past the silhouette.

Transparent pixels around the object scatter too, as virtual background with the CoC of the nearest
covered pixel: only so do the arriving weights normalise, and alpha stays 1 inside however the CoC
varies.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.scatter.disc import MAX_COC_PX
from nlens_video.kernels.scratch import scratch
from nlens_video.kernels.thread_pool import bands, parallel_for, run_all
from nlens_video.native import kernels

Int32 = npt.NDArray[np.int32]

SKEW_FADE_PX = 1.5
"""CoC at which the skew of a disc is half in force [px]."""
BAND_ROWS = 32
"""Rows that a thread takes at a time."""


class Silhouette(Struct, frozen=True, kw_only=True):
    """Where a layer's object lies, row by row.

    Attributes:
        first: the first covered column of each row (h,) [px].
        last: the last one, -1 where a row has none (h,) [px].
        largest_coc_px: the largest size of a covered pixel's CoC (h,) [px].
    """

    first: Int32
    last: Int32
    largest_coc_px: Float32

    @property
    def bounds(self) -> Box:
        """The least box around it, empty where nothing is covered [px]."""
        rows = np.flatnonzero(self.last >= 0)
        if rows.size == 0:
            return Box(0, 0, 0, 0)
        x0, x1 = int(self.first[rows].min()), int(self.last[rows].max()) + 1
        return Box(x0, int(rows[0]), x1, int(rows[-1]) + 1)


class SourceLayer(Struct, frozen=True, kw_only=True):
    """What a scatter kernel reads: the object and the virtual background within reach of it.

    Attributes:
        box: where the arrays lie in the caller's array; reaches beyond it where the object is near
            a border.
        rgba: premultiplied colour and alpha (h, w, 4), 0 where the object is not.
        radius_px: signed radius in columns of each pixel's disc (h, w), NaN where a pixel takes no
            part [px].
        skew: how the light of a disc grows along columns and rows (2, h, w), see
            `scatter_ref.coc_skew` [1 / px].
    """

    box: Box
    rgba: Float32
    radius_px: Float32
    skew: Float32


def survey(rgba: Float32, coc_px: Float32, threads: int | None) -> Silhouette:
    """Find the object in a layer.

    Raises:
        ValueError: colours or, where the layer is covered, CoCs that are not finite.
    """
    rows = rgba.shape[0]
    first, last = np.empty(rows, np.int32), np.empty(rows, np.int32)
    largest = np.empty(rows, np.float32)
    parallel_for(
        partial(kernels.survey_layer, rgba, coc_px, first, last, largest),
        bands(rows, BAND_ROWS),
        threads,
    )
    if np.isnan(largest).any():
        raise ValueError(
            "the layer holds colours or, where it is covered, CoCs that are not finite"
        )
    return Silhouette(first=first, last=last, largest_coc_px=largest)


def _find_nearest(
    away: npt.NDArray[np.uint8], labels: Int32, places: Int32, distance: Float32
) -> None:
    """Fill in each pixel's label, the labels' places and the distance to them."""
    cv2.distanceTransformWithLabels(
        away, cv2.DIST_L2, cv2.DIST_MASK_5, distance, labels, labelType=cv2.DIST_LABEL_PIXEL
    )
    kernels.find_places(away, labels, places)


def lay_out(
    rgba: Float32, coc_px: Float32, bounds: Box, margin: int, threads: int | None
) -> SourceLayer:
    """Crop a layer, of contiguous arrays, to its reach and extend its CoC past the silhouette.

    Beyond a border of the array transparent pixels go on as virtual background; covered ones are
    not invented, so that weights there are renormalised with what lies inside.

    Args:
        rgba: premultiplied colour and alpha (h, w, 4).
        coc_px: signed CoC diameter (h, w) [px].
        bounds: the covered pixels' box, not empty.
        margin: how far the object reaches beyond it [px].
        threads: maximum number of threads.
    """
    box = bounds.expanded(2 * margin + 1)
    corner = (box.y0, box.x0)
    away = scratch("away", (box.height, box.width), np.uint8)
    coc, parts = scratch("coc", away.shape), bands(box.height, BAND_ROWS)
    parallel_for(partial(kernels.cut_layer, rgba, coc_px, corner, coc, away), parts, threads)
    distance, labels = scratch("distance", away.shape), scratch("labels", away.shape, np.int32)
    colours = scratch("colours", (*away.shape, 4))
    radii = scratch("radii", away.shape)
    skews = scratch("skews", (2, *away.shape))
    made = colours, radii, skews
    limits = (2.0 * margin + 1.0, 0.5 * MAX_COC_PX, SKEW_FADE_PX)
    places = scratch("places", (away.size + 1, 2), np.int32)
    # One thread finds what is nearest, which OpenCV does on one only, while others go on.
    find = partial(_find_nearest, away, labels, places, distance)
    own = partial(kernels.lay_out_object, rgba, coc, away, made, corner, limits)
    run_all([find, *(partial(own, part) for part in parts)], threads)
    nearest = labels, places, distance
    parallel_for(
        partial(kernels.lay_out_background, rgba, nearest, away, made, corner, limits),
        parts,
        threads,
    )
    return SourceLayer(box=box, rgba=colours, radius_px=radii, skew=skews)
