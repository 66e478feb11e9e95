"""Small discs of `scatter`, spread pixel by pixel: a column of stamps along a whole row at a time.

Numbers of other files come as arguments, see `scatter_rows`.
"""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import kernel

# `levels` has the same: a number from there would go stale in the cache.
_, _, _, STAMP, ALONG, DOWN, STAMP_RADIUS = range(7)

# Plain tuples, though names would read better: numba's cache on disk holds on to named classes, and
# fails when a later version of this file has none of that name.
#
# Tables of `tables.DiscTables`: stamps, spans; entries per pixel of radius; where the discs before
# the focus start; width of a pixel by its height; furthest point of the aperture [radius].
Discs = tuple[Float32, Float32, tuple[int, int], tuple[int, int], float, float]


@kernel
def look_up(numbers: Float32, table: Float32, scale: np.float32, behind: int, out: Float32) -> None:
    """Read a table (K,) at signed radii `numbers` times `scale`, those > 0 from `behind` on."""
    for x in range(numbers.shape[0]):
        place = abs(numbers[x]) * scale
        entry = np.uint32(place)
        part = place - np.float32(entry)
        if numbers[x] > np.float32(0.0):
            entry += np.uint32(behind)
        low = table[entry]
        out[x] = low + part * (table[entry + np.uint32(1)] - low)


@kernel
def add_stamps(
    spots: Float32, rgba: Float32, numbers: Float32, discs: Discs, columns: tuple[int, int, int],
    dy: int, scratch: Float32,
) -> None:  # fmt: skip
    """Add what stamps of a row give to the row of the result `dy` rows below it.

    Args:
        spots: sums of red, green, blue, alpha and weight to add to (5, n).
        rgba: the row's light (w, 4).
        numbers: the row's other numbers (9, w).
        discs: tables.
        columns: first and last column that take part, and how many columns stamps reach.
        dy: rows [px].
        scratch: (6, w).
    """
    stamps, _, steps, turned, _, outer = discs
    row, middle = dy + stamps.shape[0] // 2, stamps.shape[1] // 2
    start, stop = columns[0], columns[1] + 1
    edge = (spots.shape[1] - rgba.shape[0]) // 2 + start
    radii, along = numbers[STAMP_RADIUS, start:stop], numbers[ALONG, start:stop]
    size, down = numbers[STAMP, start:stop], numbers[DOWN, start:stop]
    weights, tables, pixels = scratch[4, start:stop], scratch[5, start:stop], rgba[start:stop]
    scale, rows = np.float32(steps[0]), np.float32(dy)
    count = radii.shape[0]
    for c in range(4):
        plane = scratch[c, start:stop]
        for x in range(count):
            plane[x] = pixels[x, c]
    for dx in range(-columns[2], columns[2] + 1):
        if dx < 0 and outer == 1.0:
            continue  # round: as far to the right
        look_up(radii, stamps[row, middle + dx], scale, turned[0], tables)
        for side in range(2 if dx > 0 and outer == 1.0 else 1):
            column = -dx if side else dx
            across = np.float32(column)
            for x in range(count):
                even = np.float32(1.0) + across * along[x] + rows * down[x]
                weight = tables[x] * size[x] * even
                weights[x] = weight if weight > np.float32(0.0) else np.float32(0.0)
            first = edge + column
            for c in range(4):
                spot, plane = spots[c, first : first + count], scratch[c, start:stop]
                for x in range(count):
                    spot[x] += weights[x] * plane[x]
            spot = spots[4, first : first + count]
            for x in range(count):
                spot[x] += weights[x]


@kernel
def add_to_sums(spots: Float32, start: int, sums: Float32) -> None:
    """Add the sums of stamps (5, n) of a row to `sums` (w, 5), `start` in the buffer."""
    for x in range(sums.shape[0]):
        for c in range(5):
            sums[x, c] += spots[c, start + x]
