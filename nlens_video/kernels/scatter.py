"""Layered scatter: each pixel of the object spreads over its disc of confusion.

A large disc is added row by row as a span, into a difference buffer as wide as one row, which one
running sum turns into light; a small one pixel by pixel. Rows of the result do not depend on each
other, so any number of threads gives the same bits.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from numba import njit

from nlens_video.frames import Float32, Float64
from nlens_video.kernels.disc import (
    FADE_START,
    FADE_STOP,
    SPAN_STEPS,
    STAMP_STEPS,
    fitted_radii,
    tables,
)
from nlens_video.kernels.extend import Index, SourceLayer, blur_reach, prepare

__all__ = ["blur_reach", "scatter"]

BAND_ROWS = 8
"""Rows that a thread takes at a time."""
ALPHA_FLOOR = 1e-9
"""Coverage below this is rounding left over by the running sum, and means 0 [1]."""


# Plain tuples, though names would read better: numba's cache on disk holds on to named classes, and
# fails when a later version of this file has none of that name.
#
# What spreads: rgba (h, w, 4), premultiplied; radius (h, w), nominal, -1 where a pixel takes no
# part [px]; half_axis, density (h, w), half width [px] and one over the area of its disc as spans;
# skew (h, w, 2), how the disc's light grows along columns and rows [1 / px].
_Pixels = tuple[Float32, Float32, Float32, Float32, Float32]
# For each row of them (h,): rows above and below that its discs reach, -1 where it has none; the
# first and the last column that take part [px].
_Rows = tuple[Index, Index, Index]


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
def _add_source_row(
    spans: Float64,
    spots: Float64,
    pixels: _Pixels,
    discs: tuple[Float32, Float32, float],
    columns: tuple[int, int],
    y: int,
    dy: int,
) -> None:
    """Add what row `y` of the pixels gives to the row of the result `dy` rows below it."""
    rgba, radii, half_axes, densities, skews = pixels
    stamp, chord, aspect = discs
    row = abs(dy)
    edge = (spans.shape[0] - radii.shape[1]) // 2
    for x in range(columns[0], columns[1] + 1):
        radius = float(radii[y, x])
        down = radius * aspect
        if radius < 0.0 or row >= max(down, 0.75) + 0.5:
            continue
        r, g, b, a = (
            float(rgba[y, x, 0]),
            float(rgba[y, x, 1]),
            float(rgba[y, x, 2]),
            float(rgba[y, x, 3]),
        )
        skew = float(skews[y, x, 0])
        even = 1.0 + dy * float(skews[y, x, 1])
        large = min(1.0, max(0.0, (radius - FADE_START) / (FADE_STOP - FADE_START)))
        at = x + edge
        if large < 1.0:
            place = radius * STAMP_STEPS
            k = int(place)
            for dx in range(stamp.shape[2]):
                low = float(stamp[k, row, dx])
                weight = (1.0 - large) * (low + (place - k) * (stamp[k + 1, row, dx] - low))
                if weight <= 0.0:
                    break
                _add(spots, at + dx, weight * (even + skew * dx), r, g, b, a)
                if dx > 0:
                    _add(spots, at - dx, weight * (even - skew * dx), r, g, b, a)
        if large > 0.0:
            place = down * SPAN_STEPS
            k = int(place)
            low = float(chord[row, k])
            share = low + (place - k) * (chord[row, k + 1] - low)
            half = half_axes[y, x] * share
            weight = large * even * densities[y, x]
            shift = skew * half * half * (1.0 / 3.0)
            start = at + 0.5 - half + shift
            i = int(start)
            part = weight * (start - i)
            _add(spans, i, weight - part, r, g, b, a)
            _add(spans, i + 1, part, r, g, b, a)
            stop = at + 0.5 + half + shift
            i = int(stop)
            part = weight * (stop - i)
            _add(spans, i, part - weight, r, g, b, a)
            _add(spans, i + 1, -part, r, g, b, a)


@njit(cache=True, nogil=True)
def _finish(spans: Float64, spots: Float64, out: Float32, start: int) -> None:
    """Run the sums, renormalise and write a row of the result (w, 4), `start` in the buffers."""
    r = g = b = a = back = 0.0
    for i in range(start + out.shape[0]):
        r += spans[i, 0]
        g += spans[i, 1]
        b += spans[i, 2]
        a += spans[i, 3]
        back += spans[i, 4]
        alpha = a + spots[i, 3]
        if i < start or alpha < ALPHA_FLOOR:
            continue
        weight = alpha + max(0.0, back + spots[i, 4])
        out[i - start, 0] = (r + spots[i, 0]) / weight
        out[i - start, 1] = (g + spots[i, 1]) / weight
        out[i - start, 2] = (b + spots[i, 2]) / weight
        out[i - start, 3] = min(1.0, alpha / weight)


@njit(cache=True, nogil=True)
def _scatter_rows(
    pixels: _Pixels,
    rows: _Rows,
    discs: tuple[Float32, Float32, float],
    out: Float32,
    origin: tuple[int, int],
    band: tuple[int, int],
) -> None:
    """Make rows `band[0]` to `band[1]` of the result (h, w, 4), whose corner is `origin`."""
    radii = pixels[1]
    height, width = radii.shape
    reaches, first, last = rows
    furthest = reaches.max()
    edge = math.ceil(radii.max()) + 4
    spans = np.empty((width + 2 * edge, 5))
    spots = np.empty((width + 2 * edge, 5))
    for y in range(band[0], band[1]):
        spans[:] = 0.0
        spots[:] = 0.0
        here = y + origin[0]
        for source in range(max(0, here - furthest), min(height, here + furthest + 1)):
            if abs(here - source) <= reaches[source]:
                columns = (first[source], last[source])
                _add_source_row(spans, spots, pixels, discs, columns, source, here - source)
        _finish(spans, spots, out[y], edge + origin[1])


def _pixels(layer: SourceLayer, pixel_aspect: float) -> _Pixels:
    """Lay out a layer for the loops."""
    radius = np.maximum(layer.radius_px, FADE_START).astype(np.float64)
    rx, ry = fitted_radii(radius), fitted_radii(radius * pixel_aspect)
    density = (1.0 / (math.pi * rx * ry)).astype(np.float32)
    return layer.rgba, layer.radius_px, rx.astype(np.float32), density, layer.skew


def _rows(radius_px: Float32, pixel_aspect: float) -> _Rows:
    """How far each row of pixels reaches, and which of its columns take part."""
    takes_part = radius_px >= 0.0
    largest = np.maximum(radius_px.max(axis=1), 0.0).astype(np.float64)
    reaches = np.maximum(np.ceil(fitted_radii(largest * pixel_aspect) - 0.5), 0.0)
    reaches[~takes_part.any(axis=1)] = -1.0
    last = takes_part.shape[1] - 1 - takes_part[:, ::-1].argmax(axis=1)
    return reaches.astype(np.intp), takes_part.argmax(axis=1), last


def scatter(
    rgba: Float32, coc_px: Float32, *, pixel_aspect: float = 1.0, threads: int | None = None
) -> Float32:
    """Blur an object's layer by its own CoC, as a lens does where the object hides none of itself.

    Each pixel spreads over a disc of its CoC (`disc.fitted_radii`: areas of a disc fitted to
    sampled pictures; `extend.coc_skew`: uneven where the CoC has a slope). Transparent pixels do so
    too, with the CoC of the nearest covered pixel, and the sum is renormalised by all weights that
    arrive. So alpha stays 1 inside and edges are as wide as the disc. CoC 0 leaves a pixel as it
    is; one above `disc.MAX_COC_PX` counts as that.

    Args:
        rgba: premultiplied scene-linear colour and alpha (h, w, 4). Colour where alpha is 0 is
            dropped. Leave `blur_reach` pixels around the object, or its blur is cut off.
        coc_px: signed CoC diameter (h, w), read only where alpha > 0; only its size matters
            [px, columns].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: how many threads share the rows; default: one a processor.
            The result does not depend on it.

    Returns:
        The blurred layer (h, w, 4), premultiplied, alpha in [0, 1]; exactly 0 out of reach.

    Raises:
        ValueError: shapes that do not belong together, values that are not finite.
    """
    layer = prepare(rgba, coc_px, pixel_aspect)
    out = np.zeros(rgba.shape, dtype=np.float32)
    if layer is None:
        return out
    stamps, chords = tables(float(layer.radius_px.max()), pixel_aspect)
    target = layer.target
    view = out[target.y0 : target.y1, target.x0 : target.x1]
    origin = (target.y0 - layer.box.y0, target.x0 - layer.box.x0)
    tops = range(0, target.height, BAND_ROWS)
    bands = [(top, min(top + BAND_ROWS, target.height)) for top in tops]
    workers = threads if threads is not None else os.cpu_count() or 1
    scatter_band = partial(
        _scatter_rows,
        _pixels(layer, pixel_aspect),
        _rows(layer.radius_px, pixel_aspect),
        (stamps, chords, pixel_aspect),
        view,
        origin,
    )
    if workers == 1:
        for band in bands:
            scatter_band(band)
        return out
    with ThreadPoolExecutor(max_workers=workers) as pool:
        list(pool.map(scatter_band, bands))
    return out
