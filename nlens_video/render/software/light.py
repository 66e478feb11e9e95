"""glTF 2.0 metallic-roughness shading (appendix B) under punctual and ambient light, by block.

The formulas of the OpenGL shader (`render/opengl/shaders/object.frag`); defined by
`reference_kernels.reflectance`.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import (
    f32,
    fastmath_inlined,
    fastmath_kernel,
    inlined,
    kernel,
    kernel_of,
    to_f32,
)
from nlens_video.render.software import shading_block as at
from nlens_video.render.software.interpolation import Vector
from nlens_video.scene.surround import LEVELS, ROUGHEST, SOFT

_N = at.WIDTH
_U = np.uint64  # of an index: signed ones might count from the end, which prevents vectorising
_PI = f32(math.pi)
_ONE, _ZERO, _HALF = f32(1.0), f32(0.0), f32(0.5)
_LEAST_NV, _LEAST = f32(1e-4), f32(1e-30)
_LEAST_ALPHA = f32(0.002)
_LAST, _STEPS = LEVELS - 1, f32((LEVELS - 1) / ROUGHEST)
_ROUGHEST, _SHARPER = f32(ROUGHEST), f32(1.0 / (ROUGHEST - SOFT))
# Of Karis's fit to the reflectance of rough mirrors ("Physically Based Shading on Mobile", 2014).
_BEND, _BEND_ROUGH = f32(0.0425), f32(0.0275)
_SPAN, _SPAN_ROUGH, _BIAS, _BIAS_ROUGH = f32(1.04), f32(0.572), f32(0.04), f32(0.022)


# Instead of max and min, whose NaN rules prevent vectorising.
@fastmath_inlined
def larger(a: float, b: float) -> float:
    """The larger of two numbers; `b` if either is none."""
    return a if a > b else b


@fastmath_inlined
def smaller(a: float, b: float) -> float:
    """The smaller of two numbers; `b` if either is none."""
    return a if a < b else b


@fastmath_inlined
def _reflect(
    block: Float32, i: int, toward: tuple[float, float, float], strength: tuple[float, float, float]
) -> None:
    """Add what a point reflects of light from the unit direction."""
    nx, ny, nz = block[_U(at.NORMAL_X + i)], block[_U(at.NORMAL_Y + i)], block[_U(at.NORMAL_Z + i)]
    vx, vy, vz = block[_U(at.VIEW_X + i)], block[_U(at.VIEW_Y + i)], block[_U(at.VIEW_Z + i)]
    nl = larger(nx * toward[0] + ny * toward[1] + nz * toward[2], _ZERO)
    nv = nx * vx + ny * vy + nz * vz
    nv = larger(larger(nv, -nv), _LEAST_NV)
    hx, hy, hz = toward[0] + vx, toward[1] + vy, toward[2] + vz
    scale = _ONE / math.sqrt(larger(hx * hx + hy * hy + hz * hz, _LEAST))
    nh = larger((nx * hx + ny * hy + nz * hz) * scale, _ZERO)
    vh = smaller(larger((vx * hx + vy * hy + vz * hz) * scale, _ZERO), _ONE)
    away = _ONE - vh
    grazing = away * away * (away * away) * away
    roughness = block[_U(at.ROUGHNESS + i)]
    alpha = larger(roughness * roughness, _LEAST_ALPHA)
    a2 = alpha * alpha
    spread = nh * nh * (a2 - _ONE) + _ONE
    hidden = nl * math.sqrt(nv * nv * (_ONE - a2) + a2) + nv * math.sqrt(nl * nl * (_ONE - a2) + a2)
    lobe = a2 * _HALF / (_PI * spread * spread * hidden)
    f90, metallic = block[_U(at.SPECULAR + i)], block[_U(at.METALLIC + i)]
    fr = block[_U(at.F0_R + i)] + (f90 - block[_U(at.F0_R + i)]) * grazing
    fg = block[_U(at.F0_G + i)] + (f90 - block[_U(at.F0_G + i)]) * grazing
    fb = block[_U(at.F0_B + i)] + (f90 - block[_U(at.F0_B + i)]) * grazing
    diffuse = (_ONE - metallic) * (_ONE - larger(fr, larger(fg, fb))) / _PI
    shine = lobe * (_ONE - metallic)
    gleam = lobe * metallic
    br, bg, bb = block[_U(at.BASE_R + i)], block[_U(at.BASE_G + i)], block[_U(at.BASE_B + i)]
    red = diffuse * br + shine * fr + gleam * (br + (_ONE - br) * grazing)
    green = diffuse * bg + shine * fg + gleam * (bg + (_ONE - bg) * grazing)
    blue = diffuse * bb + shine * fb + gleam * (bb + (_ONE - bb) * grazing)
    block[_U(at.RED + i)] += nl * strength[0] * red
    block[_U(at.GREEN + i)] += nl * strength[1] * green
    block[_U(at.BLUE + i)] += nl * strength[2] * blue


@fastmath_kernel
def _by_sun(block: Float32, lamp: Float32) -> None:
    toward = lamp[8], lamp[9], lamp[10]
    strength = lamp[0], lamp[1], lamp[2]
    for i in range(_N):
        _reflect(block, i, toward, strength)


@fastmath_inlined
def _from_lamp(
    block: Float32, i: int, lamp: Float32
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Unit direction from a point to a lamp with a place, and the light it gets from there."""
    distance = block[_U(at.DISTANCE + i)]
    x = lamp[4] + block[_U(at.VIEW_X + i)] * distance
    y = lamp[5] + block[_U(at.VIEW_Y + i)] * distance
    z = lamp[6] + block[_U(at.VIEW_Z + i)] * distance
    squared = larger(x * x + y * y + z * z, _LEAST)
    near = _ONE / math.sqrt(squared)
    x, y, z = x * near, y * near, z * near
    beyond = squared * lamp[7]
    window = smaller(larger(_ONE - beyond * beyond, _ZERO), _ONE)
    facing = (lamp[8] * x + lamp[9] * y + lamp[10] * z) * lamp[12] + lamp[13]
    spot = smaller(larger(facing, _ZERO), _ONE)
    part = window * spot * spot / squared
    return (x, y, z), (part * lamp[0], part * lamp[1], part * lamp[2])


@fastmath_kernel
def _by_lamp(block: Float32, lamp: Float32) -> None:
    for i in range(_N):
        toward, strength = _from_lamp(block, i, lamp)
        _reflect(block, i, toward, strength)


@fastmath_inlined
def lamp_at(
    block: Float32, i: int, lamps: Float32, suns: int, number: int
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Unit direction from a point to any of the lamps, and the light it gets from there."""
    lamp = lamps[number]
    if number < suns:
        return (lamp[8], lamp[9], lamp[10]), (lamp[0], lamp[1], lamp[2])
    return _from_lamp(block, i, lamp)


@fastmath_inlined
def around_on(ambient: Float32, c: int, n: tuple[float, float, float]) -> float:
    """One channel of `Illumination.ambient` on a unit normal."""
    x, y, z = n
    return larger(
        ambient[0, c] + ambient[1, c] * y + ambient[2, c] * z + ambient[3, c] * x
        + ambient[4, c] * (x * y) + ambient[5, c] * (y * z)
        + ambient[6, c] * (np.float32(3.0) * z * z - _ONE) + ambient[7, c] * (x * z)
        + ambient[8, c] * (x * x - y * y),
        _ZERO,
    )  # fmt: skip


@fastmath_inlined
def mirrored(color: float, edge: float, nv: float, roughness: float) -> float:
    """Share of even light that a rough mirror of that colour reflects, as `mirrored` there."""
    gloss = _ONE - roughness
    away = _ONE - smaller(larger(nv, _ZERO), _ONE)
    away *= away
    bend = smaller(gloss * gloss, away * away * away) * gloss + _BEND - _BEND_ROUGH * roughness
    scale = _SPAN - _SPAN_ROUGH * roughness - _SPAN * bend
    bias = _SPAN * bend - _BIAS + _BIAS_ROUGH * roughness
    return (color * scale + edge * bias) * (_ONE + color * (_ONE / (scale + bias) - _ONE))


@inlined
def _mixed(levels: Float32, level: int, place: tuple[int, int], shares: Vector) -> Vector:
    """Mean of four texels and their like on the next level; `shares` of column, row and level."""
    x, y = place
    across, down, rougher = shares
    red = green = blue = _ZERO
    for k in range(8):
        dx, dy, dz = k & 1, k >> 1 & 1, k >> 2
        weight = across if dx else _ONE - across
        weight *= down if dy else _ONE - down
        weight *= rougher if dz else _ONE - rougher
        red += weight * levels[level + dz, y + dy, x + dx, 0]
        green += weight * levels[level + dz, y + dy, x + dx, 1]
        blue += weight * levels[level + dz, y + dy, x + dx, 2]
    return red, green, blue


@inlined
def mirrored_light(levels: Float32, toward: Vector, roughness: float) -> tuple[Vector, float]:
    """Light that a surface mirrors from a direction, as `surround.mirrored_light`.

    With the share of it that this is; what a rough one mirrors is told by the light's harmonics.
    """
    scale = _ONE / larger(abs(toward[0]) + abs(toward[1]) + abs(toward[2]), _LEAST)
    x, z = toward[0] * scale, toward[2] * scale
    if toward[1] < _ZERO:
        x, z = math.copysign(_ONE - abs(z), x), math.copysign(_ONE - abs(x), z)
    side = levels.shape[1]
    half = _HALF * to_f32(side - 2)
    column, row = (x + _ONE) * half + _HALF, (z + _ONE) * half + _HALF
    left, top = min(max(int(column), 0), side - 2), min(max(int(row), 0), side - 2)
    place = larger(smaller(roughness, _ROUGHEST), _ZERO) * _STEPS
    finer = min(int(place), _LAST - 1)
    shares = column - to_f32(left), row - to_f32(top), place - to_f32(finer)
    share = smaller(larger((_ROUGHEST - roughness) * _SHARPER, _ZERO), _ONE)
    return _mixed(levels, finer, (left, top), shares), share


@inlined
def mirrored_around(
    ambient: Float32, levels: Float32 | None, toward: Vector, normal: Vector, roughness: float
) -> Vector:
    """Light from around that a surface mirrors from a direction, by harmonics where it is rough."""
    red, green, blue = (
        around_on(ambient, 0, toward), around_on(ambient, 1, toward), around_on(ambient, 2, toward)
    )  # fmt: skip
    red += (around_on(ambient, 0, normal) - red) * roughness
    green += (around_on(ambient, 1, normal) - green) * roughness
    blue += (around_on(ambient, 2, normal) - blue) * roughness
    if levels is not None:
        found, share = mirrored_light(levels, toward, roughness)
        red += share * (found[0] - red)
        green += share * (found[1] - green)
        blue += share * (found[2] - blue)
    return red, green, blue


@kernel
def _mirror(block: Float32, count: int, ambient: Float32, levels: Float32) -> None:
    for i in range(count):
        roughness = block[at.ROUGHNESS + i]
        if not roughness < _ROUGHEST:
            continue
        n = block[at.NORMAL_X + i], block[at.NORMAL_Y + i], block[at.NORMAL_Z + i]
        v = block[at.VIEW_X + i], block[at.VIEW_Y + i], block[at.VIEW_Z + i]
        nv = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
        twice = nv + nv
        toward = twice * n[0] - v[0], twice * n[1] - v[1], twice * n[2] - v[2]
        found, share = mirrored_light(levels, toward, roughness)
        share *= block[at.OCCLUSION + i]
        metallic, edge = block[at.METALLIC + i], block[at.SPECULAR + i]
        edge += (_ONE - edge) * metallic
        for c in range(3):
            around, soft = around_on(ambient, c, n), around_on(ambient, c, toward)
            soft += (around - soft) * roughness
            base, f0 = block[at.BASE_R + c * at.WIDTH + i], block[at.F0_R + c * at.WIDTH + i]
            color = f0 + (base - f0) * metallic
            part = share * mirrored(color, edge, nv, roughness)
            block[at.RED + c * at.WIDTH + i] += part * (found[c] - soft)


@kernel
def mirror_surround(block: Float32, count: int, ambient: Float32, levels: Float32 | None) -> None:
    """Let the smooth ones of the first `count` points mirror the light around, added by `light`.

    `levels` are `Surround.levels`; with None, which stands for none, nothing is compiled.
    """
    if levels is not None:
        _mirror(block, count, ambient, levels)


@fastmath_kernel
def _from_around(block: Float32, ambient: Float32, c: int, base_: int, f0_: int, sum_: int) -> None:
    for i in range(_N):
        n = block[_U(at.NORMAL_X + i)], block[_U(at.NORMAL_Y + i)], block[_U(at.NORMAL_Z + i)]
        vx, vy, vz = block[_U(at.VIEW_X + i)], block[_U(at.VIEW_Y + i)], block[_U(at.VIEW_Z + i)]
        nv = np.float32(2.0) * (n[0] * vx + n[1] * vy + n[2] * vz)
        reflection = nv * n[0] - vx, nv * n[1] - vy, nv * n[2] - vz
        around, ahead = around_on(ambient, c, n), around_on(ambient, c, reflection)
        roughness = block[_U(at.ROUGHNESS + i)]
        ahead += (around - ahead) * roughness
        metallic, base, f0 = block[_U(at.METALLIC + i)], block[_U(base_ + i)], block[_U(f0_ + i)]
        color = f0 + (base - f0) * metallic
        edge = block[_U(at.SPECULAR + i)]
        edge += (_ONE - edge) * metallic
        lit = around * base * (_ONE - metallic)
        lit += ahead * mirrored(color, edge, _HALF * nv, roughness)
        block[_U(sum_ + i)] += block[_U(at.OCCLUSION + i)] * lit


@kernel_of("void(f4[::1],f4[:,::1],i8,f4[:,::1])")
def light(block: Float32, lamps: Float32, suns: int, ambient: Float32) -> None:
    """Add the light that the points of a block reflect towards the eye to their radiance.

    `lamps` are the numbers of the lamps (L, 16), the first `suns` of them without a place
    (`Lighting.lamp_rows`), `ambient` the light from around (9, 4), or (0, 4) where there is none.
    """
    for n in range(len(lamps)):
        if n < suns:
            _by_sun(block, lamps[n])
        else:
            _by_lamp(block, lamps[n])
    if len(ambient):
        _from_around(block, ambient, 0, at.BASE_R, at.F0_R, at.RED)
        _from_around(block, ambient, 1, at.BASE_G, at.F0_G, at.GREEN)
        _from_around(block, ambient, 2, at.BASE_B, at.F0_B, at.BLUE)
