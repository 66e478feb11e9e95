"""Visibility: the nearest triangle of each sample (scanline rasterisation with a depth test).

A pixel has four samples in the rotated-grid pattern of graphics hardware. Their rows lie a quarter
of a pixel apart, so the picture is `4 h` lines of one sample a pixel, and a triangle covers one run
of each line. A sample stores its triangle and disparity, which is affine across the screen; shading
follows once per surface and pixel (`deferred`).
"""

from __future__ import annotations

import math

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import inlined, kernel
from nlens_video.native import kernels
from nlens_video.render.software.triangles import (
    Int32,
    Shape,
    crossing,
    on_screen,
)

Line = tuple[float, float, float]
"""Column at which a line across rows lies: at a row, columns a row on, the row [px]."""
Sides = tuple[Line, Line, Line, float]

SAMPLE_X = (0.375, 0.875, 0.125, 0.625)
SAMPLE_Y = (0.125, 0.375, 0.625, 0.875)
"""Where in a pixel its samples lie [px]."""
PADDING = kernels.PADDING
"""Columns stored to the right of the picture, of any content."""
NOTHING = -1
"""No triangle."""
_SNAP = 1.5 * 2.0**20  # adding and taking it away rounds to 2^-32


@inlined
def _edge(p: Line, q: Line) -> Line:
    """The line through two points, going down; columns at a row."""
    return p[0], (q[0] - p[0]) / (q[1] - p[1]), p[1]


@inlined
def _at(line: Line, y: float) -> float:
    """Its column at a row, exact to 2^-32: columns of samples are met exactly or not at all."""
    return (line[0] + line[1] * (y - line[2]) + _SNAP) - _SNAP


@inlined
def _sides(a: Line, b: Line, c: Line) -> Sides:
    """Edges of a triangle before the camera: the long one, those above and below the middle row."""
    if b[1] < a[1]:
        a, b = b, a
    if c[1] < a[1]:
        a, c = c, a
    if c[1] < b[1]:
        b, c = c, b
    long_ = _edge(a, c)
    upper = _edge(a, b) if b[1] > a[1] else long_
    lower = _edge(b, c) if c[1] > b[1] else long_
    return long_, upper, lower, b[1]


@inlined
def _covered(sides: Sides, line: int, width: int) -> tuple[int, int]:
    """Columns of a line that a triangle covers: the first, and one beyond the last."""
    y = 0.25 * line + 0.125
    short = sides[1] if y < sides[3] else sides[2]
    one, other = _at(sides[0], y), _at(short, y)
    shift = SAMPLE_X[line & 3]
    left = math.ceil(max(min(one, other) - shift, 0.0))
    return left, math.ceil(min(max(one, other) - shift, float(width)))


@kernel
def _cut(
    run: tuple[float, float], slope: float, level: float
) -> tuple[float, float]:  # fmt: skip
    """The part of a run of columns [px] where slope * x + level >= 0."""
    if slope > 0.0:
        return max(run[0], -level / slope), run[1]
    if slope < 0.0:
        return run[0], min(run[1], -level / slope)
    return run if level >= 0.0 else (1.0, 0.0)


@kernel
def _covered_crossing(
    planes: tuple[Line, Line, Line], highest: float, line: int, width: int
) -> tuple[int, int]:
    """Columns of a line that a triangle through the near plane covers, as far as it is drawn."""
    p, q, r = planes
    y = 0.25 * line + 0.125
    level = (p[1] + q[1] + r[1]) * y + p[2] + q[2] + r[2]
    run = (0.0, float(width))
    for k in range(3):
        run = _cut(run, planes[k][0], planes[k][1] * y + planes[k][2])
    run = _cut(run, -(p[0] + q[0] + r[0]), highest - level)
    if not run[0] <= run[1]:
        return 0, 0
    shift = SAMPLE_X[line & 3]
    return math.ceil(max(run[0] - shift, 0.0)), math.ceil(run[1] - shift)


@kernel
def covered(shape: Shape, t: int, line: int, width: int) -> tuple[int, int]:
    """Columns of a line that a triangle covers: the first, and one beyond the last."""
    a, b, c = on_screen(shape, t)
    if min(a[2], b[2], c[2]) > 0.0:
        low, high = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        inside = low <= 0.25 * line + 0.125 < high
        return _covered(_sides(a, b, c), line, width) if inside else (0, 0)
    _, planes = crossing(shape, t)
    return _covered_crossing(planes, 1.0 / shape[3][16], line, width)


def fill(
    drawn: Int32, first: int, last: int, shape: Shape, spans: Int32, width: int,
    disparity: Float32, ids: Int32,
) -> None:  # fmt: skip
    """Draw triangles on the lines [first, last]; of equal disparities the later one stays.

    Args:
        drawn: the triangles, in the order in which they are drawn.
        first: first line of samples.
        last: last line.
        shape: the triangles on the screen.
        spans: from `triangles.set_up` (F, 2).
        width: columns of the picture [px].
        disparity: changed: of each sample (4 h, width + PADDING), 0 where there is nothing
            [1 / scene unit].
        ids: changed: triangle of each sample (4 h, width + PADDING).
    """
    kernels.fill_triangles(drawn, first, last, shape, spans, width, disparity, ids)


def fill_behind(
    drawn: Int32, rows: tuple[int, int], drawn_shape: tuple[Shape, Int32], most: Float32,
    planes: Float32, disparity: Float32, ids: Int32,
) -> None:  # fmt: skip
    """Draw triangles on rows [first, last) where they lie behind others, as `fill` does.

    Args:
        drawn: the triangles, in the order in which they are drawn.
        rows: first row, and one beyond the last [px].
        drawn_shape: the triangles on the screen, and first and last line of samples of each (F, 2).
        most: largest disparity that is drawn in each pixel (h, w) [1 / scene unit].
        planes: from `triangles.set_up` (F, 16).
        disparity: changed, as by `fill`.
        ids: changed.
    """
    shape, spans = drawn_shape
    first, last = 4 * rows[0], 4 * rows[1] - 1
    kernels.fill_triangles_behind(
        drawn, first, last, shape, spans, most, planes, disparity, ids
    )  # fmt: skip
