"""What the surface is like at a point of the screen: the interpolated half of shading.

Weights of a triangle's corners and their change across the screen come in closed form from its
planes (`raster`), so derivatives are exact at each point and no quads are drawn.
"""

from __future__ import annotations

import math

from nlens_video.frames import Float32
from nlens_video.kernels import fragment as at
from nlens_video.kernels.compiled import inlined, kernel, single
from nlens_video.kernels.fragment import Int32
from nlens_video.kernels.texture import Rgba, Table, Texels, sample
from nlens_video.kernels.triangles import FACING, X0, Y0

Mesh = tuple[Float32, Float32, Float32, Float32, Int32, Int32, Float32]
"""Positions (V, 3), normals (V, 3), texture coordinates (V, 4), colours (V, 4), faces (F, 3), each
one's material (F,), planes (F, 12)."""
Paint = tuple[Float32, Int32, Int32, tuple[Texels, Table, Table]]
"""Numbers of the materials (M, 56), their textures (M, 5), -1 for none, flags (M,), the atlas."""
Pinhole = Float32
"""Rows of `pinhole` (15,)."""
Corners = tuple[int, int, int]
Weights = tuple[float, float, float]
Point = tuple[int, int, Corners]
"""Triangle, material, corners."""
Change = tuple[Weights, Weights, Weights]
"""Weights of the corners, and their change by a column and by a row."""

# Slots of a material's textures, and flags.
BASE_COLOR, METALLIC_ROUGHNESS, NORMAL, OCCLUSION, EMISSIVE = range(5)
UNLIT, OPAQUE = 1, 2
MATERIAL_NUMBERS = 56
_UV_ROWS = 16
_ZERO, _HALF, _ONE, _TWO = (single(v) for v in (0.0, 0.5, 1.0, 2.0))
_LEAST = single(1e-30)


@inlined
def _planes(planes: Float32, t: int, x: float, y: float) -> tuple[float, Weights, float]:
    """Weights of the corners at a position, divided by depth; their sum, each, 1 / sum."""
    dx, dy = x - planes[t, X0], y - planes[t, Y0]
    q0 = planes[t, 0] * dx + planes[t, 3] * dy + planes[t, 6]
    q1 = planes[t, 1] * dx + planes[t, 4] * dy + planes[t, 7]
    q2 = planes[t, 2] * dx + planes[t, 5] * dy + planes[t, 8]
    total = q0 + q1 + q2
    depth = _ONE / total
    return total, (q0 * depth, q1 * depth, q2 * depth), depth


@inlined
def _change(planes: Float32, t: int, row: int, w: Weights, depth: float) -> Weights:
    """Change of the weights by a column (row 0) or a row (row 3)."""
    a, b, c = planes[t, row], planes[t, row + 1], planes[t, row + 2]
    total = a + b + c
    return (a - w[0] * total) * depth, (b - w[1] * total) * depth, (c - w[2] * total) * depth


@inlined
def _of(values: Float32, corners: Corners, c: int, w: Weights) -> float:
    """Column `c` of the corners' values, weighted."""
    i, j, k = corners
    found: float = w[0] * values[i, c] + w[1] * values[j, c] + w[2] * values[k, c]
    return found


@inlined
def _mapped(
    mesh: Mesh, numbers: Float32, where: Point, slot: int, w: Weights, one: float
) -> tuple[float, float]:
    """Coordinates (`one` = 1), or a change of them (`one` = 0), in a texture's own picture."""
    _, m, corners = where
    row = _UV_ROWS + 8 * slot
    column = 0 if numbers[m, row + 3] < _HALF else 2
    u, v = _of(mesh[2], corners, column, w), _of(mesh[2], corners, column + 1, w)
    return (
        numbers[m, row] * u + numbers[m, row + 1] * v + numbers[m, row + 2] * one,
        numbers[m, row + 4] * u + numbers[m, row + 5] * v + numbers[m, row + 6] * one,
    )


@inlined
def _texel(mesh: Mesh, paint: Paint, where: Point, slot: int, change: Change) -> Rgba:
    numbers, maps, _, atlas = paint
    w, across, down = change
    return sample(
        atlas, maps[where[1], slot], _mapped(mesh, numbers, where, slot, w, _ONE),
        _mapped(mesh, numbers, where, slot, across, _ZERO),
        _mapped(mesh, numbers, where, slot, down, _ZERO),
    )  # fmt: skip


@inlined
def find(mesh: Mesh, t: int, x: float, y: float) -> tuple[Point, Change, float]:
    """A triangle's point at a position of the screen, its weights there, and its depth."""
    faces, material, planes = mesh[4], mesh[5], mesh[6]
    _, w, depth = _planes(planes, t, x, y)
    change = w, _change(planes, t, 0, w, depth), _change(planes, t, 3, w, depth)
    return (t, material[t], (faces[t, 0], faces[t, 1], faces[t, 2])), change, depth


@inlined
def base_color(mesh: Mesh, paint: Paint, where: Point, change: Change) -> Rgba:
    """Linear base colour and alpha at a point."""
    colors, (numbers, maps, _, _) = mesh[3], paint
    _, m, corners = where
    r, g, b, a = numbers[m, 0], numbers[m, 1], numbers[m, 2], numbers[m, 3]
    if len(colors):
        w = change[0]
        r, g = r * _of(colors, corners, 0, w), g * _of(colors, corners, 1, w)
        b, a = b * _of(colors, corners, 2, w), a * _of(colors, corners, 3, w)
    if maps[m, BASE_COLOR] >= 0:
        c = _texel(mesh, paint, where, BASE_COLOR, change)
        r, g, b, a = r * c[0], g * c[1], b * c[2], a * c[3]
    return r, g, b, a


@inlined
def _moved(positions: Float32, corners: Corners, w: Weights) -> Weights:
    """Weighted corners where the weights' sum is 0, in differences: worlds may lie far off."""
    i, j, k = corners
    return (
        w[1] * (positions[j, 0] - positions[i, 0]) + w[2] * (positions[k, 0] - positions[i, 0]),
        w[1] * (positions[j, 1] - positions[i, 1]) + w[2] * (positions[k, 1] - positions[i, 1]),
        w[1] * (positions[j, 2] - positions[i, 2]) + w[2] * (positions[k, 2] - positions[i, 2]),
    )


@inlined
def _bumped(mesh: Mesh, paint: Paint, where: Point, change: Change, n: Weights) -> Weights:
    """A normal tilted by the material's normal map; its frame comes from derivatives."""
    numbers, (_, m, corners) = paint[0], where
    px, py = _moved(mesh[0], corners, change[1]), _moved(mesh[0], corners, change[2])
    ux = _mapped(mesh, numbers, where, NORMAL, change[1], _ZERO)
    uy = _mapped(mesh, numbers, where, NORMAL, change[2], _ZERO)
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
        return n
    # The frame's handedness follows the screen's: columns and rows turn about +-n.
    turn = py[0] * fx[0] + py[1] * fx[1] + py[2] * fx[2]
    texel = _texel(mesh, paint, where, NORMAL, change)
    scale = numbers[m, _UV_ROWS + 8 * NORMAL + 7] / math.sqrt(size)
    scale = -scale if turn < _ZERO else scale
    i = (texel[0] * _TWO - _ONE) * scale
    j = (texel[1] * _TWO - _ONE) * scale
    k = texel[2] * _TWO - _ONE
    return tx * i + sx * j + n[0] * k, ty * i + sy * j + n[1] * k, tz * i + sz * j + n[2] * k


@inlined
def _unit(x: float, y: float, z: float) -> Weights:
    scale = _ONE / math.sqrt(max(x * x + y * y + z * z, _LEAST))
    return x * scale, y * scale, z * scale


@inlined
def _place(block: Float32, i: int, lens: Pinhole, x: float, y: float, depth: float) -> None:
    """Direction to the eye, and distance."""
    right, up = (x - lens[11]) / lens[9], (lens[12] - y) / lens[10]
    vx = lens[6] - right * lens[0] - up * lens[3]
    vy = lens[7] - right * lens[1] - up * lens[4]
    vz = lens[8] - right * lens[2] - up * lens[5]
    length = math.sqrt(vx * vx + vy * vy + vz * vz)
    block[at.VIEW_X + i], block[at.VIEW_Y + i] = vx / length, vy / length
    block[at.VIEW_Z + i], block[at.DISTANCE + i] = vz / length, depth * length


@inlined
def _reflectance(
    block: Float32, i: int, mesh: Mesh, paint: Paint, where: Point, change: Change
) -> None:
    numbers, maps, _, _ = paint
    m = where[1]
    metallic, roughness, occlusion = numbers[m, 4], numbers[m, 5], _ONE
    if maps[m, METALLIC_ROUGHNESS] >= 0:
        c = _texel(mesh, paint, where, METALLIC_ROUGHNESS, change)
        metallic, roughness = metallic * c[2], roughness * c[1]
    if maps[m, OCCLUSION] >= 0:
        strength = numbers[m, _UV_ROWS + 8 * OCCLUSION + 7]
        occlusion = _ONE + strength * (_texel(mesh, paint, where, OCCLUSION, change)[0] - _ONE)
    block[at.METALLIC + i] = min(max(metallic, _ZERO), _ONE)
    block[at.ROUGHNESS + i] = min(max(roughness, _ZERO), _ONE)
    block[at.OCCLUSION + i], block[at.SPECULAR + i] = occlusion, numbers[m, 6]
    block[at.F0_R + i], block[at.F0_G + i] = numbers[m, 12], numbers[m, 13]
    block[at.F0_B + i] = numbers[m, 14]
    r, g, b = numbers[m, 8], numbers[m, 9], numbers[m, 10]
    if maps[m, EMISSIVE] >= 0:
        c = _texel(mesh, paint, where, EMISSIVE, change)
        r, g, b = r * c[0], g * c[1], b * c[2]
    block[at.RED + i], block[at.GREEN + i], block[at.BLUE + i] = r, g, b


@inlined
def _emit(block: Float32, i: int, base: Rgba) -> None:
    """An unlit point: its base colour is its radiance, and it reflects nothing."""
    block[at.RED + i], block[at.GREEN + i], block[at.BLUE + i] = base[0], base[1], base[2]
    block[at.BASE_R + i] = block[at.BASE_G + i] = block[at.BASE_B + i] = _ZERO
    block[at.F0_R + i] = block[at.F0_G + i] = block[at.F0_B + i] = _ZERO
    block[at.SPECULAR + i] = block[at.METALLIC + i] = _ZERO


@kernel
def lay_out(
    block: Float32, whole: Int32, count: int, mesh: Mesh, paint: Paint, lens: Pinhole
) -> None:  # fmt: skip
    """Fill in what the surface is like at the first `count` points of a block."""
    normals, planes = mesh[1], mesh[6]
    for i in range(count):
        t = whole[at.TRIANGLE + i]
        x, y = block[at.X + i], block[at.Y + i]
        where, change, depth = find(mesh, t, x, y)
        _, m, corners = where
        base, w = base_color(mesh, paint, where, change), change[0]
        block[at.ALPHA + i] = _ONE if paint[2][m] & OPAQUE else min(max(base[3], _ZERO), _ONE)
        if paint[2][m] & UNLIT:
            _emit(block, i, base)
            continue
        block[at.BASE_R + i], block[at.BASE_G + i] = base[0], base[1]
        block[at.BASE_B + i] = base[2]
        n = _unit(
            _of(normals, corners, 0, w), _of(normals, corners, 1, w), _of(normals, corners, 2, w)
        )
        if paint[1][m, NORMAL] >= 0:
            bumped = _bumped(mesh, paint, where, change, n)
            n = _unit(bumped[0], bumped[1], bumped[2])
        side = planes[t, FACING]
        block[at.NORMAL_X + i] = side * n[0]
        block[at.NORMAL_Y + i] = side * n[1]
        block[at.NORMAL_Z + i] = side * n[2]
        _place(block, i, lens, x, y, depth)
        _reflectance(block, i, mesh, paint, where, change)
