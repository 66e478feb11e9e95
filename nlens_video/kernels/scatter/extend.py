"""Source layer of the scatter: cropped to its reach, the CoC extended past the silhouette.

Transparent pixels around the object scatter too, as virtual background with the CoC of the nearest
covered pixel: only so do the arriving weights normalise, and alpha stays 1 inside however the CoC
varies. Constants of other files come as arguments, see `scatter_rows`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.scatter.disc import MAX_COC_PX
from nlens_video.kernels.thread_pool import Band, bands, parallel_for, run_all, scratch

Int32 = npt.NDArray[np.int32]
Made = tuple[Float32, Float32, Float32]

SKEW_FADE_PX = 1.5
"""CoC at which the skew of a disc is half in force [px]."""
BAND_ROWS = 32
"""Rows that a thread takes at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Silhouette:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceLayer:
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


@njit(cache=True, nogil=True, error_model="numpy")
def _survey(
    rgba: Float32, coc_px: Float32, first: Int32, last: Int32, largest: Float32, band: Band
) -> None:
    """Fill rows of a silhouette; a value that is not finite makes `largest` NaN."""
    width = rgba.shape[1]
    for y in range(band[0], band[1]):
        start, stop, most = width, -1, np.float32(0.0)
        finite = True
        for x in range(width):
            alpha = rgba[y, x, 3]
            total = float(rgba[y, x, 0]) + float(rgba[y, x, 1]) + float(rgba[y, x, 2]) + alpha
            finite &= math.isfinite(total)
            if alpha > 0.0:
                start, stop = min(start, x), x
                size = abs(coc_px[y, x])
                finite &= math.isfinite(size)
                most = max(most, size)
        first[y], last[y] = start, stop
        largest[y] = most if finite else np.float32(np.nan)


def survey(rgba: Float32, coc_px: Float32, threads: int | None) -> Silhouette:
    """Find the object in a layer.

    Raises:
        ValueError: colours or, where the layer is covered, CoCs that are not finite.
    """
    rows = rgba.shape[0]
    first, last = np.empty(rows, np.int32), np.empty(rows, np.int32)
    largest = np.empty(rows, np.float32)
    parallel_for(
        partial(_survey, rgba, coc_px, first, last, largest), bands(rows, BAND_ROWS), threads
    )
    if np.isnan(largest).any():
        raise ValueError(
            "the layer holds colours or, where it is covered, CoCs that are not finite"
        )
    return Silhouette(first=first, last=last, largest_coc_px=largest)


@njit(cache=True, nogil=True, error_model="numpy")
def _cut(
    rgba: Float32, coc_px: Float32, corner: tuple[int, int], coc: Float32,
    away: npt.NDArray[np.uint8], band: Band,
) -> None:  # fmt: skip
    """Cut rows of a box at `corner` out: the CoC, NaN where the object is not; `away`: 1 there."""
    for y in range(band[0], band[1]):
        row = y + corner[0]
        for x in range(away.shape[1]):
            column = x + corner[1]
            inside = 0 <= row < rgba.shape[0] and 0 <= column < rgba.shape[1]
            if inside and rgba[row, column, 3] > 0.0:
                coc[y, x], away[y, x] = coc_px[row, column], 0
            else:
                coc[y, x], away[y, x] = np.nan, 1


@njit(cache=True, nogil=True, error_model="numpy")
def _places(away: npt.NDArray[np.uint8], labels: Int32, places: Int32) -> None:
    """Find row and column (n, 2) of the covered pixel of each label."""
    for y in range(away.shape[0]):
        for x in range(away.shape[1]):
            if away[y, x] == 0:
                places[labels[y, x], 0] = y
                places[labels[y, x], 1] = x


def _find_nearest(
    away: npt.NDArray[np.uint8], labels: Int32, places: Int32, distance: Float32
) -> None:
    """Fill in each pixel's label, the labels' places and the distance to them."""
    cv2.distanceTransformWithLabels(
        away, cv2.DIST_L2, cv2.DIST_MASK_5, distance, labels, labelType=cv2.DIST_LABEL_PIXEL
    )
    _places(away, labels, places)


@njit(cache=True, nogil=True, error_model="numpy")
def _step(before: np.float32, here: np.float32, after: np.float32) -> np.float32:
    """The smaller of the steps to both neighbours, 0 where they disagree; NaN: no neighbour."""
    rise, fall = after - here, here - before
    if math.isnan(rise):
        return np.float32(0.0) if math.isnan(fall) else fall
    if math.isnan(fall):
        return rise
    if rise * fall <= 0.0:
        return np.float32(0.0)
    return rise if abs(rise) < abs(fall) else fall


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_out_object(
    rgba: Float32, coc: Float32, away: npt.NDArray[np.uint8], made: Made,
    corner: tuple[int, int], limits: tuple[float, float, float], band: Band,
) -> None:  # fmt: skip
    """Fill in the covered pixels of rows of a source layer: `made` is colours, radii and skews.

    `coc` and `away` are those of `_cut`, for a box at `corner`; `limits` are the largest distance
    that takes part, the largest radius and `SKEW_FADE_PX` [px].
    """
    colours, radii, skews = made
    largest, fade = np.float32(limits[1]), np.float32(limits[2] * limits[2])
    one = np.float32(1.0)
    for y in range(band[0], band[1]):
        for x in range(away.shape[1]):
            row, column = y + corner[0], x + corner[1]
            if away[y, x] != 0:
                for c in range(4):
                    colours[y, x, c] = 0.0
                continue
            for c in range(4):
                colours[y, x, c] = rgba[row, column, c]
            here = coc[y, x]
            radii[y, x] = min(max(np.float32(0.5) * here, -largest), largest)
            along = _step(coc[y, x - 1], here, coc[y, x + 1])
            down = _step(coc[y - 1, x], here, coc[y + 1, x])
            damped = here / (here * here + fade) / max(one, np.sqrt(along * along + down * down))
            skews[0, y, x] = along * damped
            skews[1, y, x] = down * damped


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_out_background(
    rgba: Float32, nearest: tuple[Int32, Int32, Float32], away: npt.NDArray[np.uint8], made: Made,
    corner: tuple[int, int], limits: tuple[float, float, float], band: Band,
) -> None:  # fmt: skip
    """Fill in the other pixels: each spreads as the nearest covered one, once those are filled in.

    `nearest` is each pixel's label, the labels' places and the distance to them.
    """
    labels, places, distance = nearest
    _, radii, skews = made
    height, width = rgba.shape[:2]
    for y in range(band[0], band[1]):
        for x in range(away.shape[1]):
            if away[y, x] == 0:
                continue
            row, column = y + corner[0], x + corner[1]
            inner_row, inner_column = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
            inside = inner_row == row and inner_column == column
            hidden = not inside and rgba[inner_row, inner_column, 3] > 0.0
            skews[0, y, x] = skews[1, y, x] = 0.0  # the CoC is extended as a constant
            if hidden or distance[y, x] > limits[0]:
                radii[y, x] = np.nan
                continue
            label = labels[y, x]
            row, column = places[label, 0], places[label, 1]
            radii[y, x] = radii[row, column]


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
    parallel_for(partial(_cut, rgba, coc_px, corner, coc, away), parts, threads)
    distance, labels = scratch("distance", away.shape), scratch("labels", away.shape, np.int32)
    colours = scratch("colours", (*away.shape, 4))
    radii = scratch("radii", away.shape)
    skews = scratch("skews", (2, *away.shape))
    made = colours, radii, skews
    limits = (2.0 * margin + 1.0, 0.5 * MAX_COC_PX, SKEW_FADE_PX)
    places = scratch("places", (away.size + 1, 2), np.int32)
    # One thread finds what is nearest, which OpenCV does on one only, while others go on.
    find = partial(_find_nearest, away, labels, places, distance)
    own = partial(_lay_out_object, rgba, coc, away, made, corner, limits)
    run_all([find, *(partial(own, part) for part in parts)], threads)
    nearest = labels, places, distance
    parallel_for(
        partial(_lay_out_background, rgba, nearest, away, made, corner, limits), parts, threads
    )
    return SourceLayer(box=box, rgba=colours, radius_px=radii, skew=skews)
