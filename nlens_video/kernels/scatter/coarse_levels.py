"""Downsampling to the coarser levels of the scatter, in one pass over the source pixels."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.scatter.extend import Band, SourceLayer
from nlens_video.kernels.scratch_buffers import scratch
from nlens_video.kernels.simd import (
    load_row4,
    pack4,
    splat,
    store4,
)
from nlens_video.kernels.thread_pool import parallel_for

SUMS = 12
"""Sums of a coarse pixel: premultiplied colour and alpha, mass, radius, signed radius, skew along
columns and rows; the rest is 0."""
_ROWS = SUMS // 4
_BAND_ROWS = 32  # at least; rows of one coarse pixel stay together
# First sum, columns, first column and row of each level (L, 4).
Places = npt.NDArray[np.int64]


@njit(cache=True, nogil=True, error_model="numpy")
def above(radius: np.float32, start: np.float32, fade: np.float32) -> np.float32:
    """How much of a disc is drawn at levels that start at a radius [1]."""
    return min(max((radius - start) / (fade * start), np.float32(0.0)), np.float32(1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(
    layer: tuple[Float32, Float32, Float32], sums: Float32, places: Places,
    corner: tuple[int, int], starts: tuple[float, float], band: Band,
) -> None:  # fmt: skip
    """Add rows of a layer to the sums of the levels that its discs belong to.

    Args:
        layer: colours (h, w, 4), signed radii (h, w) and skews (2, h, w).
        sums: of all levels (n, 4), `_ROWS` rows a pixel; set to 0 first, where the rows lie.
        places: where in them each level lies, from the second level on.
        corner: column and row of the layer's box in the frame [px].
        starts: radius from which discs go over to the second level [px]; share of it over which.
        band: first row and the one past the last.
    """
    colours, radii, skews = layer
    width, last = radii.shape[1], len(places)
    first, fade = np.float32(starts[0]), np.float32(starts[1])
    zero, one = np.float32(0.0), np.float32(1.0)
    for k in range(last):
        start, columns, _, top = places[k]
        begin = ((band[0] + corner[1]) >> (k + 1)) - top
        end = ((band[1] + corner[1] - 1) >> (k + 1)) - top + 1
        for i in range(start + begin * columns * _ROWS, start + end * columns * _ROWS):
            store4(sums, 4 * i, splat(zero))
    for y in range(band[0], band[1]):
        for x in range(width):
            radius = abs(radii[y, x])
            if not radius > first:
                continue
            level, begun = 1, first
            while level < last and radius > begun + begun:
                level, begun = level + 1, begun + begun
            part = above(radius, begun, fade)
            light = load_row4(colours, y * width + x)
            disc = pack4(one, radius, radii[y, x], skews[0, y, x])
            skew = pack4(skews[1, y, x], zero, zero, zero)
            for k in range(2 if level > 1 and part < one else 1):
                n = level - k
                start, columns, left, top = places[n - 1]
                at = ((y + corner[1]) >> n) - top
                at = start + (at * columns + ((x + corner[0]) >> n) - left) * _ROWS
                share_ = splat(part if k == 0 else one - part)
                store4(sums, 4 * at, load_row4(sums, at) + share_ * light)
                store4(sums, 4 * at + 4, load_row4(sums, at + 1) + share_ * disc)
                store4(sums, 4 * at + 8, load_row4(sums, at + 2) + share_ * skew)


def gather_coarse(
    layer: SourceLayer,
    corner: tuple[int, int],
    boxes: list[Box],
    starts: tuple[float, float],
    threads: int | None,
) -> list[Float32]:
    """Sum up, for each pixel of coarser levels, those of the layer that belong to it.

    Args:
        layer: the source.
        corner: column and row of the layer's box in the frame [px].
        boxes: of the levels from the second on, each of pixels twice as large as the one before.
        starts: radius from which discs go over to the second level [px]; share of a level's first
            radius over which they go over to it [1].
        threads: how many share the work at most.

    Returns:
        Sums (h, w, `SUMS`) of each level, good until this thread asks again.
    """
    if not boxes:
        return []
    counts = [box.width * box.height * _ROWS for box in boxes]
    firsts = [sum(counts[:k]) for k in range(len(boxes))]
    sums = scratch("coarse sums", (sum(counts), 4))
    places = np.array(
        [(first, box.width, box.x0, box.y0) for first, box in zip(firsts, boxes, strict=True)]
    )
    height = layer.radius_px.shape[0]
    step = max(_BAND_ROWS, 1 << len(boxes))
    edges = [0, *range(step - corner[1] % step, height, step), height]
    source = (layer.rgba, layer.radius_px, layer.skew)
    work = partial(_gather, source, sums, places, corner, starts)
    parallel_for(work, zip(edges[:-1], edges[1:], strict=True), threads)
    return [
        sums[first : first + count].reshape(box.height, box.width, SUMS)
        for first, count, box in zip(firsts, counts, boxes, strict=True)
    ]
