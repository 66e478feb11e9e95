"""Optical vignetting (cat's eye): the part of each disc that the lens barrel lets through."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numba import njit

from nlens_video.core.layers import Box, Float32
from nlens_video.core.optics import Aperture
from nlens_video.kernels.scatter.extend import BAND_ROWS, Band, bands
from nlens_video.kernels.scatter.levels import Level
from nlens_video.kernels.scatter.scatter_rows import place_spans
from nlens_video.kernels.scatter.stamps import Discs
from nlens_video.kernels.thread_pool import parallel_for

# `levels` has the same: a number from there would go stale in the cache.
RADIUS, AXIS, SPAN, STAMP, ALONG, DOWN, STAMP_RADIUS, BARREL_X, BARREL_Y = range(9)


@njit(cache=True, nogil=True, error_model="numpy")
def _cut(
    numbers: Float32, discs: Discs, place: tuple[float, float, float], scale: tuple[float, float],
    band: Band,
) -> None:  # fmt: skip
    """Compute the barrel's centre for rows of a level, and compensate the light that it blocks.

    Args:
        numbers: of the level (h, 9, w); the barrel's place is filled in, weights of spans grow,
            radii of stamps, which stay round, shrink to the area that is left.
        discs: tables.
        place: column and row of the level's corner from the middle of the frame, size of its
            pixels [px].
        scale: centre of the barrel by distance from the middle of the frame [radius / px of the
            frame's height]; width of a pixel by its height.
        band: first row and the one past the last.
    """
    width = numbers.shape[2]
    outer, reach = np.float32(discs[5]), discs[1].shape[0] // 2
    whole, left = np.zeros(width, np.float32), np.zeros(width, np.float32)
    ends = np.empty((3, width), np.float32)
    for y in range(band[0], band[1]):
        row = numbers[y]
        down = (place[1] + (y + 0.5) * place[2]) * scale[0]
        furthest = np.float32(0.0)
        for x in range(width):
            across = (place[0] + (x + 0.5) * place[2]) * scale[0] * scale[1]
            side = row[AXIS, x] if row[RADIUS, x] <= 0.0 else -row[AXIS, x]
            row[BARREL_X, x], row[BARREL_Y, x] = side * across, side * down * scale[1]
            off = min(math.sqrt(across * across + down * down) / float(discs[5]), 2.0)
            area = 2.0 * math.acos(0.5 * off) - 0.5 * off * math.sqrt(4.0 - off * off)
            row[STAMP_RADIUS, x] = row[RADIUS, x] * math.sqrt(area / math.pi)
            furthest = max(furthest, row[AXIS, x])
        if furthest == 0.0:
            continue
        whole[:] = 0.0
        left[:] = 0.0
        rows = min(reach, math.ceil(float(furthest) * float(outer) * scale[1]))
        for dy in range(-rows, rows + 1):
            place_spans(ends, row, discs, (0, width - 1), dy, np.float32(0.0), 0.0)
            for x in range(width):
                whole[x] += ends[1, x] - ends[0, x]
            place_spans(ends, row, discs, (0, width - 1), dy, np.float32(0.0), discs[5])
            for x in range(width):
                left[x] += ends[1, x] - ends[0, x]
        for x in range(width):
            if row[SPAN, x] > 0.0:
                row[SPAN, x] *= whole[x] / max(left[x], np.float32(1e-6))


def vignette_discs(
    level: Level,
    size: int,
    aperture: Aperture,
    frame: Box,
    discs: Discs,
    threads: int | None,
) -> None:
    """Clip the discs of a level, in place, by the barrel (`shape.barrel_centre`).

    Args:
        level: its numbers change.
        size: pixels of the frame that make one of the level's.
        aperture: its `cat_eye`.
        frame: the frame; only its size matters.
        discs: tables, the cat's eye left out.
        threads: how many share the work at most.
    """
    aspect = discs[4]
    per_px = -aperture.cat_eye / (0.5 * math.hypot(frame.width * aspect, frame.height))
    place = (
        level.box.x0 * size - 0.5 * frame.width,
        level.box.y0 * size - 0.5 * frame.height,
        float(size),
    )
    work = partial(_cut, level.light[1], discs, place, (per_px, aspect))
    parallel_for(work, bands(level.box.height, BAND_ROWS), threads)
