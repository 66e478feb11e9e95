"""Normalisation of scattered sums by their weight, within the object's reach."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.scatter.extend import Band, Int32

REMAINDER = 1e-6
"""Share of a row's largest sum below which a sum is rounding error of the running sum, and is set
to 0 [1]."""
WEIGHT_FLOOR = 1e-4
"""Weight below which it is rounding error itself, and the quotient meaningless [1]."""


@njit(cache=True, nogil=True, error_model="numpy")
def reached_columns(
    first: Int32, last: Int32, radius: Float32, shape: tuple[float, float, int]
) -> tuple[Float64, Float64]:
    """Which columns of each row the object reaches, none where the first lies past the last.

    Args:
        first: first covered column of each row (h,) [px].
        last: last covered column, -1 for none (h,) [px].
        radius: largest radius in columns of each row (h,) [px].
        shape: width of a pixel by its height; how many radii a disc reaches, skew included; how
            many pixels its light goes further.
    """
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


# The loops below run over slices, and look into tables apart from calculating: only so can the
# compiler take several pixels at once, three times as quick.


@njit(cache=True, nogil=True, error_model="numpy")
def normalise(
    sums: Float32, columns: tuple[Float64, Float64], origin: tuple[int, int], out: Float32,
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
