"""Multi-resolution source of the scatter: large discs are drawn from coarser levels.

From the radius `coarse_px` on, a disc fades to the next level, whose pixels are twice as large, and
so on: no disc spans more than `largest_px` of its level's pixels. All levels share the frame's
grid, so the result depends neither on the layer's box nor on the frame's size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.scatter.extend import BAND_ROWS, SourceLayer
from nlens_video.kernels.simd import load4, pack4, splat, store4
from nlens_video.kernels.thread_pool import Band, bands, parallel_for, run_all, scratch

_GATHERED_ROWS = 32  # at least, and a power of two: rows of one coarse pixel stay together
COARSE_FADE = 0.25
"""Share of a level's first radius over which discs go over to it [1]."""
SUMS = 12
"""Sums of a coarse pixel: premultiplied colour and alpha, mass, radius, signed radius, skew along
columns and rows; the rest is 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detail:
    """How finely discs are drawn.

    Attributes:
        stamps_px: radius up to which discs are drawn pixel by pixel [px].
        spans_px: radius from which they are drawn row by row, above `stamps_px` [px].
        coarse_px: radius from which they are drawn at the next level [px].
    """

    stamps_px: float
    spans_px: float
    coarse_px: float

    @property
    def largest_px(self) -> float:
        """Largest radius at any level, in its pixels [px]."""
        return self.coarse_px * (1.0 + COARSE_FADE)

    def levels(self, radius_px: float) -> int:
        """How many levels discs up to a radius need."""
        if radius_px <= self.coarse_px:
            return 1
        return 1 + math.ceil(math.log2(radius_px / self.coarse_px) + 1e-9)

    def spread(self, radius_px: float) -> int:
        """How much further than its radius a disc's light gets, by its coarser pixels [px]."""
        return (1 << self.levels(radius_px)) - 2


# Plain tuples, as in `scatter_rows`. What the pixels of a level (h, w) spread: the mean light of
# those they stand for (h, w, 4), and the numbers below of each (h, 9, w), in the level's pixels.
Light = tuple[Float32, Float32]
RADIUS, AXIS, SPAN, STAMP, ALONG, DOWN, STAMP_RADIUS = range(7)
NUMBERS = 9
"""Signed radius, fitted half axis in columns, weights of span and stamp, skew, signed radius of the
stamp; then column and row of the barrel's middle, which `shape.vignette_discs` fills in. Other
kernels hold these indices too: numba's cache follows changes of a kernel's own file only."""
# `stamps_px`, `spans_px`, the aperture's furthest point [radius], `disc.SURPLUS`, width of a pixel
# by its height.
Rule = tuple[float, float, float, float, float]
RowNumbers = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """One level of the source.

    Attributes:
        box: where it lies on its grid, whose origin is the frame's [px of the level].
        light: what its pixels spread.
        rows: of each row (7, h): how many rows its spans reach, first and last column of them; how
            many rows and columns its stamps reach, first and last column of them. Reach is -1
            where there are none.
    """

    box: Box
    light: Light
    rows: RowNumbers


@njit(cache=True, nogil=True, error_model="numpy")
def _above(radius: np.float32, start: np.float32, fade: np.float32) -> np.float32:
    """How much of a disc is drawn at levels that start at a radius [1]."""
    return min(max((radius - start) / (fade * start), np.float32(0.0)), np.float32(1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(
    layer: tuple[Float32, Float32, Float32], sums: Float32, places: npt.NDArray[np.int64],
    corner: tuple[int, int], starts: tuple[float, float], band: Band,
) -> None:  # fmt: skip
    """Add rows of a layer to the sums (n, `SUMS`) of the coarser levels that its discs belong to.

    `places` is the first pixel in `sums`, columns, first column and row of each level (L, 4),
    `corner` the layer's column and row in the frame, `starts` the radius from which discs go over
    to the second level [px] and the share of it over which they do.
    """
    colours, radii, skews = layer
    width, last = radii.shape[1], len(places)
    first, fade = np.float32(starts[0]), np.float32(starts[1])
    zero, one = np.float32(0.0), np.float32(1.0)
    for k in range(last):
        start, columns, _, top = places[k]
        begin = ((band[0] + corner[1]) >> (k + 1)) - top
        end = ((band[1] + corner[1] - 1) >> (k + 1)) - top + 1
        sums[start + begin * columns : start + end * columns] = zero
    for y in range(band[0], band[1]):
        for x in range(width):
            radius = abs(radii[y, x])
            if not radius > first:
                continue
            level, begun = 1, first
            while level < last and radius > begun + begun:
                level, begun = level + 1, begun + begun
            part = _above(radius, begun, fade)
            light = load4(colours, 4 * (y * width + x))
            disc = pack4(one, radius, radii[y, x], skews[0, y, x])
            skew = pack4(skews[1, y, x], zero, zero, zero)
            for k in range(2 if level > 1 and part < one else 1):
                n = level - k
                start, columns, left, top = places[n - 1]
                row = ((y + corner[1]) >> n) - top
                at = SUMS * (start + row * columns + ((x + corner[0]) >> n) - left)
                share = splat(part if k == 0 else one - part)
                store4(sums, at, load4(sums, at) + share * light)
                store4(sums, at + 4, load4(sums, at + 4) + share * disc)
                store4(sums, at + 8, load4(sums, at + 8) + share * skew)


def _gather_coarse(
    layer: SourceLayer,
    corner: tuple[int, int],
    boxes: list[Box],
    starts: tuple[float, float],
    threads: int | None,
) -> list[Float32]:
    """Sums (h, w, `SUMS`) of each coarser level's `boxes`, good until this thread asks again."""
    if not boxes:
        return []
    counts = [box.width * box.height for box in boxes]
    firsts = [sum(counts[:k]) for k in range(len(boxes))]
    sums = scratch("coarse sums", (sum(counts), SUMS))
    places = np.array(
        [(first, box.width, box.x0, box.y0) for first, box in zip(firsts, boxes, strict=True)]
    )
    height = layer.radius_px.shape[0]
    step = max(_GATHERED_ROWS, 1 << len(boxes))
    edges = [0, *range(step - corner[1] % step, height, step), height]
    source = (layer.rgba, layer.radius_px, layer.skew)
    work = partial(_gather, source, sums, places, corner, starts)
    parallel_for(work, zip(edges[:-1], edges[1:], strict=True), threads)
    return [
        sums[first : first + count].reshape(box.height, box.width, SUMS)
        for first, count, box in zip(firsts, counts, boxes, strict=True)
    ]


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(numbers: Float32, rows: RowNumbers, y: int, rule: Rule) -> None:
    """Split the mass of a row's pixels, which is in `SPAN`, in span and stamp by their radius."""
    start, stop = np.float32(rule[0]), np.float32(rule[1])
    outer, surplus, aspect = rule[2], np.float32(rule[3]), np.float32(rule[4])
    zero, one, pi = np.float32(0.0), np.float32(1.0), np.float32(math.pi)
    width = numbers.shape[2]
    most, first, last = zero, width, -1
    most_stamp, first_stamp, last_stamp = zero, width, -1
    for x in range(width):
        mass = numbers[y, SPAN, x]
        numbers[y, STAMP_RADIUS, x] = numbers[y, RADIUS, x]
        numbers[y, AXIS, x] = numbers[y, SPAN, x] = numbers[y, STAMP, x] = zero
        if mass == zero:
            continue
        radius = abs(numbers[y, RADIUS, x])
        as_span = min(max((radius - start) / (stop - start), zero), one)
        if as_span > zero:
            upright = radius * aspect
            across = np.sqrt(radius * radius - surplus)
            area = pi * across * np.sqrt(upright * upright - surplus)
            numbers[y, AXIS, x] = across
            numbers[y, SPAN, x] = mass * as_span / area
            most, first, last = max(most, radius), min(first, x), x
        if as_span < one:
            numbers[y, STAMP, x] = mass * (one - as_span)
            most_stamp = max(most_stamp, radius)
            first_stamp, last_stamp = min(first_stamp, x), x
    rows[0, y] = math.ceil(most * outer * aspect - 0.5) if last >= 0 else -1
    rows[1, y], rows[2, y] = first, last
    least = 0 if most_stamp == zero else 1
    # a small disc is larger than its radius, by `disc.fitted_radii`
    most_stamp = max(most_stamp, np.float32(0.5) + np.float32(0.25) * most_stamp)
    if outer > 1.0:  # and a picture's is drawn between tables an eighth of a pixel apart
        most_stamp += np.float32(0.125)
    rows[3, y] = max(least, math.ceil(most_stamp * outer * aspect - 0.5)) if last_stamp >= 0 else -1
    rows[4, y] = max(least, math.ceil(most_stamp * outer - 0.5))
    rows[5, y], rows[6, y] = first_stamp, last_stamp


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_fine(
    layer: tuple[Float32, Float32], numbers: Float32, rows: RowNumbers, rule: Rule,
    starts: tuple[float, float], band: Band,
) -> None:  # fmt: skip
    """Fill rows of the first level from a layer's signed radii and skews."""
    radii, skews = layer
    start, fade = np.float32(starts[0]), np.float32(starts[1])
    for y in range(band[0], band[1]):
        for x in range(radii.shape[1]):
            radius = radii[y, x]
            mass = np.float32(0.0)
            if not math.isnan(radius):
                mass = np.float32(1.0) - _above(abs(radius), start, fade)
            numbers[y, SPAN, x] = mass
            numbers[y, RADIUS, x] = radius if mass > 0.0 else np.float32(0.0)
            numbers[y, ALONG, x] = skews[0, y, x]
            numbers[y, DOWN, x] = skews[1, y, x]
        _weigh(numbers, rows, y, rule)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_coarse(
    sums: Float32, light: Light, rows: RowNumbers, rule: Rule, size: int, band: Band
) -> None:
    """Fill rows of a level of pixels `size` times as large, from its sums (h, w, `SUMS`)."""
    rgba, numbers = light
    # moving light to the middle of a block and back by interpolation spreads it already
    spread = np.float32(4.0 / 3.0 * (1.0 - 1.0 / (size * size)))
    zero, scale = np.float32(0.0), np.float32(size)
    for y in range(band[0], band[1]):
        for x in range(rgba.shape[1]):
            here = sums[y, x]
            whole = max(here[4], np.float32(1e-30))
            for c in range(4):
                rgba[y, x, c] = here[c] / whole
            mean = here[5] / (whole * scale)
            mean = np.sqrt(max(mean * mean - spread, zero))
            numbers[y, RADIUS, x] = mean if here[6] >= zero else -mean
            numbers[y, SPAN, x] = here[4]
            numbers[y, ALONG, x] = scale * here[7] / whole
            numbers[y, DOWN, x] = scale * here[8] / whole
        _weigh(numbers, rows, y, rule)


def make_levels(
    layer: SourceLayer,
    corner: tuple[int, int],
    radius_px: float,
    detail: Detail,
    rule: Rule,
    threads: int | None,
) -> list[Level]:
    """Make the levels for discs up to `radius_px`, the coarsest first.

    `corner` is column and row of the layer's box in the frame [px].
    """
    height, width = layer.radius_px.shape
    whole = Box(corner[0], corner[1], corner[0] + width, corner[1] + height)
    boxes = [on_level(whole, level) for level in range(1, detail.levels(radius_px))]
    starts = detail.coarse_px, COARSE_FADE
    gathered = _gather_coarse(layer, corner, boxes, starts, threads)
    levels: list[Level] = []
    jobs: list[Callable[[], None]] = []
    for level, (box, sums) in enumerate(zip(boxes, gathered, strict=True), 1):
        rgba = scratch(f"colours {level}", (box.height, box.width, 4))
        numbers, rows = _empty(box, level)
        coarse = partial(_fill_coarse, sums, (rgba, numbers), rows, rule, 1 << level)
        jobs += [partial(coarse, band) for band in bands(box.height, BAND_ROWS)]
        levels.append(Level(box=box, light=(rgba, numbers), rows=rows))
    numbers, rows = _empty(whole, 0)
    fine = partial(_fill_fine, (layer.radius_px, layer.skew), numbers, rows, rule, starts)
    jobs += [partial(fine, band) for band in bands(height, BAND_ROWS)]
    run_all(jobs, threads)
    return [*levels[::-1], Level(box=whole, light=(layer.rgba, numbers), rows=rows)]


def on_level(box: Box, level: int) -> Box:
    """The pixels of a level that cover a box of the frame [px of the level]."""
    return Box(box.x0 >> level, box.y0 >> level, -(-box.x1 >> level), -(-box.y1 >> level))


def _empty(box: Box, level: int) -> tuple[Float32, RowNumbers]:
    return (
        scratch(f"numbers {level}", (box.height, NUMBERS, box.width)),
        np.empty((7, box.height), np.int32),
    )
