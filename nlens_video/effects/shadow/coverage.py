"""Rasterises triangles for soft shadows: coverage of the screen, eight projections at a time.

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

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float64
from nlens_video.kernels.scratch import scratch
from nlens_video.native import kernels

Int32 = npt.NDArray[np.int32]
Bits = npt.NDArray[np.uint8]

Mesh = tuple[Float64, Int32, Int32]
"""Vertices, triangles, edges."""
Projection = tuple[int, Float64, tuple[float, float]]
"""Number of its bit, 0 to `PROJECTIONS` - 1; matrix from the world to homogeneous positions (3, 4),
(column * w, row * w, w), before the camera where w > 0, in pixels of the bits [px]; where in each
pixel it is sampled, column and row, in [0, 1) [px]."""
PROJECTIONS = kernels.PROJECTIONS
"""Bits of a pixel."""
PER_PIXEL = kernels.PER_PIXEL
"""Subpixel positions [1 / px]."""


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


def mark_covered(bits: Bits, mesh: Mesh, projections: Sequence[Projection]) -> None:
    """Set a bit in each pixel that any triangle covers, for some projections at once.

    Args:
        bits: of the pixels (h, w); changed.
        mesh: world positions (V, 3), perhaps with further attributes; vertex indices of
            triangles (T, 3); their edges, from `edges_of`.
        projections: at most `PROJECTIONS`, each with a bit of its own.
    """
    vertices, faces, _ = mesh
    numbers, matrices, places = zip(*projections, strict=True)
    marks = np.left_shift(np.uint8(1), np.array(numbers, np.uint8))
    held = (
        scratch("places", (len(vertices), 2, PROJECTIONS), np.int32),
        scratch("signs", (len(faces) + 1, PROJECTIONS), np.int8),
    )
    kernels.mark_covered(bits, mesh, (marks, np.array(matrices), np.array(places)), held)


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
