"""The compiled loops of `scatter`: spans and stamps of one level, added to rows of the result.

A span is a row of a disc. A stamp is a small disc, spread pixel by pixel: a column of stamps along
a whole row at a time. Nothing but functions from another file is compiled in: the cache on disk
follows changes of this file only, so numbers of other files come as arguments.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.numba_config import kernel
from nlens_video.kernels.scatter.disc import Discs
from nlens_video.kernels.scatter.levels import Light, RowNumbers
from nlens_video.kernels.simd import (
    add_span_end,
    lane,
    load4,
    load8,
    low4,
    splat,
    store4,
    to_f32x8,
    to_f64,
)
from nlens_video.kernels.thread_pool import Band

# `levels` has the same: a number from there would go stale in the cache.
RADIUS, AXIS, SPAN, STAMP, ALONG, DOWN, STAMP_RADIUS, BARREL_X, BARREL_Y = range(9)


@kernel
def _look_up(
    numbers: Float32, table: Float32, scale: np.float32, behind: int, out: Float32
) -> None:
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
def place_spans(
    ends: Float32, numbers: Float32, discs: Discs, columns: tuple[int, int], dy: int,
    skew: np.float32, rim: float,
) -> None:  # fmt: skip
    """Find start, stop and weight (3, w) of a row's spans; the ends count from their pixel.

    Args:
        ends: filled in.
        numbers: the row's (9, w).
        discs: tables.
        columns: first and last column to fill in.
        dy: rows from the pixels' own [px].
        skew: 1 to follow the discs' skew, 0 to leave it out [1].
        rim: radius of the barrel's rim that cuts the discs, 0 where none does [radius].
    """
    _, spans, steps, turned, aspect, outer = discs
    table = spans[dy + spans.shape[0] // 2]
    start, stop = columns[0], columns[1] + 1
    radii, axes = numbers[RADIUS, start:stop], numbers[AXIS, start:stop]
    along, down = numbers[ALONG, start:stop], numbers[DOWN, start:stop]
    starts, stops, weights = ends[0, start:stop], ends[1, start:stop], ends[2, start:stop]
    scale, rows = np.float32(steps[1]), np.float32(dy)
    zero, one, third = np.float32(0.0), np.float32(1.0), np.float32(1.0 / 3.0)
    _look_up(radii, table[1], scale, turned[1], stops)
    if outer == 1.0:  # round: all spans lie in the middle
        for x in range(radii.shape[0]):
            starts[x] = zero
    else:
        _look_up(radii, table[0], scale, turned[1], starts)
    if rim > 0.0:
        _cut_spans(ends, numbers, columns, dy, (rim, aspect))
    size = numbers[SPAN, start:stop]
    for x in range(radii.shape[0]):
        middle, half = axes[x] * starts[x], axes[x] * stops[x]
        even = one + rows * down[x] + along[x] * middle
        # the light of a span grows along it: an even one of the same light lies off a little
        first = np.float32(0.5) + middle + skew * along[x] * half * half * third - half
        starts[x] = first
        stops[x] = first + half + half
        weights[x] = size[x] * even if half > zero else zero


@kernel
def _cut_spans(
    ends: Float32, numbers: Float32, columns: tuple[int, int], dy: int, shape: tuple[float, float]
) -> None:
    """Cut middles and halves (2, w) of a row's spans [half axis] to what the barrel leaves."""
    edge, aspect = np.float32(shape[0]), np.float32(shape[1])
    zero, half = np.float32(0.0), np.float32(0.5)
    for x in range(columns[0], columns[1] + 1):
        axis = max(numbers[AXIS, x], np.float32(1e-6))
        off = (np.float32(dy) - numbers[BARREL_Y, x]) / (axis * aspect)
        rim = np.sqrt(max(edge * edge - off * off, zero))
        across = numbers[BARREL_X, x] / axis
        low = max(ends[0, x] - ends[1, x], across - rim)
        high = min(ends[0, x] + ends[1, x], across + rim)
        ends[0, x] = half * (low + high)
        ends[1, x] = max(half * (high - low), zero)


@kernel
def _add_spans(
    sums: Float32, ends: Float32, rgba: Float32, columns: tuple[int, int], edge: int
) -> None:
    """Add both ends of the spans of a row: a running sum makes light of them."""
    for x in range(columns[0], columns[1] + 1):
        weight = ends[2, x]
        if weight != np.float32(0.0):
            start, stop = ends[0, x], ends[1, x]
            first, last = np.floor(start), np.floor(stop)
            further = weight * (start - first)
            add_span_end(sums, x + edge + np.int32(first), rgba, x, weight - further, further)
            further = weight * (stop - last)
            add_span_end(sums, x + edge + np.int32(last), rgba, x, further - weight, -further)


@kernel
def _finish(spans: Float32, start: int, sums: Float32) -> None:
    """Run the sums of a row into `sums` (w, 5), `start` > 0 in the buffer; 0: there are none."""
    if start == 0:
        sums[:] = np.float32(0.0)
        return
    total = to_f64(load8(spans, 0)) - to_f64(load8(spans, 0))  # in float64
    for i in range(1, start + sums.shape[0]):
        ends = to_f64(load8(spans, 16 * i)) + to_f64(load8(spans, 16 * i - 8))
        total = total + ends
        if i >= start:
            found = to_f32x8(total)
            store4(sums, 5 * (i - start), low4(found))
            sums[i - start, 4] = lane(found, 4)


@kernel
def _add_coarse(
    coarse: Float32, line: Float32, offset: tuple[int, int], y: int, sums: Float32
) -> None:
    """Add a row of the next coarser level, interpolated between its pixels, to `sums` (w, 5).

    `offset` is the row and column of the level at hand where the coarser sums start, twice as fine,
    `y` the row from the start of `sums`, `line` scratch (w, 5).
    """
    row = y - offset[0]
    near = row >> 1
    far = near + 1 if row & 1 else near - 1
    quarter, three = np.float32(0.25), np.float32(0.75)
    one, other, mixed = coarse[near].reshape(-1), coarse[far].reshape(-1), line.reshape(-1)
    for i in range(mixed.shape[0]):
        mixed[i] = quarter * (three * one[i] + quarter * other[i])
    near_part, far_part = splat(three), splat(quarter)
    for x in range(sums.shape[0]):
        column = x - offset[1]
        here = column >> 1
        beside = here + 1 if column & 1 else here - 1
        # Colour and alpha, then the weight with them: it must be rounded as alpha is.
        light = load4(sums, 5 * x) + near_part * load4(line, 5 * here)
        others = load4(sums, 5 * x + 1) + near_part * load4(line, 5 * here + 1)
        store4(sums, 5 * x, light + far_part * load4(line, 5 * beside))
        store4(sums, 5 * x + 1, others + far_part * load4(line, 5 * beside + 1))


@kernel
def _add_stamps(
    spots: Float32, rgba: Float32, numbers: Float32, discs: Discs, columns: tuple[int, int, int],
    dy: int, scratch: Float32,
) -> None:  # fmt: skip
    """Add to `spots` (5, n) what stamps of a row give to the row of the result `dy` rows below it.

    `columns` are the first and last column that take part, and how many columns stamps reach;
    `scratch` (6, w) is of any content.
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
        _look_up(radii, stamps[row, middle + dx], scale, turned[0], tables)
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
def _add_to_sums(spots: Float32, start: int, sums: Float32) -> None:
    """Add the sums of stamps (5, n) of a row to `sums` (w, 5), `start` in the buffer."""
    for x in range(sums.shape[0]):
        for c in range(5):
            sums[x, c] += spots[c, start + x]


@njit(cache=True, nogil=True, error_model="numpy")
def scatter_rows(
    light: Light, rows: RowNumbers, discs: Discs, columns: tuple[Float64, Float64],
    coarse: tuple[Float32, int, int], largest: float, rim: float, sums: Float32,
    origin: tuple[int, int], band: Band,
) -> None:  # fmt: skip
    """Make rows `band[0]` to `band[1]` of a level's sums.

    Args:
        light: what the level's pixels spread (h, w).
        rows: how far each row of them reaches, see `levels.Level`.
        discs: tables.
        columns: first and last column of each row of the light that the object can reach (h,).
        coarse: the next coarser level's sums, and where they start, see `_add_coarse`.
        largest: no less than any span's half axis [px].
        rim: radius of the barrel's rim that cuts the discs, 0 where none does [radius].
        sums: red, green, blue, alpha and weight to fill in (H, W, 5).
        origin: row and column of the light at which `sums` start.
        band: first row and the one past the last.
    """
    rgba, numbers = light
    height, width = rgba.shape[:2]
    stamps, spans, _, _, _, outer = discs
    span_rows, stamp_rows = spans.shape[0] // 2, stamps.shape[0] // 2
    furthest = max(rows[0].max(), rows[3].max())
    across = max(largest * outer * 1.2, stamps.shape[1] // 2) + 2.0
    edge = math.ceil(across) + 1
    ends_of_row = np.empty((width + 2 * edge, 16), np.float32)
    spots = np.empty((5, width + 2 * edge), np.float32)
    ends, for_stamps = np.empty((3, width), np.float32), np.empty((6, width), np.float32)
    line = np.empty((coarse[0].shape[1], 5), np.float32)
    for y in range(band[0], band[1]):
        here = y + origin[0]
        if columns[0][here] > columns[1][here]:
            sums[y] = np.float32(0.0)
            continue
        with_spans = with_stamps = False
        least, most = int(columns[0][here] - across), int(columns[1][here] + across) + 1
        for source in range(max(0, here - furthest), min(height, here + furthest + 1)):
            dy = here - source
            of_row = numbers[source]
            if abs(dy) <= min(rows[0, source], span_rows):
                if not with_spans:
                    ends_of_row[:] = np.float32(0.0)
                    with_spans = True
                part = (max(rows[1, source], least), min(rows[2, source], most))
                place_spans(ends, of_row, discs, part, dy, np.float32(1.0), rim)
                _add_spans(ends_of_row, ends, rgba[source], part, edge)
            if abs(dy) <= min(rows[3, source], stamp_rows):
                if not with_stamps:
                    spots[:] = np.float32(0.0)
                    with_stamps = True
                wide = min(rows[4, source], stamps.shape[1] // 2)
                stamped = (max(rows[5, source], least), min(rows[6, source], most), wide)
                _add_stamps(spots, rgba[source], of_row, discs, stamped, dy, for_stamps)
        first = edge + origin[1]
        _finish(ends_of_row, first if with_spans else 0, sums[y])
        if with_stamps:
            _add_to_sums(spots, first, sums[y])
        if line.shape[0] > 0:
            _add_coarse(coarse[0], line, (coarse[1], coarse[2]), y, sums[y])
