"""Material evaluation: base colour, alpha, normal, reflectance and emission at surface points.

Vectorised over runs of points of one material.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import f32, fastmath_kernel, inlined, kernel
from nlens_video.render.software import shading_block as at
from nlens_video.render.software.interpolation import (
    MeshBuffers,
    PinholeRows,
    apply_normal_map,
    find_directions,
    interpolate,
    view_vectors,
)
from nlens_video.render.software.shading_block import Int32
from nlens_video.render.software.textures import Run, Table, Texels, sample_texture

MaterialBuffers = tuple[Float32, Int32, Int32, tuple[Texels, Table, Table]]
"""Numbers of the materials (M, `MATERIAL_FLOATS`), their textures (M, slots), -1 for none, flags
(M,), the atlas."""

# Slots of a material's textures, and flags.
BASE_COLOR, METALLIC_ROUGHNESS, NORMAL, OCCLUSION, EMISSIVE, SPECULAR, SPECULAR_COLOR = range(7)
CLEARCOAT, CLEARCOAT_ROUGHNESS, CLEARCOAT_NORMAL = 7, 8, 9
SHEEN_COLOR, SHEEN_ROUGHNESS, ANISOTROPY, TRANSMISSION, THICKNESS = 10, 11, 12, 13, 14
UNLIT, OPAQUE, LAYERED, CUT = 1, 2, 4, 8
_LAYERS, _SHEEN, _VOLUME, _UV_ROWS = 16, 20, 24, 28
BENDING = _VOLUME + 3
_CUTOFF = 7
_U = np.uint64  # of an index: signed ones might count from the end, which prevents vectorising
_ZERO, _HALF, _ONE = (f32(v) for v in (0.0, 0.5, 1.0))
_LEAST = f32(1e-12)


@inlined
def same_material(whole: Int32, first: int, count: int) -> Run:
    """The run of points from `first` on that are of one material."""
    last = first + 1
    while last < count and whole[at.MATERIAL + last] == whole[at.MATERIAL + first]:
        last += 1
    return first, last


@fastmath_kernel
def _map(block: Float32, run: Run, use: Float32) -> None:
    """Coordinates in a texture's own picture; `use` is (a, b, c, uv set, d, e, f, strength)."""
    pair = at.COORDINATES if use[3] < _HALF else at.COORDINATES + 2 * at.WIDTH
    a, b, c, d, e, f = use[0], use[1], use[2], use[4], use[5], use[6]
    for k in range(3):
        left, up = (c, f) if k == 0 else (_ZERO, _ZERO)
        source, target = pair + 4 * k * at.WIDTH, at.U + 2 * k * at.WIDTH
        for i in range(run[0], run[1]):
            u, v = block[_U(source + i)], block[_U(source + at.WIDTH + i)]
            block[_U(target + i)] = a * u + b * v + left
            block[_U(target + at.WIDTH + i)] = d * u + e * v + up


@kernel
def _sampled(
    block: Float32, whole: Int32, run: Run, paint: MaterialBuffers, m: int, slot: int
) -> bool:  # fmt: skip
    """Fill in the texels of a material's texture; whether it has one."""
    numbers, maps, _, atlas = paint
    if maps[m, slot] < 0:
        return False
    first = _UV_ROWS + 8 * slot
    _map(block, run, numbers[m, first : first + 8])
    sample_texture(block, whole, run, atlas, maps[m, slot])
    return True


@fastmath_kernel
def _times(block: Float32, run: Run, field: int, other: int, factor: float) -> None:
    """Multiply a field by a number and another one."""
    for i in range(run[0], run[1]):
        block[_U(field + i)] *= factor * block[_U(other + i)]


@fastmath_kernel
def _set(block: Float32, run: Run, field: int, value: float) -> None:
    for i in range(run[0], run[1]):
        block[_U(field + i)] = value


@kernel
def base_colors(block: Float32, whole: Int32, run: Run, paint: MaterialBuffers) -> None:
    """Make vertex colours of a run the linear base colours and alphas, which is not clipped."""
    m = whole[at.MATERIAL + run[0]]
    found = _sampled(block, whole, run, paint, m, BASE_COLOR)
    for k in range(4):
        field, factor = at.BASE_R + k * at.WIDTH, paint[0][m, k]
        if found:
            _times(block, run, field, at.TEXEL_R + k * at.WIDTH, factor)
        else:
            for i in range(run[0], run[1]):
                block[field + i] *= factor


@fastmath_kernel
def _clip(block: Float32, run: Run, field: int) -> None:
    """Keep a field within [0, 1]."""
    for i in range(run[0], run[1]):
        value = block[_U(field + i)]
        value = value if value > _ZERO else _ZERO
        block[_U(field + i)] = value if value < _ONE else _ONE


@kernel
def _reflectance(block: Float32, whole: Int32, run: Run, paint: MaterialBuffers) -> None:
    """Fill in how a run of points reflects and glows."""
    numbers, maps, _, _ = paint
    m = whole[at.MATERIAL + run[0]]
    _set(block, run, at.METALLIC, numbers[m, 4])
    _set(block, run, at.ROUGHNESS, numbers[m, 5])
    _set(block, run, at.SPECULAR, numbers[m, 6])
    _set(block, run, at.OCCLUSION, _ONE)
    for k in range(3):
        _set(block, run, at.RED + k * at.WIDTH, numbers[m, 8 + k])
        _set(block, run, at.F0_R + k * at.WIDTH, numbers[m, 12 + k])
    if _sampled(block, whole, run, paint, m, METALLIC_ROUGHNESS):
        _times(block, run, at.METALLIC, at.TEXEL_B, _ONE)
        _times(block, run, at.ROUGHNESS, at.TEXEL_G, _ONE)
    if _sampled(block, whole, run, paint, m, OCCLUSION):
        strength = numbers[m, _UV_ROWS + 8 * OCCLUSION + 7]
        for i in range(run[0], run[1]):
            block[at.OCCLUSION + i] = _ONE + strength * (block[at.TEXEL_R + i] - _ONE)
    if _sampled(block, whole, run, paint, m, EMISSIVE):
        for k in range(3):
            _times(block, run, at.RED + k * at.WIDTH, at.TEXEL_R + k * at.WIDTH, _ONE)
    _clip(block, run, at.METALLIC)
    _clip(block, run, at.ROUGHNESS)
    if maps[m, SPECULAR] >= 0 or maps[m, SPECULAR_COLOR] >= 0:
        _texture_specular(block, whole, run, paint, m)


@kernel
def _texture_specular(
    block: Float32, whole: Int32, run: Run, paint: MaterialBuffers, m: int
) -> None:  # fmt: skip
    """Dielectric reflectance by textures of its weight and its colour."""
    if _sampled(block, whole, run, paint, m, SPECULAR):
        _times(block, run, at.SPECULAR, at.TEXEL_A, _ONE)
    if _sampled(block, whole, run, paint, m, SPECULAR_COLOR):
        for k in range(3):
            _times(block, run, at.F0_R + k * at.WIDTH, at.TEXEL_R + k * at.WIDTH, _ONE)
    for k in range(3):
        for i in range(run[0], run[1]):
            f0 = block[at.F0_R + k * at.WIDTH + i]
            block[at.F0_R + k * at.WIDTH + i] = (f0 if f0 < _ONE else _ONE) * block[at.SPECULAR + i]


@kernel
def _emit(block: Float32, run: Run) -> None:
    """Unlit points: their base colour is their radiance, and they reflect nothing."""
    for k in range(3):
        for i in range(run[0], run[1]):
            block[at.RED + k * at.WIDTH + i] = block[at.BASE_R + k * at.WIDTH + i]
        _set(block, run, at.BASE_R + k * at.WIDTH, _ZERO)
        _set(block, run, at.F0_R + k * at.WIDTH, _ZERO)
    _set(block, run, at.SPECULAR, _ZERO)
    _set(block, run, at.METALLIC, _ZERO)


@kernel
def _coat_normals(
    block: Float32, whole: Int32, run: Run, mesh: MeshBuffers, paint: MaterialBuffers
) -> None:  # fmt: skip
    """Normals of the clear coat, which the base's normal map does not tilt."""
    m = whole[at.MATERIAL + run[0]]
    for k in range(3):
        for i in range(run[0], run[1]):
            own = block[at.NORMAL_X + k * at.WIDTH + i]
            block[at.COAT_NORMAL + k * at.WIDTH + i] = own
    if _sampled(block, whole, run, paint, m, CLEARCOAT_NORMAL):
        strength = paint[0][m, _UV_ROWS + 8 * CLEARCOAT_NORMAL + 7]
        apply_normal_map(block, whole, run, mesh, strength)
        for k in range(3):
            for i in range(run[0], run[1]):
                one, other = at.NORMAL_X + k * at.WIDTH + i, at.COAT_NORMAL + k * at.WIDTH + i
                block[one], block[other] = block[other], block[one]


@kernel
def _stretch(
    block: Float32, whole: Int32, run: Run, mesh: MeshBuffers, paint: MaterialBuffers
) -> None:  # fmt: skip
    """Anisotropy and its direction, before normals are tilted."""
    numbers, m = paint[0], whole[at.MATERIAL + run[0]]
    x, y = math.cos(numbers[m, 15]), math.sin(numbers[m, 15])
    _set(block, run, at.ANISOTROPY, numbers[m, _LAYERS + 2])
    _set(block, run, at.ALONG, x)
    _set(block, run, at.ALONG + at.WIDTH, y)
    if not numbers[m, _LAYERS + 2] > _ZERO:
        return
    if _sampled(block, whole, run, paint, m, ANISOTROPY):
        _times(block, run, at.ANISOTROPY, at.TEXEL_B, _ONE)
        for i in range(run[0], run[1]):
            u = block[at.TEXEL_R + i] + block[at.TEXEL_R + i] - _ONE
            v = block[at.TEXEL_G + i] + block[at.TEXEL_G + i] - _ONE
            scale = _ONE / math.sqrt(max(u * u + v * v, _LEAST))
            block[at.ALONG + i] = (x * u - y * v) * scale
            block[at.ALONG + at.WIDTH + i] = (y * u + x * v) * scale
    pair = at.COORDINATES if numbers[m, _SHEEN + 3] < _HALF else at.COORDINATES + 2 * at.WIDTH
    for k in range(4):
        source = pair + (4 * (k // 2 + 1) + k % 2) * at.WIDTH
        for i in range(run[0], run[1]):
            block[at.U_ACROSS + k * at.WIDTH + i] = block[source + i]
    find_directions(block, whole, run, mesh)


@kernel
def _cover(block: Float32, whole: Int32, run: Run, paint: MaterialBuffers) -> None:
    """Emission kept apart, clear coat and sheen of a run."""
    numbers, m = paint[0], whole[at.MATERIAL + run[0]]
    _set(block, run, at.COAT, numbers[m, _LAYERS])
    _set(block, run, at.COAT_ROUGHNESS, numbers[m, _LAYERS + 1])
    _set(block, run, at.SHEEN_ROUGHNESS, numbers[m, _LAYERS + 3])
    for k in range(3):
        _set(block, run, at.SHEEN + k * at.WIDTH, numbers[m, _SHEEN + k])
        for i in range(run[0], run[1]):
            block[at.GLOW + k * at.WIDTH + i] = block[at.RED + k * at.WIDTH + i]
    if _sampled(block, whole, run, paint, m, CLEARCOAT):
        _times(block, run, at.COAT, at.TEXEL_R, _ONE)
    if _sampled(block, whole, run, paint, m, CLEARCOAT_ROUGHNESS):
        _times(block, run, at.COAT_ROUGHNESS, at.TEXEL_G, _ONE)
    if _sampled(block, whole, run, paint, m, SHEEN_COLOR):
        for k in range(3):
            _times(block, run, at.SHEEN + k * at.WIDTH, at.TEXEL_R + k * at.WIDTH, _ONE)
    if _sampled(block, whole, run, paint, m, SHEEN_ROUGHNESS):
        _times(block, run, at.SHEEN_ROUGHNESS, at.TEXEL_A, _ONE)


@kernel
def _clear(block: Float32, whole: Int32, run: Run, paint: MaterialBuffers) -> None:
    """Transmission and volume of a run."""
    numbers, m = paint[0], whole[at.MATERIAL + run[0]]
    _set(block, run, at.THROUGH, numbers[m, 11])
    if _sampled(block, whole, run, paint, m, TRANSMISSION):
        _times(block, run, at.THROUGH, at.TEXEL_R, _ONE)
    for k in range(3):
        _set(block, run, at.VOLUME + k * at.WIDTH, numbers[m, _VOLUME + k])
    if _sampled(block, whole, run, paint, m, THICKNESS):
        for k in range(3):
            _times(block, run, at.VOLUME + k * at.WIDTH, at.TEXEL_G, _ONE)


@kernel
def eval_materials(
    block: Float32, whole: Int32, count: int, mesh: MeshBuffers, paint: MaterialBuffers,
    lens: PinholeRows, layered: int | None,
) -> bool:  # fmt: skip
    """Evaluate materials at the first `count` points of a block; whether any has layers.

    With None for `layered`, which stands for no layers at all, nothing of them is compiled.
    """
    interpolate(block, whole, count, mesh)
    first, found = 0, False
    while first < count:
        run = same_material(whole, first, count)
        first, m = run[1], whole[at.MATERIAL + run[0]]
        base_colors(block, whole, run, paint)
        if paint[2][m] & OPAQUE:
            _set(block, run, at.ALPHA, _ONE)
        if paint[2][m] & CUT:
            for i in range(run[0], run[1]):
                kept = block[at.ALPHA + i] >= paint[0][m, _CUTOFF]
                block[at.ALPHA + i] = _ONE if kept else _ZERO
        _clip(block, run, at.ALPHA)
        if paint[2][m] & UNLIT:
            _emit(block, run)
            continue
        covered = (paint[2][m] & LAYERED) != 0
        if layered is not None and covered:
            _coat_normals(block, whole, run, mesh, paint)
            _stretch(block, whole, run, mesh, paint)
        if _sampled(block, whole, run, paint, m, NORMAL):
            apply_normal_map(block, whole, run, mesh, paint[0][m, _UV_ROWS + 8 * NORMAL + 7])
        _reflectance(block, whole, run, paint)
        if layered is not None and covered:
            _cover(block, whole, run, paint)
            _clear(block, whole, run, paint)
        found |= covered
    view_vectors(block, lens)
    return found
