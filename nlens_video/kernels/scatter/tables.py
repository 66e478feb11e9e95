"""Tables of an aperture's discs, from which kernels read by a disc's radius.

A table holds the discs of one side of the focus after those of the other: the latter are the
former turned by half a turn. Where that changes nothing, one side is all there is.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.core.optics import Aperture
from nlens_video.kernels.scatter import disc
from nlens_video.kernels.scatter.disc import fitted_radii, fitted_radius, half_chords, reach
from nlens_video.kernels.scatter.shape import outer_radius, read_picture, row_ends

STAMP_STEPS = 64
SPAN_STEPS = 16
PICTURE_STEPS = 8
"""Table entries per pixel of radius; kernels interpolate linearly between them."""
SUB_ROWS = 16
"""Lines by which a row of pixels is measured, where no closed form is at hand."""


class DiscTables(NamedTuple):
    """What discs of one aperture give, for discs up to one radius.

    Attributes:
        stamps: weight of pixel (dy, dx) around the middle, by nominal radius in columns,
            (2 * rows + 1, 2 * columns + 1, K).
        spans: middle and half length of row dy, around the middle, as shares of the fitted half
            axis, by nominal radius in columns, (2 * rows + 1, 2, K).
        stamp_steps: entries of `stamps` per pixel of radius.
        stamp_turned: where in `stamps` the discs before the focus start, 0 if they are the same.
        span_turned: where in `spans` they start.
        outer: distance of the aperture's furthest point from its middle, >= 1 [radius].
        largest_px: radius in columns up to which `stamps` go [px].
    """

    stamps: Float32
    spans: Float32
    stamp_steps: int
    stamp_turned: int
    span_turned: int
    outer: float
    largest_px: float


def coverage(
    aperture: Aperture,
    radius_px: float,
    pixel_aspect: float,
    barrel: tuple[float, float] = (0.0, 0.0),
) -> Float64:
    """How much light of a disc behind the focus each pixel gets; their sum is 1.

    Args:
        aperture: the shape.
        radius_px: nominal radius in columns [px].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        barrel: `shape.barrel_centre` at that place of the frame [radius].

    Returns:
        Weights (2 * rows + 1, 2 * columns + 1) around the pixel.

    Raises:
        InputError: the aperture is a picture that cannot be read.
    """
    rx, ry = fitted_radius(radius_px), fitted_radius(radius_px * pixel_aspect)
    if aperture.image is not None:
        return _picture_coverage(_picture(aperture.image), rx, ry)
    outer = outer_radius(aperture)
    rows, columns = reach(ry * outer), reach(rx * outer)
    if aperture.blades == 0 and barrel == (0.0, 0.0):
        return disc.coverage(rx, ry)
    y = _lines(rows) / ry
    left, right = row_ends(aperture, y)
    rim = outer * outer - (y - barrel[1]) ** 2
    left = np.maximum(left, barrel[0] - np.sqrt(np.maximum(rim, 0.0)))
    right = np.where(rim > 0.0, np.minimum(right, barrel[0] + np.sqrt(np.maximum(rim, 0.0))), -9.0)
    return lines_coverage(left * rx, right * rx, columns)


def _lines(rows: int) -> Float64:
    """Heights of the lines in 2 * rows + 1 rows of pixels [px]."""
    return np.asarray((np.arange((2 * rows + 1) * SUB_ROWS) + 0.5) / SUB_ROWS - rows - 0.5)


def lines_coverage(left: Float64, right: Float64, columns: int) -> Float64:
    """Weights of pixels that lines from `left` to `right` lie on, `SUB_ROWS` lines a row.

    Args:
        left: start of each line, from the middle of the middle column (n,) [px].
        right: its end; no line where it lies below the start (n,) [px].
        columns: how many columns on each side of the middle one.

    Returns:
        Weights (n / SUB_ROWS, 2 * columns + 1), their sum is 1.
    """
    edges = np.arange(2 * columns + 2) - columns - 0.5
    filled = np.clip(edges, left[:, None], np.maximum(left, right)[:, None])
    area = np.diff(filled, axis=1).reshape(-1, SUB_ROWS, 2 * columns + 1).sum(axis=1)
    return np.asarray(area / area.sum())


@lru_cache(maxsize=4)
def _picture(path: Path) -> Float64:
    return read_picture(path)


def _picture_coverage(light: Float64, rx: float, ry: float) -> Float64:
    """Areas of a picture's pixels, scaled to the area of an ellipse, within the result's pixels."""
    side = math.sqrt(math.pi / light.sum())  # of one of its pixels [radius]
    summed = np.pad(np.cumsum(np.cumsum(light, axis=0), axis=1), ((1, 0), (1, 0)))
    for axis, half in ((0, ry), (1, rx)):
        size = light.shape[axis]
        margin = reach(0.5 * size * side * half)
        edges = np.arange(-margin, margin + 2) - 0.5
        at = edges / (side * half) + 0.5 * size
        low = np.clip(np.floor(at), 0, size - 1).astype(np.intp)
        part = np.clip(at - low, 0.0, 1.0)
        part = part[:, None] if axis == 0 else part[None, :]
        before, after = np.take(summed, low, axis), np.take(summed, low + 1, axis)
        summed = np.diff(before + part * (after - before), axis=axis)
    return np.asarray(np.maximum(summed, 0.0) / summed.sum())


def _stamps(aperture: Aperture, pixel_aspect: float, largest_px: float, steps: int) -> Float32:
    """Stamps by radius, one side of the focus."""
    count = int(largest_px * steps) + 2
    stamps = [coverage(aperture, index / steps, pixel_aspect) for index in range(count)]
    rows = max(stamp.shape[0] for stamp in stamps)
    columns = max(stamp.shape[1] for stamp in stamps)
    table = np.zeros((count, rows, columns), dtype=np.float32)
    for entry, stamp in zip(table, stamps, strict=True):
        top, left = (rows - stamp.shape[0]) // 2, (columns - stamp.shape[1]) // 2
        entry[top : top + stamp.shape[0], left : left + stamp.shape[1]] = stamp
    return table


def _spans(aperture: Aperture, pixel_aspect: float, largest_px: float) -> Float32:
    """Spans by radius, one side of the focus."""
    count = int(largest_px * SPAN_STEPS) + 2
    radii = np.arange(count) / SPAN_STEPS
    down = fitted_radii(radii * pixel_aspect)
    rows = reach(float(down[-1]) * outer_radius(aperture))
    if aperture.blades == 0:
        quarter = half_chords(down, rows + 1) / down
        half = np.concatenate([quarter[:0:-1], quarter])
        return np.stack([np.zeros_like(half), half], axis=1).astype(np.float32)
    left, right = row_ends(aperture, _lines(rows)[:, None] / down[None, :])
    length = np.maximum(right - left, 0.0)
    middle = (0.5 * (right + left) * length).reshape(-1, SUB_ROWS, count).mean(axis=1)
    half = 0.5 * length.reshape(-1, SUB_ROWS, count).mean(axis=1)
    middle /= np.maximum(2.0 * half, 1e-9)
    return np.stack([middle, half], axis=1).astype(np.float32)


@lru_cache(maxsize=16)
def tables(
    aperture: Aperture, pixel_aspect: float, stamps_to_px: float, spans_to_px: float
) -> DiscTables:
    """Tables for an aperture, its cat's eye left out; kept for later calls.

    Args:
        aperture: the shape.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        stamps_to_px: radius up to which stamps are needed; a picture has no spans [px].
        spans_to_px: largest radius of all [px].

    Raises:
        InputError: the aperture is a picture that cannot be read.
    """
    even = aperture.image is None and aperture.blades % 2 == 0
    if aperture.image is not None:
        stamps = _stamps(aperture, pixel_aspect, spans_to_px, PICTURE_STEPS)
        spans = np.zeros((1, 2, 2), dtype=np.float32)
        outer = stamps.shape[2] / (2.0 * spans_to_px)
    else:
        stamps = _stamps(aperture, pixel_aspect, stamps_to_px, STAMP_STEPS)
        spans = _spans(aperture, pixel_aspect, spans_to_px)
        outer = outer_radius(aperture)
    stamp_turned, span_turned = (0, 0) if even else (stamps.shape[0], spans.shape[2])
    if not even:
        stamps = np.concatenate([stamps, stamps[:, ::-1, ::-1]])
        spans = np.concatenate([spans, spans[::-1] * np.array([[-1.0], [1.0]], np.float32)], axis=2)
    return DiscTables(
        stamps=np.ascontiguousarray(np.moveaxis(stamps, 0, 2)),
        spans=np.ascontiguousarray(spans),
        stamp_steps=STAMP_STEPS if aperture.image is None else PICTURE_STEPS,
        stamp_turned=stamp_turned,
        span_turned=span_turned,
        outer=outer,
        largest_px=spans_to_px,
    )
