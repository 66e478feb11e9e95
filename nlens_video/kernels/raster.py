"""Which triangle each sample of the picture shows: the first half of a software rasteriser.

A pixel has four samples, where graphics hardware has them. Their rows lie a quarter of a pixel
apart, so that the picture is `4 h` lines of one sample a pixel: a triangle covers a run of each
line. What is kept of a sample is its triangle and its disparity, which is affine across the screen;
colour is worked out later, once a surface and pixel (`fragments`).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.frames import Float32, Float64
from nlens_video.kernels.screen import in_camera
from nlens_video.kernels.simd_raster import LANES, draw_run

Int32 = npt.NDArray[np.int32]
Samples = tuple[Float32, Int32, int, int]
"""Disparities and triangles, flat; columns of the picture, and those that are stored."""
Line = tuple[float, float, float]
"""Column at which a line across rows lies: at a row, columns a row on, the row [px]."""
Sides = tuple[Line, Line, Line, float]
Shape = tuple[Float64, Float32, Int32, Float64]
"""Points (V, 3) from `screen.project`, positions (V, 3), faces (F, 3), the camera's numbers."""

SAMPLES = 4
SAMPLE_X = (0.375, 0.875, 0.125, 0.625)
SAMPLE_Y = (0.125, 0.375, 0.625, 0.875)
"""Where in a pixel its samples lie [px]."""
PADDING = LANES
"""Columns stored to the right of the picture, of any content."""
NOTHING = -1
"""No triangle."""
_SNAP = 1.5 * 2.0**20  # adding and taking it away rounds to 2^-32
# Numbers of a triangle's planes: q_k = a_k (x - x0) + b_k (y - y0) + c_k is the k-th weight of its
# corners divided by depth.
PLANES = 12
X0, Y0, FACING = 9, 10, 11


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _corner_planes(
    row: Float32, a: Line, b: Line, c: Line, area: float, facing: float
) -> None:  # fmt: skip
    """Planes of a triangle whose corners (column, row, disparity) lie before the camera."""
    scale = 1.0 / area
    row[0] = (b[1] - c[1]) * scale * a[2]
    row[1] = (c[1] - a[1]) * scale * b[2]
    row[2] = (a[1] - b[1]) * scale * c[2]
    row[3] = (c[0] - b[0]) * scale * a[2]
    row[4] = (a[0] - c[0]) * scale * b[2]
    row[5] = (b[0] - a[0]) * scale * c[2]
    row[6], row[7], row[8] = a[2], 0.0, 0.0
    row[X0], row[Y0], row[FACING] = a[0], a[1], facing


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _homogeneous(position: Float32, lens: Float64) -> Line:
    right, up, depth = in_camera(position, lens)
    return lens[12] * right + lens[14] * depth, lens[15] * depth - lens[13] * up, depth


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def crossing_planes(
    a: Line, b: Line, c: Line
) -> tuple[float, tuple[Line, Line, Line]]:  # fmt: skip
    """Twice the homogeneous area, and the planes (a, b, c at the origin) of any triangle.

    The corners are homogeneous, (column * depth, row * depth, depth): the inverse of their matrix
    (Olano and Greer 1997).
    """
    p = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    q = (c[1] * a[2] - c[2] * a[1], c[2] * a[0] - c[0] * a[2], c[0] * a[1] - c[1] * a[0])
    r = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    area = a[0] * p[0] + a[1] * p[1] + a[2] * p[2]
    s = 1.0 / area
    return area, (
        (p[0] * s, p[1] * s, p[2] * s),
        (q[0] * s, q[1] * s, q[2] * s),
        (r[0] * s, r[1] * s, r[2] * s),
    )


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _set_crossing(
    row: Float32, positions: Float32, lens: Float64, corners: tuple[int, int, int]
) -> float:
    """Planes of a triangle through the near plane; twice its area, 0 where it has none."""
    area, planes = crossing_planes(
        _homogeneous(positions[corners[0]], lens),
        _homogeneous(positions[corners[1]], lens),
        _homogeneous(positions[corners[2]], lens),
    )
    if area == 0.0:
        return 0.0
    for k in range(3):
        row[k], row[3 + k], row[6 + k] = planes[k][0], planes[k][1], planes[k][2]
    row[X0], row[Y0] = 0.0, 0.0
    return area


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _lines(low: float, high: float, lines: int) -> tuple[int, int]:
    """First and last line of samples whose row lies in [low, high)."""
    first = math.ceil(min(max((low - 0.125) * SAMPLES, 0.0), lines))
    last = math.ceil(min(max((high - 0.125) * SAMPLES, 0.0), lines)) - 1
    return int(first), int(last)


@njit(
    "i8(f8[:,::1],f4[:,::1],i4[:,::1],u1[::1],f8[::1],i8,i8,i4[:,::1],f4[:,::1],i4[::1])",
    cache=True, nogil=True, error_model="numpy", _nrt=False,
)  # fmt: skip
def set_up(
    points: Float64, positions: Float32, faces: Int32, sides: npt.NDArray[np.uint8],
    lens: Float64, width: int, lines: int, spans: Int32, planes: Float32, kept: Int32,
) -> int:  # fmt: skip
    """Find the triangles that are turned to the camera and touch the picture.

    Args:
        points: from `screen.project` (V, 3).
        positions: in the world (V, 3).
        faces: vertex indices (F, 3).
        sides: of each triangle (F,): bit 0 whether its back is drawn, bit 1 whether mirrored.
        lens: the camera's numbers.
        width: columns of the picture [px].
        lines: lines of samples, four a row of pixels.
        spans: filled in: first and last line of each kept triangle (F, 2).
        planes: filled in: plane numbers of each kept triangle (F, 12).
        kept: filled in: indices of the kept triangles, ascending (F,).

    Returns:
        How many are kept.
    """
    count = 0
    for t in range(len(faces)):
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        a = points[i, 0], points[i, 1], points[i, 2]
        b = points[j, 0], points[j, 1], points[j, 2]
        c = points[k, 0], points[k, 1], points[k, 2]
        mirrored = -1.0 if sides[t] & 2 else 1.0
        if min(a[2], b[2], c[2]) > 0.0:
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            facing = mirrored if area < 0.0 else -mirrored  # rows run downwards
            if area == 0.0 or (facing < 0.0 and not sides[t] & 1):
                continue
            if max(a[0], b[0], c[0]) < 0.0 or min(a[0], b[0], c[0]) > width:
                continue
            first, last = _lines(min(a[1], b[1], c[1]), max(a[1], b[1], c[1]), lines)
            if first > last:
                continue
            _corner_planes(planes[t], a, b, c, area, facing)
        else:
            if max(a[2], b[2], c[2]) == 0.0:
                continue
            area = _set_crossing(planes[t], positions, lens, (i, j, k))
            facing = mirrored if area < 0.0 else -mirrored
            if area == 0.0 or (facing < 0.0 and not sides[t] & 1):
                continue
            planes[t, FACING] = facing
            first, last = 0, lines - 1
        spans[t, 0], spans[t, 1] = first, last
        kept[count] = t
        count += 1
    return count


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _edge(p: Line, q: Line) -> Line:
    """The line through two points, going down; columns at a row."""
    return p[0], (q[0] - p[0]) / (q[1] - p[1]), p[1]


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _at(line: Line, y: float) -> float:
    """Its column at a row, exact to 2^-32: columns of samples are met exactly or not at all."""
    return (line[0] + line[1] * (y - line[2]) + _SNAP) - _SNAP


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _run(
    picture: Samples, t: int, line: int, run: tuple[int, int], slope: float, start: float
) -> None:
    """Draw columns `run` (first, one beyond the last) of a line; `start` is the first's."""
    at, count = line * picture[3] + run[0], run[1] - run[0]
    start, slope = np.float32(start), np.float32(slope)
    # Once in any case: whether a short run is empty no processor can foresee.
    draw_run(picture[0], picture[1], at, np.int32(count), start, slope, np.int32(t))
    for x in range(LANES, count, LANES):
        begun = start + slope * np.float32(x)
        rest = np.int32(count - x)
        draw_run(picture[0], picture[1], at + x, rest, begun, slope, np.int32(t))


@njit(forceinline=True, error_model="numpy", _nrt=False)
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


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _covered(sides: Sides, line: int, width: int) -> tuple[int, int]:
    """Columns of a line that a triangle covers: the first, and one beyond the last."""
    y = 0.25 * line + 0.125
    short = sides[1] if y < sides[3] else sides[2]
    one, other = _at(sides[0], y), _at(short, y)
    shift = SAMPLE_X[line & 3]
    left = math.ceil(max(min(one, other) - shift, 0.0))
    return left, math.ceil(min(max(one, other) - shift, float(width)))


@njit(forceinline=True, error_model="numpy", _nrt=False)
def _fill(a: Line, b: Line, c: Line, t: int, limits: tuple[int, int], picture: Samples) -> None:
    """A triangle before the camera, on lines `limits` (first, last)."""
    sides = _sides(a, b, c)
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    slope = ((b[2] - a[2]) * (c[1] - a[1]) - (c[2] - a[2]) * (b[1] - a[1])) / area
    down = ((c[2] - a[2]) * (b[0] - a[0]) - (b[2] - a[2]) * (c[0] - a[0])) / area
    for line in range(limits[0], limits[1] + 1):
        run = _covered(sides, line, picture[2])
        x, y = run[0] + SAMPLE_X[line & 3] - a[0], 0.25 * line + 0.125 - a[1]
        _run(picture, t, line, run, slope, a[2] + down * y + slope * x)


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _cut(
    run: tuple[float, float], slope: float, level: float
) -> tuple[float, float]:  # fmt: skip
    """The part of a run of columns [px] where slope * x + level >= 0."""
    if slope > 0.0:
        return max(run[0], -level / slope), run[1]
    if slope < 0.0:
        return run[0], min(run[1], -level / slope)
    return run if level >= 0.0 else (1.0, 0.0)


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
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


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _fill_crossing(
    planes: tuple[Line, Line, Line], highest: float, t: int, limits: tuple[int, int],
    picture: Samples,
) -> None:  # fmt: skip
    """A triangle through the near plane, of which disparities up to `highest` are drawn."""
    p, q, r = planes
    slope, down = p[0] + q[0] + r[0], p[1] + q[1] + r[1]
    for line in range(limits[0], limits[1] + 1):
        run = _covered_crossing(planes, highest, line, picture[2])
        x, y = run[0] + SAMPLE_X[line & 3], 0.25 * line + 0.125
        if run[0] < run[1]:
            _run(picture, t, line, run, slope, slope * x + down * y + p[2] + q[2] + r[2])


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def covered(shape: Shape, t: int, line: int, width: int) -> tuple[int, int]:
    """Columns of a line that a triangle covers: the first, and one beyond the last."""
    points, positions, faces, lens = shape
    i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
    a = points[i, 0], points[i, 1], points[i, 2]
    b = points[j, 0], points[j, 1], points[j, 2]
    c = points[k, 0], points[k, 1], points[k, 2]
    if min(a[2], b[2], c[2]) > 0.0:
        low, high = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        inside = low <= 0.25 * line + 0.125 < high
        return _covered(_sides(a, b, c), line, width) if inside else (0, 0)
    _, planes = crossing_planes(
        _homogeneous(positions[i], lens),
        _homogeneous(positions[j], lens),
        _homogeneous(positions[k], lens),
    )
    return _covered_crossing(planes, 1.0 / lens[16], line, width)


@njit(
    "void(i4[::1],i8,i8,f8[:,::1],f4[:,::1],i4[:,::1],f8[::1],i4[:,::1],i8,f4[:,::1],i4[:,::1])",
    cache=True, nogil=True, error_model="numpy", _nrt=False,
)  # fmt: skip
def fill(
    kept: Int32, first: int, last: int, points: Float64, positions: Float32, faces: Int32,
    lens: Float64, spans: Int32, width: int, disparity: Float32, ids: Int32,
) -> None:  # fmt: skip
    """Draw triangles on the lines [first, last]; of equal disparities the later one stays.

    Args:
        kept: triangles, in the order in which they are drawn.
        first: first line of samples.
        last: last line.
        points: from `screen.project` (V, 3).
        positions: in the world (V, 3).
        faces: vertex indices (F, 3).
        lens: the camera's numbers.
        spans: from `set_up` (F, 2).
        width: columns of the picture [px].
        disparity: changed: of each sample (4 h, width + PADDING), 0 where there is nothing
            [1 / scene unit].
        ids: changed: triangle of each sample (4 h, width + PADDING).
    """
    picture = disparity.reshape(-1), ids.reshape(-1), width, disparity.shape[1]
    for n in range(len(kept)):
        t = kept[n]
        limits = max(first, spans[t, 0]), min(last, spans[t, 1])
        if limits[0] > limits[1]:
            continue
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        a = points[i, 0], points[i, 1], points[i, 2]
        b = points[j, 0], points[j, 1], points[j, 2]
        c = points[k, 0], points[k, 1], points[k, 2]
        if min(a[2], b[2], c[2]) > 0.0:
            _fill(a, b, c, t, limits, picture)
        else:
            _, planes = crossing_planes(
                _homogeneous(positions[i], lens),
                _homogeneous(positions[j], lens),
                _homogeneous(positions[k], lens),
            )
            _fill_crossing(planes, 1.0 / lens[16], t, limits, picture)
