"""Perspective-correct interpolation of vertex attributes, with exact screen-space derivatives.

Barycentric weights and their derivatives follow in closed form from the triangle's planes
(`triangles`), so no pixel quads are needed. Corners are read point by point, four numbers at a
time; all that needs no corners is vectorised over points.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import f32, fastmath_kernel, inlined, kernel
from nlens_video.kernels.simd import (
    Float4,
    lane,
    load4,
    splat,
)
from nlens_video.render.software import shading_block as at
from nlens_video.render.software.shading_block import Int32
from nlens_video.render.software.textures import Run
from nlens_video.render.software.triangles import FACING, PLANES, X0, Y0

MeshBuffers = tuple[Float32, Float32, Float32, Float32, Int32, Int32, Float32]
"""Positions (V, 3), normals (V, 4), the last number of any content, texture coordinates (V, 4),
colours (V, 4), faces (F, 3), each one's material (F,), planes (F, 16)."""
PinholeRows = Float32
"""Rows of `pinhole` (15,)."""
Corners = tuple[int, int, int]
Vector = tuple[float, float, float]
_U = np.uint64  # of an index: signed ones might count from the end, which prevents vectorising
_ZERO, _ONE, _TWO = (f32(v) for v in (0.0, 1.0, 2.0))
_LEAST = f32(1e-30)


@inlined
def _sum(numbers: Float4) -> float:
    """Of the first three."""
    found: float = lane(numbers, 0) + lane(numbers, 1) + lane(numbers, 2)
    return found


@inlined
def _of(values: Float32, corners: Corners, w: Float4) -> Float4:
    """The corners' rows of values (V, 4), weighted."""
    i, j, k = corners
    return (
        load4(values, 4 * i) * splat(lane(w, 0))
        + load4(values, 4 * j) * splat(lane(w, 1))
        + load4(values, 4 * k) * splat(lane(w, 2))
    )


@inlined
def _weights(planes: Float32, t: int, x: float, y: float) -> tuple[Float4, Float4, Float4, float]:
    """Weights of a triangle's corners at a position, their change by a column and row, depth."""
    start = t * PLANES
    a, b, c = load4(planes, start), load4(planes, start + 4), load4(planes, start + 8)
    dx, dy = x - planes[t, X0], y - planes[t, Y0]
    shares = a * splat(dx) + b * splat(dy) + c  # weights divided by depth; their sum, 1 / depth
    depth = _ONE / _sum(shares)
    every = splat(depth)
    w = shares * every
    return w, (a - w * splat(_sum(a))) * every, (b - w * splat(_sum(b))) * every, depth


@inlined
def _store(block: Float32, field: int, i: int, numbers: Float4) -> None:
    """Write four numbers to four fields of a point."""
    for k in range(4):
        block[field + k * at.WIDTH + i] = lane(numbers, k)


@kernel
def interpolate(block: Float32, whole: Int32, count: int, mesh: MeshBuffers) -> None:
    """Interpolate vertex attributes at the first `count` points of a block.

    That is depth, normals of any length, vertex colours as base colour, texture coordinates and
    their change, and which material it is.
    """
    _, normals, uv, colors, faces, material, planes = mesh
    for i in range(count):
        t = whole[at.TRIANGLE + i]
        w, across, down, depth = _weights(planes, t, block[at.X + i], block[at.Y + i])
        corners = faces[t, 0], faces[t, 1], faces[t, 2]
        whole[at.MATERIAL + i], block[at.DEPTH + i] = material[t], depth
        _store(block, at.COORDINATES, i, _of(uv, corners, w))
        _store(block, at.COORDINATES + 4 * at.WIDTH, i, _of(uv, corners, across))
        _store(block, at.COORDINATES + 8 * at.WIDTH, i, _of(uv, corners, down))
        n = _of(normals, corners, w) * splat(planes[t, FACING])
        block[at.NORMAL_X + i], block[at.NORMAL_Y + i] = lane(n, 0), lane(n, 1)
        block[at.NORMAL_Z + i] = lane(n, 2)
        base = _of(colors, corners, w) if len(colors) else splat(_ONE)
        _store(block, at.BASE_R, i, base)


@inlined
def _moved(positions: Float32, corners: Corners, w: Float4) -> Vector:
    """Weighted corners where the weights' sum is 0, in differences: worlds may lie far off."""
    i, j, k = corners
    u, v = lane(w, 1), lane(w, 2)
    return (
        u * (positions[j, 0] - positions[i, 0]) + v * (positions[k, 0] - positions[i, 0]),
        u * (positions[j, 1] - positions[i, 1]) + v * (positions[k, 1] - positions[i, 1]),
        u * (positions[j, 2] - positions[i, 2]) + v * (positions[k, 2] - positions[i, 2]),
    )


@inlined
def _frame(
    block: Float32, whole: Int32, i: int, mesh: MeshBuffers, scale: float
) -> tuple[Vector, Vector, Vector]:  # fmt: skip
    """Unit normal of point `i`, tangent and bitangent along what is in `U_ACROSS` to `V_DOWN`.

    The longer of the two has the length `scale`; both are 0 where the coordinates do not change.
    """
    positions, faces, planes = mesh[0], mesh[4], mesh[6]
    t = whole[at.TRIANGLE + i]
    _, across, down, _ = _weights(planes, t, block[at.X + i], block[at.Y + i])
    corners = faces[t, 0], faces[t, 1], faces[t, 2]
    x, y, z = block[at.NORMAL_X + i], block[at.NORMAL_Y + i], block[at.NORMAL_Z + i]
    unit = planes[t, FACING] / math.sqrt(max(x * x + y * y + z * z, _LEAST))
    n = x * unit, y * unit, z * unit
    px, py = _moved(positions, corners, across), _moved(positions, corners, down)
    ux, uy = (
        (block[at.U_ACROSS + i], block[at.V_ACROSS + i]),
        (block[at.U_DOWN + i], block[at.V_DOWN + i]),
    )
    fy = (py[1] * n[2] - py[2] * n[1], py[2] * n[0] - py[0] * n[2], py[0] * n[1] - py[1] * n[0])
    fx = (n[1] * px[2] - n[2] * px[1], n[2] * px[0] - n[0] * px[2], n[0] * px[1] - n[1] * px[0])
    tx, ty, tz = (
        fy[0] * ux[0] + fx[0] * uy[0], fy[1] * ux[0] + fx[1] * uy[0], fy[2] * ux[0] + fx[2] * uy[0]
    )  # fmt: skip
    # v grows downwards in the picture, the map's green upwards.
    sx, sy, sz = (
        -fy[0] * ux[1] - fx[0] * uy[1],
        -fy[1] * ux[1] - fx[1] * uy[1],
        -fy[2] * ux[1] - fx[2] * uy[1],
    )
    size = max(tx * tx + ty * ty + tz * tz, sx * sx + sy * sy + sz * sz)
    if not size > _ZERO:
        return n, (_ZERO, _ZERO, _ZERO), (_ZERO, _ZERO, _ZERO)
    # The frame's handedness follows the screen's: columns and rows turn about +-n.
    turn = py[0] * fx[0] + py[1] * fx[1] + py[2] * fx[2]
    scale /= math.sqrt(size)
    scale = -scale if turn < _ZERO else scale
    return n, (tx * scale, ty * scale, tz * scale), (sx * scale, sy * scale, sz * scale)


@kernel
def apply_normal_map(
    block: Float32, whole: Int32, run: Run, mesh: MeshBuffers, strength: float
) -> None:
    """Tilt the normals of a run by its normal map; their frame comes from derivatives."""
    for i in range(run[0], run[1]):
        n, s, t = _frame(block, whole, i, mesh, strength)
        a = block[at.TEXEL_R + i] * _TWO - _ONE
        b = block[at.TEXEL_G + i] * _TWO - _ONE
        c = block[at.TEXEL_B + i] * _TWO - _ONE
        if s == t:  # both are 0: there is no frame
            a, b, c = _ZERO, _ZERO, _ONE
        side = mesh[6][whole[at.TRIANGLE + i], FACING]
        block[at.NORMAL_X + i] = side * (s[0] * a + t[0] * b + n[0] * c)
        block[at.NORMAL_Y + i] = side * (s[1] * a + t[1] * b + n[1] * c)
        block[at.NORMAL_Z + i] = side * (s[2] * a + t[2] * b + n[2] * c)


@kernel
def find_directions(block: Float32, whole: Int32, run: Run, mesh: MeshBuffers) -> None:
    """Turn directions `ALONG` in the plane of texture coordinates, x and y, into the world's.

    They are 0 where the coordinates do not change. `BESIDE` lies across them on the surface.
    """
    for i in range(run[0], run[1]):
        n, s, t = _frame(block, whole, i, mesh, _ONE)
        x = block[at.ALONG + i] / math.sqrt(max(s[0] ** 2 + s[1] ** 2 + s[2] ** 2, _LEAST))
        y = block[at.ALONG + at.WIDTH + i]
        y /= math.sqrt(max(t[0] ** 2 + t[1] ** 2 + t[2] ** 2, _LEAST))
        ax, ay, az = s[0] * x + t[0] * y, s[1] * x + t[1] * y, s[2] * x + t[2] * y
        block[at.ALONG + i], block[at.ALONG + at.WIDTH + i] = ax, ay
        block[at.ALONG + 2 * at.WIDTH + i] = az
        block[at.BESIDE + i] = n[1] * az - n[2] * ay
        block[at.BESIDE + at.WIDTH + i] = n[2] * ax - n[0] * az
        block[at.BESIDE + 2 * at.WIDTH + i] = n[0] * ay - n[1] * ax


@fastmath_kernel
def view_vectors(block: Float32, lens: PinholeRows) -> None:
    """Unit normals, directions to the eye and distances."""
    for i in range(at.WIDTH):
        x, y, z = (
            block[_U(at.NORMAL_X + i)], block[_U(at.NORMAL_Y + i)], block[_U(at.NORMAL_Z + i)]
        )  # fmt: skip
        squared = x * x + y * y + z * z
        scale = _ONE / math.sqrt(squared if squared > _LEAST else _LEAST)
        block[_U(at.NORMAL_X + i)], block[_U(at.NORMAL_Y + i)] = x * scale, y * scale
        block[_U(at.NORMAL_Z + i)] = z * scale
    for i in range(at.WIDTH):
        right = (block[_U(at.X + i)] - lens[11]) / lens[9]
        up = (lens[12] - block[_U(at.Y + i)]) / lens[10]
        vx = lens[6] - right * lens[0] - up * lens[3]
        vy = lens[7] - right * lens[1] - up * lens[4]
        vz = lens[8] - right * lens[2] - up * lens[5]
        length = math.sqrt(vx * vx + vy * vy + vz * vz)
        scale = _ONE / length
        block[_U(at.VIEW_X + i)], block[_U(at.VIEW_Y + i)] = vx * scale, vy * scale
        block[_U(at.VIEW_Z + i)] = vz * scale
        block[_U(at.DISTANCE + i)] = block[_U(at.DEPTH + i)] * length
