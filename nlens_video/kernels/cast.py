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
    _count(counts[0], counts[1], points, faces, np.int32(call), at[0], at[1])


@njit("void(i4[:,::1],i4[:,::1],f8[:,::1],i4[:,::1],i4,f8,f8)", cache=True, nogil=True)
def _count(count, last, points, faces, call, at_x, at_y):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, C901
    height, width = count.shape
    edge = np.empty((3, 3), np.float64)
    for t in range(faces.shape[0]):
        a, b, c = points[faces[t, 0]], points[faces[t, 1]], points[faces[t, 2]]
        if a[2] <= 0.0 and b[2] <= 0.0 and c[2] <= 0.0:
            continue
        x0, y0, x1, y1 = 0, 0, width - 1, height - 1
        if a[2] > 0.0 and b[2] > 0.0 and c[2] > 0.0:
            ax, bx, cx = a[0] / a[2], b[0] / b[2], c[0] / c[2]
            ay, by, cy = a[1] / a[2], b[1] / b[2], c[1] / c[2]
            low_x, high_x = min(ax, bx, cx) - at_x, max(ax, bx, cx) - at_x
            low_y, high_y = min(ay, by, cy) - at_y, max(ay, by, cy) - at_y
            if high_x < 0.0 or high_y < 0.0 or low_x > width - 1 or low_y > height - 1:
                continue
            x0, y0 = max(0, int(np.ceil(low_x))), max(0, int(np.ceil(low_y)))
            x1 = min(width - 1, int(np.floor(high_x)))
            y1 = min(height - 1, int(np.floor(high_y)))
            if x0 > x1 or y0 > y1:
                continue
        for k in range(3):  # rows of the adjugate: zero on an edge
            p, q = (b, c) if k == 0 else ((c, a) if k == 1 else (a, b))
            edge[k, 0] = p[1] * q[2] - p[2] * q[1]
            edge[k, 1] = p[2] * q[0] - p[0] * q[2]
            edge[k, 2] = p[0] * q[1] - p[1] * q[0]
        turn = edge[0, 0] * a[0] + edge[0, 1] * a[1] + edge[0, 2] * a[2]
        if turn == 0.0:
            continue
        if turn < 0.0:
            edge[:] = -edge
        for y in range(y0, y1 + 1):
            py = y + at_y
            for x in range(x0, x1 + 1):
                if last[y, x] == call:
                    continue
                px = x + at_x
                if (
                    edge[0, 0] * px + edge[0, 1] * py + edge[0, 2] >= 0.0
                    and edge[1, 0] * px + edge[1, 1] * py + edge[1, 2] >= 0.0
                    and edge[2, 0] * px + edge[2, 1] * py + edge[2, 2] >= 0.0
                ):
                    last[y, x] = call
                    count[y, x] += 1
