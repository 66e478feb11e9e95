"""Layered scatter: each pixel of the object spreads over its disc of confusion.

A large disc is added row by row as a span, into a difference buffer as wide as one row, which one
running sum turns into light; a small one pixel by pixel. Rows of the result do not depend on each
other, so any number of threads gives the same bits.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import njit

from nlens_video.frames import Bool, Float32, Float64
from nlens_video.kernels.disc import FADE_START, FADE_STOP, SPAN_STEPS, STAMP_STEPS, tables
from nlens_video.kernels.extend import SourceLayer, blur_reach, prepare

__all__ = ["blur_reach", "scatter"]

BAND_ROWS = 8
"""Rows that a thread takes at a time."""
ALPHA_FLOOR = 1e-9
"""Coverage below this is rounding left over by the running sum, and means 0 [1]."""


class _Source(NamedTuple):
    """What the loops read (numba knows named tuples, not dataclasses).

    Attributes:
        rgba: premultiplied colour and alpha (h, w, 4).
        radius: radius of each pixel's disc, -1 where it takes no part (h, w) [px].
        rows: rows above and below that the discs of a row reach, -1 where it has none (h,) [px].
        first: first column of a row that takes part (h,).
        last: last column of a row that takes part (h,).
        stamps: `DiscTables.stamps`.
        spans: `DiscTables.spans`.
        pixel_aspect: width of a pixel by its height [1].
    """

    rgba: Float32
    radius: Float32
    rows: np.ndarray[tuple[int], np.dtype[np.int64]]
    first: np.ndarray[tuple[int], np.dtype[np.int64]]
    last: np.ndarray[tuple[int], np.dtype[np.int64]]
    stamps: Float32
    spans: Float32
    pixel_aspect: float


class _Row(NamedTuple):
    """One row of the result while it is being made, with columns to spare on both sides.

    Attributes:
        span: differences along the row of colour and alpha (n, 4).
        span_back: the same of the virtual background (n,).
        spot: colour and alpha (n, 4).
        spot_back: virtual background (n,).
    """

    span: Float64
    span_back: Float64
    spot: Float64
    spot_back: Float64


@njit(cache=True, nogil=True)
def _add_span(row: _Row, x: int, half: float, colour: Float32, scale: float) -> None:
    """Add a span of half width `half` about the middle of pixel x, its ends antialiased."""
    end = half + 0.5
    whole = int(end)
    outer = (end - whole) * scale
    inner = scale - outer
    left, right = x - whole, x + whole
    alpha = colour[3]
    if alpha > 0.0:
        for c in range(4):
            value = float(colour[c])
            row.span[left, c] += outer * value
            row.span[left + 1, c] += inner * value
            row.span[right, c] -= inner * value
            row.span[right + 1, c] -= outer * value
    if alpha < 1.0:
        back = 1.0 - alpha
        row.span_back[left] += outer * back
        row.span_back[left + 1] += inner * back
        row.span_back[right] -= inner * back
        row.span_back[right + 1] -= outer * back


@njit(cache=True, nogil=True)
def _add_pixel(row: _Row, x: int, colour: Float32, weight: float) -> None:
    if colour[3] > 0.0:
        for c in range(4):
            row.spot[x, c] += weight * colour[c]
    if colour[3] < 1.0:
        row.spot_back[x] += weight * (1.0 - colour[3])


@njit(cache=True, nogil=True)
def _add_stamp(
    row: _Row, x: int, dy: int, radius: float, colour: Float32, stamps: Float32, share: float
) -> None:
    """Add row `dy` of a small disc about pixel x, `share` of its light."""
    at = radius * STAMP_STEPS
    index = int(at)
    part = at - index
    for dx in range(stamps.shape[2]):
        low = float(stamps[index, dy, dx])
        weight = share * (low + part * (stamps[index + 1, dy, dx] - low))
        if weight <= 0.0:
            break
        _add_pixel(row, x + dx, colour, weight)
        if dx > 0:
            _add_pixel(row, x - dx, colour, weight)


@njit(cache=True, nogil=True)
def _add_source_row(row: _Row, source: _Source, y: int, dy: int, shift: int) -> None:
    """Add what source row `y` gives to the row of the result `dy` rows off."""
    for x in range(source.first[y], source.last[y] + 1):
        radius = float(source.radius[y, x])
        down = radius * source.pixel_aspect
        if radius < 0.0 or (dy > 0 and down <= dy - 0.5):
            continue
        colour = source.rgba[y, x]
        spans = min(1.0, max(0.0, (radius - FADE_START) / (FADE_STOP - FADE_START)))
        if spans < 1.0:
            _add_stamp(row, x + shift, dy, radius, colour, source.stamps, 1.0 - spans)
        if spans > 0.0:
            at = down * SPAN_STEPS
            index = int(at)
            low = float(source.spans[dy, index])
            half = radius * (low + (at - index) * (source.spans[dy, index + 1] - low))
            _add_span(row, x + shift, half, colour, spans / (math.pi * radius * down))


@njit(cache=True, nogil=True)
def _finish(row: _Row, out: Float32, start: int) -> None:
    """Run the sums, renormalise and write a row of the result (w, 4), `start` in the buffers."""
    total = np.zeros(5)
    for i in range(start + out.shape[0]):
        for c in range(4):
            total[c] += row.span[i, c]
        total[4] += row.span_back[i]
        alpha = total[3] + row.spot[i, 3]
        if i < start or alpha < ALPHA_FLOOR:
            continue
        weight = alpha + max(0.0, total[4] + row.spot_back[i])
        for c in range(3):
            out[i - start, c] = (total[c] + row.spot[i, c]) / weight
        out[i - start, 3] = min(1.0, alpha / weight)


@njit(cache=True, nogil=True)
def _scatter_rows(
    source: _Source, out: Float32, origin: tuple[int, int], band: tuple[int, int]
) -> None:
    """Make rows `band[0]` to `band[1]` of the result (h, w, 4), whose corner is `origin`."""
    height, width = source.radius.shape
    reach = source.rows.max()
    edge = math.ceil(source.radius.max()) + 2
    size = width + 2 * edge
    row = _Row(np.empty((size, 4)), np.empty(size), np.empty((size, 4)), np.empty(size))
    for y in range(band[0], band[1]):
        row.span[:] = 0.0
        row.span_back[:] = 0.0
        row.spot[:] = 0.0
        row.spot_back[:] = 0.0
        middle = y + origin[0]
        for from_y in range(max(0, middle - reach), min(height, middle + reach + 1)):
            dy = abs(from_y - middle)
            if dy <= source.rows[from_y]:
                _add_source_row(row, source, from_y, dy, edge)
        _finish(row, out[y], edge + origin[1])


def _source(layer: SourceLayer, pixel_aspect: float) -> _Source:
    """Lay out a layer for the loops."""
    takes_part: Bool = layer.radius_px >= 0.0
    largest = layer.radius_px.max(axis=1).astype(np.float64)
    rows = np.maximum(np.ceil(largest * pixel_aspect - 0.5), 0.0)
    rows[largest < 0.0] = -1.0
    discs = tables(float(largest.max()), pixel_aspect)
    return _Source(
        rgba=layer.rgba,
        radius=layer.radius_px,
        rows=rows.astype(np.int64),
        first=takes_part.argmax(axis=1),
        last=takes_part.shape[1] - 1 - takes_part[:, ::-1].argmax(axis=1),
        stamps=discs.stamps,
        spans=discs.spans,
        pixel_aspect=pixel_aspect,
    )


def scatter(
    rgba: Float32, coc_px: Float32, *, pixel_aspect: float = 1.0, threads: int | None = None
) -> Float32:
    """Blur an object's layer by its own CoC, as a lens does where the object hides none of itself.

    Each pixel spreads over a disc of its CoC with exact areas as weights; transparent pixels do so
    too, with the CoC of the nearest covered pixel, and the sum is renormalised by all weights that
    arrive. So alpha stays 1 inside and edges are as wide as the disc. A CoC of up to 1 px leaves a
    pixel as it is; one above `disc.MAX_COC_PX` counts as that.

    Args:
        rgba: premultiplied scene-linear colour and alpha (h, w, 4). Colour where alpha is 0 is
            dropped. Leave `blur_reach` pixels around the object, or its blur is cut off.
        coc_px: signed CoC diameter (h, w), read only where alpha > 0; only its size matters
            [px, columns].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: how many threads share the rows; default: the processors this process may use.
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
    source = _source(layer, pixel_aspect)
    target = layer.target
    view = out[target.y0 : target.y1, target.x0 : target.x1]
    origin = (target.y0 - layer.box.y0, target.x0 - layer.box.x0)
    tops = range(0, target.height, BAND_ROWS)
    bands = [(top, min(top + BAND_ROWS, target.height)) for top in tops]
    workers = threads if threads is not None else os.cpu_count() or 1
    if workers == 1:
        for band in bands:
            _scatter_rows(source, view, origin, band)
        return out
    with ThreadPoolExecutor(max_workers=workers) as pool:
        list(pool.map(lambda band: _scatter_rows(source, view, origin, band), bands))
    return out
