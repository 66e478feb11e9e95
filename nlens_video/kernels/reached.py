"""Where the object reaches, and what the sums there come to."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from nlens_video.frames import Float32, Float64
from nlens_video.kernels.extend import Band, Int32

ALPHA_FLOOR = 1e-7
WEIGHT_FLOOR = 1e-4
"""Coverage and weight below these are rounding left over by the running sum, and mean 0 [1]. The
ratio of two such remainders looks like any other."""


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

    Args:
        sums: red, green, blue, alpha, weight.
        columns: as in `scatter_rows`.
        origin: row and column of the light at which `sums` start.
        out: result (h, w, 4).
        band: first row and the one past the last.
    """
    for y in range(band[0], band[1]):
        low, high = columns[0][y + origin[0]], columns[1][y + origin[0]]
        for x in range(sums.shape[1]):
            alpha, weight = sums[y, x, 3], sums[y, x, 4]
            nothing = alpha < ALPHA_FLOOR or weight < WEIGHT_FLOOR
            if nothing or not low <= x + origin[1] <= high:
                for c in range(4):
                    out[y, x, c] = 0.0
                continue
            for c in range(3):
                out[y, x, c] = sums[y, x, c] / weight
            out[y, x, 3] = min(np.float32(1.0), alpha / weight)
