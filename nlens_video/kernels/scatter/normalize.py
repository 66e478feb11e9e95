"""Columns that the blurred object reaches, and normalisation of scattered sums within them."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.kernels.scatter.disc import MAX_COC_PX
from nlens_video.kernels.scatter.extend import Silhouette
from nlens_video.kernels.thread_pool import Band
from nlens_video.native import kernels

Shape = tuple[float, float, int]
Columns = tuple[Float64, Float64]
"""First and last column of each row (h,), none where the first lies past the last."""


def reached_columns(silhouette: Silhouette, shape: Shape, layer_box: Box) -> Columns:
    """The columns of each row of the layer's box that the object reaches [px of the box].

    Args:
        silhouette: of the object.
        shape: width of a pixel by its height; how many radii a disc reaches, skew included; how
            many pixels its light goes further.
        layer_box: the box.
    """
    rows = np.arange(layer_box.y0, layer_box.y1)
    inside = (rows >= 0) & (rows < silhouette.last.shape[0])
    first, last = np.zeros(rows.shape, np.int32), np.full(rows.shape, -1, np.int32)
    radius = np.zeros(rows.shape, np.float32)
    source = rows[inside]
    first[inside] = silhouette.first[source] - layer_box.x0
    last[inside] = np.where(
        silhouette.last[source] >= 0, silhouette.last[source] - layer_box.x0, -1
    )
    radius[inside] = 0.5 * np.minimum(silhouette.largest_coc_px[source], MAX_COC_PX)
    low, high = np.full(rows.shape, np.inf), np.full(rows.shape, -np.inf)
    kernels.reach_columns(first, last, radius, shape, low, high)
    return low, high


def wanted_columns(columns: Columns, wanted: Bool, layer_box: Box) -> Columns:
    """The columns of each row that are wanted as well [px of the box]."""
    low, high = columns
    first = np.full(low.shape, np.inf)
    last = np.full(low.shape, -np.inf)
    rows = np.arange(layer_box.y0, layer_box.y1)
    inside = np.flatnonzero((rows >= 0) & (rows < wanted.shape[0]))
    of_rows = wanted[rows[inside]]
    inside, of_rows = inside[of_rows.any(axis=1)], of_rows[of_rows.any(axis=1)]
    first[inside] = np.argmax(of_rows, axis=1) - layer_box.x0
    last[inside] = wanted.shape[1] - 1 - np.argmax(of_rows[:, ::-1], axis=1) - layer_box.x0
    return np.maximum(low, first), np.minimum(high, last)


def normalise(
    sums: Float32, columns: Columns, origin: tuple[int, int], out: Float32, band: Band
) -> None:
    """Divide rows of sums (h, w, 5) by their weight; 0 where the object does not reach.

    Light without coverage to speak of, such as a flame's, counts where it is no remainder; dark
    parts beside a highlight count because they are covered.

    Args:
        sums: red, green, blue, alpha, weight.
        columns: of each row of the layer, the first and last that the object reaches.
        origin: row and column of the layer at which `sums` start.
        out: result (h, w, 4), whose rows may lie apart.
        band: first row and the one past the last.
    """
    kernels.normalise_sums(sums, columns, origin, out, band)
