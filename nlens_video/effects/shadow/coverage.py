"""Rasterises triangles for soft shadows: coverage of the screen, one projection after another.

Each projection has a bit of its own in every pixel, so what it covers twice counts once, and the
number of bits set is the number of blocked light samples. Pixels are sampled at one point, which
differs between projections: many of them antialias as they soften.

The number of triangles over a pixel is the sum of the edges to the left of it, those that go up
less those that go down, with all triangles wound alike. An edge between two triangles that are
wound alike cancels: of a mesh, little more than its outline is drawn. Positions are rounded to
1/256 px, and integers after that, so the sum is exact.

A triangle that reaches behind the camera is filled as far as it lies before it, without clipping
(Olano and Greer 1997, Triangle Scan Conversion Using 2D Homogeneous Coordinates).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float64
from nlens_video.kernels.numba_config import inlined, kernel, kernel_of
from nlens_video.kernels.thread_pool import scratch

Int32 = npt.NDArray[np.int32]
Bits = npt.NDArray[np.uint8]
Signs = npt.NDArray[np.int8]

Mesh = tuple[Float64, Int32, Int32]
"""Vertices, triangles, edges."""
Extent = tuple[int, int, int, int]
"""First column and row of pixels, and the last ones."""
_Held = tuple[Int32, Signs, Int32, Int32, Float64]
PROJECTIONS = 8  # of an array of bits
PER_PIXEL = 256  # subpixel positions [1 / px]
_FARTHEST_PX = 2.0**15  # from the first pixel: beyond that products are not exact


def edges_of(faces: Int32) -> Int32:
    """Edges of triangles (T, 3), each with the two triangles that share it.

    Returns:
        First and second vertex, the triangle with the edge in this direction and the one with its
        opposite, -1 where there is none (E, 4).
    """
    count = len(faces)
    start, end = faces.ravel(order="F"), np.roll(faces, -1, axis=1).ravel(order="F")
    triangle = np.tile(np.arange(count, dtype=np.int32), 3)
    low, high, forward = np.minimum(start, end), np.maximum(start, end), start < end
    order = np.lexsort((~forward, high, low))
    low, high, forward, triangle = low[order], high[order], forward[order], triangle[order]
    # pairs are neighbours in this order with opposite directions; more than two share no edge
    alike = (low[1:] == low[:-1]) & (high[1:] == high[:-1])
    pair = np.flatnonzero(alike & forward[:-1] & ~forward[1:])
    alone = np.ones(3 * count, bool)
    alone[pair] = alone[pair + 1] = False
    none = np.full(3 * count, -1, np.int32)
    both = np.stack([low[pair], high[pair], triangle[pair], triangle[pair + 1]], axis=1)
    single = np.stack(
        [np.where(forward, low, high), np.where(forward, high, low), triangle, none], axis=1
    )[alone]
    return np.ascontiguousarray(np.concatenate([both, single]), dtype=np.int32)


def mark_covered(
    bits: Bits, number: int, mesh: Mesh, matrix: Float64, at: tuple[float, float]
) -> None:
    """Set a bit in each pixel that any triangle covers.

    Args:
        bits: of the pixels (h, w); changed.
        number: which bit, 0 to `PROJECTIONS` - 1.
        mesh: world positions (V, 3), perhaps with further attributes; vertex indices of
            triangles (T, 3); their edges, from `edges_of`.
        matrix: from the world to homogeneous positions (3, 4), (column * w, row * w, w), before the
            camera where w > 0, in pixels of `bits` [px].
        at: where in each pixel it is sampled, column and row, in [0, 1) [px].
    """
    height, width = bits.shape
    held = (
        scratch("places", (len(mesh[0]), 3), np.int32), scratch("signs", (len(mesh[1]),), np.int8),
        scratch("layers", (height, width + 1), np.int32), scratch("reach", (height, 2), np.int32),
        np.empty((6, 3)),
    )  # fmt: skip
    _mark(bits, number, mesh, matrix, at, held)


@kernel
def extent(
    a: Float64, b: Float64, c: Float64, size: tuple[int, int], at: tuple[float, float]
) -> Extent:
    """The pixels that a triangle may cover: all of them where it reaches behind the camera."""
    height, width = size
    if a[2] <= 0.0 and b[2] <= 0.0 and c[2] <= 0.0:
        return 0, 0, -1, -1
    if a[2] <= 0.0 or b[2] <= 0.0 or c[2] <= 0.0:
        return 0, 0, width - 1, height - 1
    ax, bx, cx = a[0] / a[2], b[0] / b[2], c[0] / c[2]
    ay, by, cy = a[1] / a[2], b[1] / b[2], c[1] / c[2]
    low_x, high_x = min(ax, bx, cx) - at[0], max(ax, bx, cx) - at[0]
    low_y, high_y = min(ay, by, cy) - at[1], max(ay, by, cy) - at[1]
    if high_x < 0.0 or high_y < 0.0 or low_x > width - 1 or low_y > height - 1:
        return 0, 0, -1, -1
    return (
        max(0, int(np.ceil(low_x))), max(0, int(np.ceil(low_y))),
        min(width - 1, int(np.floor(high_x))), min(height - 1, int(np.floor(high_y))),
    )  # fmt: skip


@kernel
def edge_functions(a: Float64, b: Float64, c: Float64, edge: Float64) -> bool:
    """Fill in the edge functions (3, 3), >= 0 inside; False for a triangle without area."""
    for k in range(3):  # rows of the adjugate: zero on an edge
        p, q = (b, c) if k == 0 else ((c, a) if k == 1 else (a, b))
        edge[k, 0] = p[1] * q[2] - p[2] * q[1]
        edge[k, 1] = p[2] * q[0] - p[0] * q[2]
        edge[k, 2] = p[0] * q[1] - p[1] * q[0]
    turn = edge[0, 0] * a[0] + edge[0, 1] * a[1] + edge[0, 2] * a[2]
    if turn < 0.0:
        for k in range(3):
            for i in range(3):
                edge[k, i] = -edge[k, i]
    return bool(turn != 0.0)


@inlined
def _project(matrix: Float64, vertex: Float64, out: Float64) -> None:
    """A vertex's homogeneous position."""
    for row in range(3):
        out[row] = (
            matrix[row, 0] * vertex[0] + matrix[row, 1] * vertex[1] + matrix[row, 2] * vertex[2]
        ) + matrix[row, 3]


@inlined
def _place(mesh: Mesh, matrix: Float64, at: tuple[float, float], held: _Held) -> None:
    """Project vertices, and tell which lie before the camera; clears the buffer of layers there."""
    places, layers, point = held[0], held[2], held[4][0]
    left, top, right, bottom = layers.shape[1] - 1, layers.shape[0], 0, -1
    for v in range(mesh[0].shape[0]):
        _project(matrix, mesh[0][v], point)
        places[v, 2] = 0
        if point[2] > 0.0:
            x, y = point[0] / point[2] - at[0], point[1] / point[2] - at[1]
            if abs(x) < _FARTHEST_PX and abs(y) < _FARTHEST_PX:
                places[v, 0] = np.int32(np.floor(x * PER_PIXEL + 0.5))
                places[v, 1] = np.int32(np.floor(y * PER_PIXEL + 0.5))
                places[v, 2] = 1
                left, right = min(left, int(x)), max(right, int(x) + 1)
                top, bottom = min(top, int(y)), max(bottom, int(y))
    left, right = max(left, 0), min(right, layers.shape[1] - 1)
    for y in range(max(top, 0), min(bottom + 1, layers.shape[0])):
        for x in range(left, right + 1):
            layers[y, x] = 0


@inlined
def _turn(faces: Int32, places: Int32, signs: Signs) -> int:
    """Winding of triangles, 0 without area; returns how many reach behind the camera."""
    crossing = 0
    for t in range(faces.shape[0]):
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        signs[t] = 0
        if places[i, 2] & places[j, 2] & places[k, 2]:
            turn = (places[j, 0] - places[i, 0]) * (places[k, 1] - places[i, 1]) - (
                places[j, 1] - places[i, 1]
            ) * (places[k, 0] - places[i, 0])
            signs[t] = np.int8(turn > 0) - np.int8(turn < 0)
        else:
            crossing += 1
    return crossing


@inlined
def _draw(places: Int32, i: int, j: int, weight: int, layers: Int32, reach: Int32) -> None:
    """Add an edge where it crosses rows of samples."""
    if places[i, 1] > places[j, 1]:
        i, j, weight = j, i, -weight
    x, y = places[i, 0], places[i, 1]
    across, down = places[j, 0] - x, places[j, 1] - y
    top, beyond = -(-y // PER_PIXEL), -(-places[j, 1] // PER_PIXEL)
    width = layers.shape[1] - 1
    for row in range(max(0, top), min(layers.shape[0], beyond)):
        # the quotient of integers as small as these is never rounded up to an integer
        place = float(x * down + across * (row * PER_PIXEL - y)) / float(down * PER_PIXEL)
        column = int(min(max(np.ceil(place), 0.0), float(width)))
        layers[row, column] -= weight
        reach[row, 0] = min(reach[row, 0], column)
        reach[row, 1] = max(reach[row, 1], column)


@inlined
def _sum(bits: Bits, bit: int, layers: Int32, reach: Int32) -> None:
    """Mark pixels with at least one layer."""
    for y in range(bits.shape[0]):
        count = 0
        for x in range(reach[y, 0], reach[y, 1]):
            count += layers[y, x]
            if count > 0:
                bits[y, x] |= bit


@inlined
def _fill_crossing(
    bits: Bits, bit: int, corners: tuple[Float64, Float64, Float64], edge: Float64,
    at: tuple[float, float],
) -> None:  # fmt: skip
    """Mark the coverage of a triangle as far as it lies before the camera."""
    inside = extent(corners[0], corners[1], corners[2], bits.shape, at)
    if inside[0] > inside[2] or not edge_functions(corners[0], corners[1], corners[2], edge):
        return
    for y in range(inside[1], inside[3] + 1):
        py = y + at[1]
        for x in range(inside[0], inside[2] + 1):
            px = x + at[0]
            if (
                edge[0, 0] * px + edge[0, 1] * py + edge[0, 2] >= 0.0
                and edge[1, 0] * px + edge[1, 1] * py + edge[1, 2] >= 0.0
                and edge[2, 0] * px + edge[2, 1] * py + edge[2, 2] >= 0.0
            ):
                bits[y, x] |= bit


@kernel_of(
    "void(u1[:,::1],i8,Tuple((f8[:,::1],i4[:,::1],i4[:,::1])),f8[:,::1],UniTuple(f8,2),"
    "Tuple((i4[:,::1],i1[::1],i4[:,::1],i4[:,::1],f8[:,::1])))"
)
def _mark(
    bits: Bits, number: int, mesh: Mesh, matrix: Float64, at: tuple[float, float], held: _Held
) -> None:  # fmt: skip
    """`mark_covered`, with its buffers."""
    vertices, faces, edges = mesh
    bit = 1 << number
    places, signs, layers, reach, room = held
    _place(mesh, matrix, at, held)
    crossing = _turn(faces, places, signs)
    for y in range(reach.shape[0]):
        reach[y, 0], reach[y, 1] = layers.shape[1], -1
    for e in range(edges.shape[0]):
        weight = signs[edges[e, 2]]
        if edges[e, 3] >= 0:
            weight -= signs[edges[e, 3]]
        if weight != 0:
            _draw(places, edges[e, 0], edges[e, 1], weight, layers, reach)
    _sum(bits, bit, layers, reach)
    if crossing == 0:
        return
    for t in range(faces.shape[0]):
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        if not places[i, 2] & places[j, 2] & places[k, 2]:
            for corner, vertex in enumerate((i, j, k)):
                _project(matrix, vertices[vertex], room[corner])
            _fill_crossing(bits, bit, (room[0], room[1], room[2]), room[3:], at)


def covered_reference(
    size: tuple[int, int], points: Float64, faces: Int32, at: tuple[float, float]
) -> Bool:
    """NumPy reference of `mark_covered` (h, w), for homogeneous positions (V, 3).

    A pixel (x, y, 1) is covered where it is a sum of the corners with weights >= 0.
    """
    rows, columns = np.indices(size)
    pixels = np.stack([columns + at[0], rows + at[1], np.ones(size)], axis=-1).reshape(-1, 3)
    out = np.zeros(size[0] * size[1], bool)
    for corners in points[faces]:
        if np.linalg.det(corners) != 0.0:
            out |= (np.linalg.solve(corners.T, pixels.T) >= 0.0).all(axis=0)
    return out.reshape(size)
