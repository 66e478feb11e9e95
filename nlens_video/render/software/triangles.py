"""Triangle set-up: culling, and the plane equations of the barycentric weights.

Barycentric weights divided by depth are affine across the screen: three planes, from which all
attributes are interpolated; their sum is disparity.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.numba_config import inlined, kernel, to_f32
from nlens_video.native import kernels
from nlens_video.scene.screen_projection import in_camera

Int32 = npt.NDArray[np.int32]
Triple = tuple[float, float, float]
Shape = tuple[Float64, Float32, Int32, Float64]
"""Points (V, 3) from `screen_projection.project`, positions (V, 3), faces (F, 3), camera
parameters."""

SAMPLES = 4
"""Samples of a pixel, each on a line of its own."""
# Numbers of a triangle's planes, in rows of four: q_k = a_k (x - x0) + b_k (y - y0) + c_k.
PLANES = 16
A, B, C = 0, 4, 8
X0, Y0, FACING = 12, 13, 14


@inlined
def homogeneous(position: Float32, lens: Float64) -> Triple:
    """A world position as (column * depth, row * depth, depth)."""
    right, up, depth = in_camera(position, lens)
    return lens[12] * right + lens[14] * depth, lens[15] * depth - lens[13] * up, depth


@inlined
def on_screen(shape: Shape, t: int) -> tuple[Triple, Triple, Triple]:
    """A triangle's corners (column, row, disparity); disparity 0 behind the near plane."""
    points, faces = shape[0], shape[2]
    i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
    return (
        (points[i, 0], points[i, 1], points[i, 2]),
        (points[j, 0], points[j, 1], points[j, 2]),
        (points[k, 0], points[k, 1], points[k, 2]),
    )


@inlined
def crossing(shape: Shape, t: int) -> tuple[float, tuple[Triple, Triple, Triple]]:
    """`_crossing_planes` of a triangle in the world."""
    _, positions, faces, lens = shape
    return _crossing_planes(
        homogeneous(positions[faces[t, 0]], lens),
        homogeneous(positions[faces[t, 1]], lens),
        homogeneous(positions[faces[t, 2]], lens),
    )


@kernel
def _crossing_planes(
    a: Triple, b: Triple, c: Triple
) -> tuple[float, tuple[Triple, Triple, Triple]]:  # fmt: skip
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


def set_up(
    shape: Shape, sides: npt.NDArray[np.uint8], width: int, lines: int,
    spans: Int32, planes: Float32, kept: Int32,
) -> int:  # fmt: skip
    """Find the triangles that are turned to the camera and touch the picture.

    Args:
        shape: the triangles on the screen.
        sides: of each triangle (F,): bit 0 whether its back is drawn, bit 1 whether mirrored.
        width: columns of the picture [px].
        lines: lines of samples, four a row of pixels.
        spans: filled in: first and last line of each kept triangle (F, 2).
        planes: filled in: plane numbers of each kept triangle (F, 16).
        kept: filled in: indices of the kept triangles, ascending (F,).

    Returns:
        How many are kept.
    """
    return kernels.set_up_triangles(shape, sides, width, lines, spans, planes, kept)


@inlined
def disparity_plane(planes: Float32, t: int) -> tuple[float, float, float, float, float]:
    """Disparity of a triangle as a plane: change by a column and a row; where, and how much."""
    across: float = planes[t, A] + planes[t, A + 1] + planes[t, A + 2]
    down: float = planes[t, B] + planes[t, B + 1] + planes[t, B + 2]
    start: float = planes[t, C] + planes[t, C + 1] + planes[t, C + 2]
    return across, down, planes[t, X0], planes[t, Y0], start


@inlined
def on_plane(plane: tuple[float, float, float, float, float], x: float, y: float) -> float:
    """Disparity at a position on the screen."""
    across, down, x0, y0, start = plane
    return across * (to_f32(x) - x0) + down * (to_f32(y) - y0) + start


@inlined
def disparity_at(planes: Float32, t: int, x: float, y: float) -> float:
    """Disparity of a triangle at a position on the screen."""
    return on_plane(disparity_plane(planes, t), x, y)
