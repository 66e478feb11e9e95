"""Multi-resolution source of the scatter: large discs are drawn from coarser levels.

From the radius `coarse_px` on, a disc fades to the next level, whose pixels are twice as large, and
so on: no disc spans more than `largest_px` of its level's pixels. All levels share the frame's
grid, so the result depends neither on the layer's box nor on the frame's size. A pixel is shared by
the four coarse ones around it (bilinear splatting), so that light keeps its mean place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.scatter.extend import BAND_ROWS, SourceLayer
from nlens_video.kernels.scratch import scratch
from nlens_video.kernels.thread_pool import bands, parallel_for, run_all
from nlens_video.native import kernels

_GATHERED_ROWS = 32  # at least, and a power of two: a band begins with a row of each level
COARSE_FADE = 0.25
"""Share of a level's first radius over which discs go over to it [1]."""
SUMS = 12
"""Sums of a coarse pixel: premultiplied colour and alpha, mass, radius, signed radius, skew along
columns and rows; the rest is 0."""


class Detail(Struct, frozen=True, kw_only=True):
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
        largest = 1 << (self.levels(radius_px) - 1)
        return 0 if largest == 1 else 5 * largest // 2 - 2


# What the pixels of a level (h, w) spread: the mean light of those they stand for (h, w, 4), and
# the numbers below of each (h, 9, w), in the pixels of the level.
Light = tuple[Float32, Float32]
RADIUS, AXIS, SPAN, STAMP, ALONG, DOWN, STAMP_RADIUS, BARREL_X, BARREL_Y = range(9)
NUMBERS = 9
"""Signed radius, fitted half axis in columns, weights of span and stamp, skew, signed radius of the
stamp; then column and row of the barrel's middle, filled in where the aperture has a cat's eye."""
# `stamps_px`, `spans_px`, the aperture's furthest point [radius], `disc.SURPLUS`, width of a pixel
# by its height.
Rule = tuple[float, float, float, float, float]
RowNumbers = npt.NDArray[np.int32]


class Level(Struct, frozen=True, kw_only=True):
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
        [
            (first, box.width, box.height, box.x0, box.y0)
            for first, box in zip(firsts, boxes, strict=True)
        ]
    )
    height = layer.radius_px.shape[0]
    step = max(_GATHERED_ROWS, 1 << len(boxes))
    edges = [0, *range(step - corner[1] % step, height, step), height]
    source = (layer.rgba, layer.radius_px, layer.skew)
    work = partial(kernels.gather_levels, source, sums, places, corner[::-1], starts)
    parallel_for(work, zip(edges[:-1], edges[1:], strict=True), threads)
    return [
        sums[first : first + count].reshape(box.height, box.width, SUMS)
        for first, count, box in zip(firsts, counts, boxes, strict=True)
    ]


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
    # light at the layer's border is shared with pixels beyond it
    boxes = [on_level(whole, level).expanded(1) for level in range(1, detail.levels(radius_px))]
    starts = detail.coarse_px, COARSE_FADE
    gathered = _gather_coarse(layer, corner, boxes, starts, threads)
    levels: list[Level] = []
    jobs: list[Callable[[], None]] = []
    for level, (box, sums) in enumerate(zip(boxes, gathered, strict=True), 1):
        rgba = scratch(f"colours {level}", (box.height, box.width, 4))
        numbers, rows = _empty(box, level)
        coarse = partial(kernels.fill_coarse_level, sums, rgba, numbers, rows, rule, 1 << level)
        jobs += [partial(coarse, band) for band in bands(box.height, BAND_ROWS)]
        levels.append(Level(box=box, light=(rgba, numbers), rows=rows))
    numbers, rows = _empty(whole, 0)
    of_layer = layer.radius_px, layer.skew
    fine = partial(kernels.fill_fine_level, *of_layer, numbers, rows, rule, starts)
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
