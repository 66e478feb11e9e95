"""Defocus as a lens makes it: every source pixel is spread over the shape of the aperture.

The blur is a true scatter (each pixel by its own CoC) in scene-linear light. A convex aperture is
kept as the left and right end of every row of its unit shape, so a pixel costs one pair of writes
per row into a difference buffer, whatever the width of its disc; a running sum along the rows ends
the work. Neighbours in a row whose discs are alike are written together, as vectors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]
ROWS = 257
FINE_SUB_ROWS, SUB_ROWS = 8, 2
FINE_RADIUS_PX, COARSE_RADIUS_PX = 1.5, 5.0
MOST_SPANS = 81  # rows of the largest disc
MARGIN = 44  # columns beside the canvas, on which discs may begin and end [px]


@dataclass(frozen=True, slots=True)
class Aperture:
    """A convex aperture on the unit disc.

    Attributes:
        left: left end of row i, at height 2 i / (ROWS - 1) - 1, in units of the radius (ROWS,).
        right: right end of that row; below `left` where the row misses the shape (ROWS,).
    """

    left: Float32
    right: Float32


def round_aperture() -> Aperture:
    """The full disc."""
    height = np.linspace(-1.0, 1.0, ROWS)
    half = np.sqrt(np.maximum(0.0, 1.0 - height**2))
    return Aperture(np.float32(-half), np.float32(half))


def polygon_aperture(blades: int, turn: float) -> Aperture:
    """A regular polygon of the disc's area (so that its CoC still means the diameter).

    Args:
        blades: number of edges, >= 5 [1].
        turn: rotation [rad].
    """
    apothem = np.sqrt(np.pi / (blades * np.tan(np.pi / blades)))
    height = np.linspace(-1.0, 1.0, ROWS)
    left, right = np.full(ROWS, -2.0), np.full(ROWS, 2.0)
    for blade in range(blades):
        angle = turn + 2 * np.pi * blade / blades
        nx, ny = np.cos(angle), np.sin(angle)
        if abs(nx) < 1e-6:
            right[height * ny > apothem] = -3.0
            continue
        edge = (apothem - height * ny) / nx
        if nx > 0:
            right = np.minimum(right, edge)
        else:
            left = np.maximum(left, edge)
    return Aperture(np.float32(left), np.float32(right))


def cat_eye_aperture(shift: float, angle: float) -> Aperture:
    """The disc cut by a second, slightly larger disc (mechanical vignetting off the axis).

    Args:
        shift: distance between the centres, 0 to 1 [radius].
        angle: direction of the cut [rad].
    """
    height = np.linspace(-1.0, 1.0, ROWS)
    half = np.sqrt(np.maximum(0.0, 1.0 - height**2))
    reach = 1.1
    cx, cy = shift * np.cos(angle), shift * np.sin(angle)
    inside = reach**2 - (height - cy) ** 2
    cut = np.sqrt(np.maximum(0.0, inside))
    left, right = np.maximum(-half, cx - cut), np.minimum(half, cx + cut)
    right[inside < 0] = -3.0
    return Aperture(np.float32(left), np.float32(right))


def _matched_radii(radii: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Radii whose anti-aliased disc on whole pixels has the variance r^2 / 4 of the true disc of r.

    Coverage adds the pixel's own variance (1/12 an axis) to large discs and loses all of it below
    half a pixel; without this a CoC of one pixel would not blur at all.
    """
    fine = 32
    axis = (np.arange(5 * fine) + 0.5) / fine - 2.5
    squared = axis[:, None] ** 2 + axis[None, :] ** 2
    whole = np.repeat(np.arange(-2, 3), fine)[None, :] ** 2
    trial = np.linspace(0.45, 2.4, 118)
    variance = [
        float(np.mean(np.broadcast_to(whole, squared.shape)[squared < r * r])) for r in trial
    ]
    near = np.interp(radii**2 / 4, np.maximum.accumulate(variance), trial)
    return np.where(radii < 2.2, near, np.sqrt(np.maximum(0.0, radii**2 - 1.0 / 3.0)))


_TABLE_STEP = 0.02
_TABLE = np.float32(_matched_radii(np.arange(0.0, 40.0, _TABLE_STEP)))


@numba.njit(cache=True, fastmath=True)
def _spans(radius: float, parts: int, left: Float32, right: Float32, spans: Float32) -> float:
    """Fill in the ends of every row of a disc [px]; returns the sum of their lengths [px]."""
    total = 0.0
    reach = int(radius + 0.5)
    for step in range((2 * reach + 1) * parts):
        height = ((step + 0.5) / parts - reach - 0.5) / radius
        place = (height + 1.0) * 0.5 * (ROWS - 1)
        index = int(place)
        spans[step, 0], spans[step, 1] = 0.0, -1.0
        if place >= 0.0 and index < ROWS - 1:
            part = place - index
            spans[step, 0] = radius * (left[index] * (1 - part) + left[index + 1] * part)
            spans[step, 1] = radius * (right[index] * (1 - part) + right[index + 1] * part)
        total += max(0.0, spans[step, 1] - spans[step, 0])
    return total


@numba.njit(cache=True, fastmath=True)
def _add(
    sums: Float64, source: Float32, first: int, last: int, place: float, step: int, weight: float
) -> None:
    """Add a run of pixels to a row, displaced; each is shared by the two pixels it then lies on.

    Args:
        sums: row to add to, flat; its first pixel is MARGIN before the canvas.
        source: row of the picture, flat.
        first: where the run begins in `source`.
        last: where it ends.
        place: displacement [px].
        step: channels of a pixel.
        weight: factor.
    """
    whole = int(np.floor(place))
    later = weight * (place - whole)
    sooner = weight - later
    start = first + (whole + MARGIN) * step
    values = source[first:last]
    near, far = sums[start : start + len(values)], sums[start + step :]
    for k in range(len(values)):
        near[k] += sooner * values[k]
    for k in range(len(values)):
        far[k] += later * values[k]


@numba.njit(cache=True, fastmath=True)
def _scatter(
    source: Float32, level: npt.NDArray[np.int32], radii: Float32, ends: tuple[Float32, Float32]
) -> Float32:
    """Sums (H, W C) of every disc of the picture (H, W C); neighbours of one radius go together.

    Args:
        source: values to spread (H, W C).
        level: which radius each pixel has (H, W).
        radii: of the levels; one of at most half a pixel spreads nothing [px].
        ends: left and right end of the aperture's rows.
    """
    rows, columns = level.shape
    step = source.shape[1] // columns
    sums = np.zeros((rows, source.shape[1] + 2 * MARGIN * step), np.float64)
    spans = np.empty((len(radii), MOST_SPANS, 2), np.float32)
    lengths = np.full(len(radii), -1.0)
    for y in range(rows):
        stop = 0
        while stop < columns:
            start, this = stop, level[y, stop]
            while stop < columns and level[y, stop] == this:
                stop += 1
            first, last, radius = start * step, stop * step, radii[this]
            if radius <= 0.5:
                _add(sums[y], source[y], first, last, 0.0, step, 1.0)
                _add(sums[y], source[y], first, last, 1.0, step, -1.0)
                continue
            parts = 1 if radius > COARSE_RADIUS_PX else SUB_ROWS
            if radius < FINE_RADIUS_PX:
                parts = FINE_SUB_ROWS
            if lengths[this] < 0.0:
                lengths[this] = _spans(radius, parts, ends[0], ends[1], spans[this])
            if lengths[this] <= 0.0:
                continue
            weight, reach = 1.0 / lengths[this], int(radius + 0.5)
            for row in range((2 * reach + 1) * parts):
                at = y + row // parts - reach
                begin, end = spans[this, row]
                if 0 <= at < rows and end > begin:
                    _add(sums[at], source[y], first, last, 0.5 + begin, step, weight)
                    _add(sums[at], source[y], first, last, 0.5 + end, step, -weight)
    return _summed(sums, step, columns)


@numba.njit(cache=True, fastmath=True)
def _summed(differences: Float64, step: int, columns: int) -> Float32:
    """Running sums along the rows, without the margins."""
    rows = len(differences)
    result = np.empty((rows, columns * step), np.float32)
    for y in range(rows):
        for k in range(step, (MARGIN + columns) * step):
            differences[y, k] += differences[y, k - step]
        for k in range(columns * step):
            result[y, k] = differences[y, k + MARGIN * step]
    return result


def scatter(source: Float32, coc_px: Float32, aperture: Aperture) -> Float32:
    """Spread every pixel over its own circle of confusion; energy is kept inside the canvas.

    Args:
        source: values to spread, scene-linear (H, W, C).
        coc_px: CoC diameter, any sign, |CoC| < 78 (H, W) [px].
        aperture: shape of the disc.

    Returns:
        Sums (H, W, C), not normalised: carry a channel of ones along to divide by.
    """
    level = np.minimum(np.abs(coc_px) * (0.5 / _TABLE_STEP), len(_TABLE) - 1).astype(np.int32)
    level[_TABLE[level] <= 0.5] = 0
    # A disc ahead of the focal plane is the mirror image of one behind it; shapes are drawn at
    # random turns, so one orientation is enough.
    flat = np.ascontiguousarray(source).reshape(len(source), -1)
    return _scatter(flat, level, _TABLE, (aperture.left, aperture.right)).reshape(source.shape)
