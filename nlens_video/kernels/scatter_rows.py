"""The compiled loops of `scatter`.

Nothing from another file is compiled in: the cache on disk follows changes of this file only, so
numbers of other files come as arguments.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from nlens_video.frames import Bool, Float32, Float64
from nlens_video.kernels.extend import Index

ALPHA_FLOOR = 1e-9
"""Coverage below this is rounding left over by the running sum, and means 0 [1]."""


# Plain tuples, though names would read better: numba's cache on disk holds on to named classes, and
# fails when a later version of this file has none of that name.
#
# What spreads: rgba (h, w, 4), premultiplied; radius (h, w), nominal, -1 where a pixel takes no
# part [px]; half_axis (h, w), half width of its disc [px], and density (h, w), one over its area
# times the share that is spread as spans, 0 where a pixel takes no part; skew (h, w, 2), how the
# disc's light grows along columns and rows [1 / px].
Pixels = tuple[Float32, Float32, Float32, Float32, Float32]
# For each row of them (h,): rows above and below that its discs reach, -1 where it has none; the
# first and the last column that take part; the least and the largest radius [px].
Rows = tuple[Index, Index, Index, Float32, Float32]
# For each row of the result (h,), laid out as the pixels: the columns that the object can reach,
# from the first to the last, or none [px].
Reached = tuple[Float64, Float64]
# Tables of `disc.DiscTables`, stamps and spans; width of a pixel by its height; `FADE_START`,
# `FADE_STOP`, `STAMP_STEPS`, `SPAN_STEPS`.
Discs = tuple[Float32, Float32, float, float, float, float, float]


@njit(cache=True, nogil=True)
def _half_width(radius: float, aspect: float, dy: int) -> float:
    """No less than how far a disc, as skew as can be, reaches along the row `dy` from its own."""
    down = (max(0.0, abs(dy) - 0.5)) / (radius * aspect + 1.0)
    # Skew is at most 1 / (2 radius), which shifts a span by up to a sixth of its half.
    return (radius + 1.0) * math.sqrt(max(0.0, 1.0 - down * down)) * (7.0 / 6.0) + 2.0


@njit(cache=True, nogil=True)
def reached_columns(covered: Bool, radii: Float32, aspect: float) -> Reached:
    """Which columns of each row the object reaches, from its silhouette (h, w)."""
    height, width = covered.shape
    low, high = np.full(height, np.inf), np.full(height, -np.inf)
    for source in range(height):
        first, last, radius = width, -1, 0.0
        for x in range(width):
            if covered[source, x]:
                first, last = min(first, x), x
                radius = max(radius, float(radii[source, x]))
        if last < 0:
            continue
        rows = math.ceil(radius * aspect + 1.0)
        for y in range(max(0, source - rows), min(height, source + rows + 1)):
            half = _half_width(radius, aspect, y - source)
            low[y] = min(low[y], first - half)
            high[y] = max(high[y], last + half)
    return low, high


@njit(cache=True, nogil=True)
def _add(sums: Float64, i: int, weight: float, r: float, g: float, b: float, a: float) -> None:
    """Add a weighted colour at place i; its last channel is the virtual background's weight."""
    if a > 0.0:
        sums[i, 0] += weight * r
        sums[i, 1] += weight * g
        sums[i, 2] += weight * b
        sums[i, 3] += weight * a
    if a < 1.0:
        sums[i, 4] += weight * (1.0 - a)


@njit(cache=True, nogil=True)
def _add_stamps(
    spots: Float64, pixels: Pixels, discs: Discs, columns: tuple[int, int], y: int, dy: int
) -> None:
    """Add what small discs of row `y` give to the row of the result `dy` rows below it."""
    rgba, radii, _, _, skews = pixels
    stamp, _, _, fade_start, fade_stop, steps, _ = discs
    row = abs(dy)
    edge = (spots.shape[0] - radii.shape[1]) // 2
    for x in range(columns[0], columns[1] + 1):
        radius = float(radii[y, x])
        if radius < 0.0 or radius >= fade_stop:
            continue
        r, g, b, a = (
            float(rgba[y, x, 0]),
            float(rgba[y, x, 1]),
            float(rgba[y, x, 2]),
            float(rgba[y, x, 3]),
        )
        skew = float(skews[y, x, 0])
        even = 1.0 + dy * float(skews[y, x, 1])
        part = min(1.0, (fade_stop - radius) / (fade_stop - fade_start))
        place = radius * steps
        k = int(place)
        at = x + edge
        for dx in range(stamp.shape[2]):
            low = float(stamp[k, row, dx])
            weight = part * (low + (place - k) * (stamp[k + 1, row, dx] - low))
            if weight <= 0.0:
                break
            _add(spots, at + dx, weight * (even + skew * dx), r, g, b, a)
            if dx > 0:
                _add(spots, at - dx, weight * (even - skew * dx), r, g, b, a)


@njit(cache=True, nogil=True)
def _place_spans(
    ends: Float64, pixels: Pixels, discs: Discs, columns: tuple[int, int], y: int, dy: int
) -> None:
    """Find start, stop and weight (3, w) of the spans that `_add_spans` adds.

    A loop of its own, without branches: a third quicker than within that one.
    """
    _, radii, half_axes, densities, skews = pixels
    _, chords, aspect, _, _, _, steps = discs
    chord, scale = chords[abs(dy)], aspect * steps
    edge = (ends.shape[1] - radii.shape[1]) // 2
    start, stop, weight = ends
    for x in range(columns[0], columns[1] + 1):
        place = max(0.0, radii[y, x] * scale)
        k = np.uint32(place)
        low = float(chord[k])
        half = half_axes[y, x] * (low + (place - k) * (chord[k + np.uint32(1)] - low))
        centre = x + edge + 0.5 + skews[y, x, 0] * half * half * (1.0 / 3.0)
        start[x] = centre - half
        stop[x] = centre + half
        weight[x] = densities[y, x] * (1.0 + dy * skews[y, x, 1])


@njit(cache=True, nogil=True)
def _add_end(
    spans: Float64, at: float, weight: float, r: float, g: float, b: float, a: float
) -> None:
    """Add an end of a span between two places; channels 5 to 9 count one place further on.

    So neighbours in a row do not wait for each other's sums.
    """
    i = int(at)
    further = weight * (at - i)
    here = weight - further
    if a > 0.0:
        spans[i, 0] += here * r
        spans[i, 1] += here * g
        spans[i, 2] += here * b
        spans[i, 3] += here * a
        spans[i, 5] += further * r
        spans[i, 6] += further * g
        spans[i, 7] += further * b
        spans[i, 8] += further * a
    if a < 1.0:
        spans[i, 4] += here * (1.0 - a)
        spans[i, 9] += further * (1.0 - a)


@njit(cache=True, nogil=True)
def _add_spans(
    spans: Float64, ends: Float64, rgba: Float32, columns: tuple[int, int], y: int
) -> None:
    """Add both ends of the spans of row `y`: a running sum makes light of them."""
    start, stop, weights = ends
    for x in range(columns[0], columns[1] + 1):
        low, high, weight = start[x], stop[x], weights[x]
        if weight == 0.0 or low >= high:
            continue
        r, g, b, a = (
            float(rgba[y, x, 0]),
            float(rgba[y, x, 1]),
            float(rgba[y, x, 2]),
            float(rgba[y, x, 3]),
        )
        _add_end(spans, low, weight, r, g, b, a)
        _add_end(spans, high, -weight, r, g, b, a)


@njit(cache=True, nogil=True)
def _finish(spans: Float64, spots: Float64, out: Float32, start: int) -> None:
    """Run the sums, renormalise and write a row of the result (w, 4), `start` in the buffers."""
    r = g = b = a = back = 0.0
    for i in range(1, start + out.shape[0]):
        r += spans[i, 0] + spans[i - 1, 5]
        g += spans[i, 1] + spans[i - 1, 6]
        b += spans[i, 2] + spans[i - 1, 7]
        a += spans[i, 3] + spans[i - 1, 8]
        back += spans[i, 4] + spans[i - 1, 9]
        alpha = a + spots[i, 3]
        if i < start or alpha < ALPHA_FLOOR:
            continue
        weight = alpha + max(0.0, back + spots[i, 4])
        out[i - start, 0] = (r + spots[i, 0]) / weight
        out[i - start, 1] = (g + spots[i, 1]) / weight
        out[i - start, 2] = (b + spots[i, 2]) / weight
        out[i - start, 3] = min(1.0, alpha / weight)


@njit(cache=True, nogil=True)
def scatter_rows(
    pixels: Pixels,
    rows: Rows,
    reached: Reached,
    discs: Discs,
    out: Float32,
    origin: tuple[int, int],
    band: tuple[int, int],
) -> None:
    """Make rows `band[0]` to `band[1]` of the result (h, w, 4), whose corner is `origin`."""
    height, width = pixels[1].shape
    reaches, first, last, least, largest = rows
    stamps, _, aspect, fade_start, fade_stop, _, _ = discs
    furthest = reaches.max()
    edge = math.ceil(_half_width(largest.max(), aspect, 0)) + 1
    spans = np.empty((width + 2 * edge, 10))
    spots = np.empty((width + 2 * edge, 5))
    ends = np.empty((3, width + 2 * edge))
    for y in range(band[0], band[1]):
        here = y + origin[0]
        if reached[0][here] > reached[1][here]:
            continue
        spans[:] = 0.0
        spots[:] = 0.0
        for source in range(max(0, here - furthest), min(height, here + furthest + 1)):
            dy = here - source
            if abs(dy) > reaches[source]:
                continue
            half = _half_width(largest[source], aspect, dy)
            columns = (
                max(first[source], int(reached[0][here] - half)),
                min(last[source], int(reached[1][here] + half) + 1),
            )
            if least[source] < fade_stop and abs(dy) < stamps.shape[1]:
                _add_stamps(spots, pixels, discs, columns, source, dy)
            if largest[source] > fade_start:
                _place_spans(ends, pixels, discs, columns, source, dy)
                _add_spans(spans, ends, pixels[0], columns, source)
        _finish(spans, spots, out[y], edge + origin[1])
