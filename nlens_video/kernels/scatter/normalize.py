"""Columns that the blurred object reaches, and normalisation of scattered sums within them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.kernels.scatter.disc import MAX_COC_PX
from nlens_video.kernels.scatter.extend import Int32, Silhouette
from nlens_video.kernels.thread_pool import Band

Shape = tuple[float, float, int]
Columns = tuple[Float64, Float64]
"""First and last column of each row (h,), none where the first lies past the last."""

REMAINDER = 1e-6
"""Share of a row's largest sum below which a sum is rounding error of the running sum, and is set
to 0 [1]."""
WEIGHT_FLOOR = 1e-4
"""Weight below which it is rounding error itself, and the quotient meaningless [1]."""


@njit(cache=True, nogil=True, error_model="numpy")
def _reached_columns(first: Int32, last: Int32, radius: Float32, shape: Shape) -> Columns:
    """Likewise, from first and last covered column, -1 for none, and largest radius of each row."""
    aspect, outer, spread = shape
    height = first.shape[0]
    low, high = np.full(height, np.inf), np.full(height, -np.inf)
    for source in range(height):
        if last[source] < 0:
            continue
        across = float(radius[source]) * outer + 1.0
        rows = math.ceil(across * aspect) + spread
        for y in range(max(0, source - rows), min(height, source + rows + 1)):
            down = max(0.0, abs(y - source) - 0.5 - spread) / (across * aspect)
            half = across * math.sqrt(max(0.0, 1.0 - down * down)) + 2.0 + spread
            low[y] = min(low[y], first[source] - half)
            high[y] = max(high[y], last[source] + half)
    return low, high


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
    return _reached_columns(first, last, radius, shape)


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


# The loops below run over slices, and look into tables apart from calculating: only so can the
# compiler take several pixels at once, three times as quick.


@njit(cache=True, nogil=True, error_model="numpy")
def normalise(
    sums: Float32, columns: Columns, origin: tuple[int, int], out: Float32,
    band: Band,
) -> None:  # fmt: skip
    """Divide rows of sums (h, w, 5) by their weight; 0 where the object does not reach.

    Light without coverage to speak of, such as a flame's, counts where it is no remainder; dark
    parts beside a highlight count because they are covered.

    Args:
        sums: red, green, blue, alpha, weight.
        columns: as in `scatter_rows`.
        origin: row and column of the light at which `sums` start.
        out: result (h, w, 4).
        band: first row and the one past the last.
    """
    nothing = np.float32(0.0)
    for y in range(band[0], band[1]):
        low, high = columns[0][y + origin[0]], columns[1][y + origin[0]]
        red = green = blue = alpha = nothing
        for x in range(sums.shape[1]):
            red, green = max(red, abs(sums[y, x, 0])), max(green, abs(sums[y, x, 1]))
            blue, alpha = max(blue, abs(sums[y, x, 2])), max(alpha, abs(sums[y, x, 3]))
        least = np.float32(REMAINDER)
        floors = (least * red, least * green, least * blue, least * alpha)
        for x in range(sums.shape[1]):
            weight = sums[y, x, 4]
            reached = weight >= WEIGHT_FLOOR and low <= x + origin[1] <= high
            covered = reached and sums[y, x, 3] > floors[3]
            for c in range(3):
                light = sums[y, x, c]
                kept = reached and (abs(light) > floors[c] or (covered and light > nothing))
                out[y, x, c] = light / weight if kept else nothing
            out[y, x, 3] = min(np.float32(1.0), sums[y, x, 3] / weight) if covered else nothing
