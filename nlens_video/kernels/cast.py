"""Where triangles fall on the screen, one projection after another: counts for soft shadows.

Triangles come in homogeneous pixel positions, so that one which reaches behind the camera is filled
as far as it lies before it, without being cut (Olano and Greer 1997, Triangle Scan Conversion Using
2D Homogeneous Coordinates). Pixels are sampled at one point, which each call may place elsewhere:
many calls antialias as they soften.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.frames import Float64

Int32 = npt.NDArray[np.int32]


def new_counts(height: int, width: int) -> Int32:
    """Counts for `count_covered` (2, height, width): how often covered, and by which call last."""
    return np.zeros((2, height, width), np.int32)


def count_covered(
    counts: Int32, points: Float64, faces: Int32, call: int, at: tuple[float, float]
) -> None:
    """Add 1 to each pixel that any triangle covers.

    Args:
        counts: from `new_counts`; changed.
        points: homogeneous positions (V, 3), (column * w, row * w, w), before the camera where
            w > 0, in pixels of `counts` [px].
        faces: vertex indices of triangles (T, 3).
        call: number of this call on `counts`, from 1 on; each its own.
        at: where in each pixel it is sampled, column and row, in [0, 1) [px].
    """
    _count(counts, points, faces, call, at)


Extent = tuple[int, int, int, int]
"""First column and row of pixels, and the last ones."""


@njit(cache=True, nogil=True)
def _extent(
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


@njit(cache=True, nogil=True)
def _edges(a: Float64, b: Float64, c: Float64, edge: Float64) -> bool:
    """Fill in the edge functions (3, 3), >= 0 inside; False for a triangle without area."""
    for k in range(3):  # rows of the adjugate: zero on an edge
        p, q = (b, c) if k == 0 else ((c, a) if k == 1 else (a, b))
        edge[k, 0] = p[1] * q[2] - p[2] * q[1]
        edge[k, 1] = p[2] * q[0] - p[0] * q[2]
        edge[k, 2] = p[0] * q[1] - p[1] * q[0]
    turn = edge[0, 0] * a[0] + edge[0, 1] * a[1] + edge[0, 2] * a[2]
    if turn < 0.0:
        edge[:] = -edge
    return bool(turn != 0.0)


@njit(cache=True, nogil=True)
def _fill(counts: Int32, edge: Float64, inside: Extent, call: int, at: tuple[float, float]) -> None:
    """Count the pixels within the edges, those of the same call once."""
    for y in range(inside[1], inside[3] + 1):
        py = y + at[1]
        for x in range(inside[0], inside[2] + 1):
            if counts[1, y, x] == call:
                continue
            px = x + at[0]
            if (
                edge[0, 0] * px + edge[0, 1] * py + edge[0, 2] >= 0.0
                and edge[1, 0] * px + edge[1, 1] * py + edge[1, 2] >= 0.0
                and edge[2, 0] * px + edge[2, 1] * py + edge[2, 2] >= 0.0
            ):
                counts[1, y, x] = call
                counts[0, y, x] += 1


@njit("void(i4[:,:,::1],f8[:,::1],i4[:,::1],i4,UniTuple(f8,2))", cache=True, nogil=True)
def _count(
    counts: Int32, points: Float64, faces: Int32, call: int, at: tuple[float, float]
) -> None:
    size = counts.shape[1], counts.shape[2]
    edge = np.empty((3, 3), np.float64)
    for t in range(faces.shape[0]):
        a, b, c = points[faces[t, 0]], points[faces[t, 1]], points[faces[t, 2]]
        inside = _extent(a, b, c, size, at)
        if inside[0] <= inside[2] and inside[1] <= inside[3] and _edges(a, b, c, edge):
            _fill(counts, edge, inside, call, at)
