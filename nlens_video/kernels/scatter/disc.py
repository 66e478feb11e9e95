"""Discs of confusion: how much of each pixel they cover, and the tables that kernels read.

A pixel may be oblong (sample aspect ratio), so a round disc is an ellipse with half axes `rx`
columns and `ry` rows. Its weights are areas divided by its own area: they sum to 1 whatever the
radius. A table holds the discs of one side of the focus after those of the other: the latter are
the former turned by half a turn. Where that changes nothing, one side is all there is.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.core.optics import Aperture
from nlens_video.kernels.scatter.shape import outer_radius, read_picture, row_ends

MAX_COC_PX = 512.0
"""Largest diameter that is told apart; a larger CoC is treated as this one [px]."""
STAMP_STEPS = 64
SPAN_STEPS = 16
PICTURE_STEPS = 8
"""Table entries per pixel of radius; kernels interpolate linearly between them."""
SUB_ROWS = 16
"""Lines by which a row of pixels is measured, where no closed form is at hand."""
# The disc whose pixel areas, applied to pictures that are themselves samples of pixel areas, come
# closest to the true disc: least squares over straight edges of every position and angle, by
# brute force. Below about half a pixel the nominal disc would lie in its own pixel and do nothing.
_NOMINAL = (
    *(0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9),
    *(1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.7, 2.0),
)
_FITTED = (
    *(0.5, 0.51, 0.53, 0.55, 0.58, 0.61, 0.65, 0.69, 0.73, 0.79),
    *(0.85, 0.93, 1.02, 1.13, 1.27, 1.43, 1.67, 1.93),
)
SURPLUS = 4.0 - 1.93**2
"""By how much the square of a larger disc's radius exceeds the fitted one's [px^2]."""


class Discs(NamedTuple):
    """One aperture's tables.

    Attributes:
        stamps: weight of pixel (dy, dx) around the middle, by nominal radius in columns
            (rows, columns, K).
        spans: middle and half length of row dy, around the middle, by nominal radius, as shares of
            the fitted half axis (rows, 2, K).
        steps: entries of stamps and of spans by pixel of radius [1 / px].
        turned: where in both the discs before the focus start, 0 if they are the same.
        pixel_aspect: width of a pixel by its height [1].
        outer_radius: distance of the aperture's furthest point from its middle [radius].
    """

    stamps: Float32
    spans: Float32
    steps: tuple[int, int]
    turned: tuple[int, int]
    pixel_aspect: float
    outer_radius: float


def fitted_radii(radius_px: Float64) -> Float64:
    """The discs whose `coverage` does to a sampled picture what those of `radius_px` do to light.

    0.5, the identity, at 0; steadily larger; below the nominal radius by 1 / (7 r) from 2 px on.
    """
    fitted = np.sqrt(np.maximum(radius_px * radius_px - SURPLUS, 0.0))
    small = radius_px < _NOMINAL[-1]
    fitted[small] = np.interp(radius_px[small], _NOMINAL, _FITTED)
    return np.asarray(fitted)


def fitted_radius(radius_px: float) -> float:
    """`fitted_radii` of one disc [px]."""
    return float(fitted_radii(np.array([radius_px]))[0])


def reach(half_axis: float) -> int:
    """Whole pixels beyond its own that a disc at a pixel's centre touches."""
    return max(0, math.ceil(half_axis - 0.5))


def _segment(t: Float64, radius: Float64) -> Float64:
    """Integral of sqrt(radius^2 - t^2) from 0 to t, 0 <= t <= radius."""
    inner = np.sqrt(np.maximum(radius * radius - t * t, 0.0))
    return np.asarray(
        0.5 * (t * inner + radius * radius * np.arcsin(np.clip(t / radius, 0.0, 1.0)))
    )


def _corner_area(x: Float64, y: Float64) -> Float64:
    """Area of a centred unit circle within [0, x] by [0, y], both >= 0."""
    one = np.ones(1)
    x, y = np.minimum(x, one), np.minimum(y, one)
    flat = np.minimum(np.sqrt(np.maximum(one - y * y, 0.0)), x)
    return np.asarray(y * flat + _segment(x, one) - _segment(flat, one))


def round_coverage(rx: float, ry: float) -> Float64:
    """Weights of an ellipse at a pixel's centre (rows, columns), as of `round_coverages`."""
    return np.asarray(round_coverages(np.array([rx]), np.array([ry]))[0])


def round_coverages(rx: Float64, ry: Float64) -> Float64:
    """Weights of ellipses at a pixel's centre: exact areas over their own areas.

    Args:
        rx: half axes in columns (K,), > 0 [px].
        ry: half axes in rows (K,), > 0 [px].

    Returns:
        Weights (K, 2 * ceil(max(ry) - 0.5) + 1, 2 * ceil(max(rx) - 0.5) + 1), the sum of each is 1.
    """
    # A quarter, scaled to unit circles. Edges run from the centre and halve the middle pixel.
    x, y = (
        np.concatenate([[0.0], np.arange(reach(float(half.max())) + 1) + 0.5]) / half[:, None]
        for half in (rx, ry)
    )
    corners = _corner_area(x[:, None, :], y[:, :, None])
    area = np.diff(np.diff(corners, axis=1), axis=2) / math.pi
    area[:, 0] *= 2.0
    area[:, :, 0] *= 2.0
    quarter = np.maximum(area, 0.0)
    half = np.concatenate([quarter[:, :0:-1], quarter], axis=1)
    return np.concatenate([half[:, :, :0:-1], half], axis=2)


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
    if aperture.blades == 0 and barrel == (0.0, 0.0):
        return round_coverage(rx, ry)
    outer = outer_radius(aperture)
    y = _lines(reach(ry * outer)) / ry
    left, right = row_ends(aperture, y)
    rim = outer * outer - (y - barrel[1]) ** 2
    left = np.maximum(left, barrel[0] - np.sqrt(np.maximum(rim, 0.0)))
    right = np.where(rim > 0.0, np.minimum(right, barrel[0] + np.sqrt(np.maximum(rim, 0.0))), -9.0)
    # `SUB_ROWS` lines a row; no line where it ends left of its start
    columns = reach(rx * outer)
    edges = np.arange(2 * columns + 2) - columns - 0.5
    left, right = left * rx, right * rx
    filled = np.clip(edges, left[:, None], np.maximum(left, right)[:, None])
    area = np.diff(filled, axis=1).reshape(-1, SUB_ROWS, 2 * columns + 1).sum(axis=1)
    return np.asarray(area / area.sum())


def _lines(rows: int) -> Float64:
    """Heights of the lines in 2 * rows + 1 rows of pixels [px]."""
    return np.asarray((np.arange((2 * rows + 1) * SUB_ROWS) + 0.5) / SUB_ROWS - rows - 0.5)


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
    if aperture.image is None and aperture.blades == 0:  # all at once, which is quicker
        radii = np.arange(count) / steps
        both = fitted_radii(radii), fitted_radii(radii * pixel_aspect)
        return round_coverages(*both).astype(np.float32)
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
    down = fitted_radii(np.arange(count) / SPAN_STEPS * pixel_aspect)
    rows = reach(float(down[-1]) * outer_radius(aperture))
    if aperture.blades == 0:
        edges = np.concatenate([[0.0], np.arange(rows + 1) + 0.5])
        t = np.minimum(edges[:, None] / down[None, :], 1.0)
        mean = np.diff(_segment(t, np.ones_like(t)), axis=0) * down * down
        mean[0] *= 2.0
        quarter = mean / down
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
) -> Discs:
    """Tables for an aperture, its cat's eye left out; kept for later calls.

    Args:
        aperture: the shape.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        stamps_to_px: radius up to which stamps are needed; a picture has no spans [px].
        spans_to_px: largest radius of all [px].

    Raises:
        InputError: the aperture is a picture that cannot be read.
    """
    if aperture.image is not None:
        steps = PICTURE_STEPS
        stamps = _stamps(aperture, pixel_aspect, spans_to_px, steps)
        spans = np.zeros((1, 2, 2), dtype=np.float32)
        outer = stamps.shape[2] / (2.0 * spans_to_px)
    else:
        steps = STAMP_STEPS
        stamps = _stamps(aperture, pixel_aspect, stamps_to_px, steps)
        spans = _spans(aperture, pixel_aspect, spans_to_px)
        outer = outer_radius(aperture)
    stamp_turned = span_turned = 0
    if aperture.image is not None or aperture.blades % 2:
        stamp_turned, span_turned = stamps.shape[0], spans.shape[2]
        stamps = np.concatenate([stamps, stamps[:, ::-1, ::-1]])
        spans = np.concatenate([spans, spans[::-1] * np.array([[-1.0], [1.0]], np.float32)], axis=2)
    return Discs(
        np.ascontiguousarray(np.moveaxis(stamps, 0, 2)), np.ascontiguousarray(spans),
        (steps, SPAN_STEPS), (stamp_turned, span_turned), float(pixel_aspect), float(outer),
    )  # fmt: skip
