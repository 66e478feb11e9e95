"""Clear coat, sheen, anisotropy, transmission: radiance of materials that have them, by point.

The formulas of the OpenGL shader (`render/opengl/shaders/object.frag`), which are those of
KHR_materials_clearcoat, _sheen, _anisotropy and _transmission; defined by
`reference_kernels.layered` and `passed`.
"""

from __future__ import annotations

import math

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import f32, inlined, kernel, to_f32
from nlens_video.render.software import shading_block as at
from nlens_video.render.software.interpolation import Vector
from nlens_video.render.software.light import around_on, lamp_at, mirrored, mirrored_around
from nlens_video.render.software.material_eval import (
    BENDING,
    LAYERED,
    MaterialBuffers,
    same_material,
)
from nlens_video.render.software.shading_block import Int32

_PI = f32(math.pi)
_ZERO, _HALF, _ONE, _TWO, _FOUR = (f32(v) for v in (0.0, 0.5, 1.0, 2.0, 4.0))
_LEAST, _LEAST_NV, _LEAST_ALPHA = f32(1e-30), f32(1e-4), f32(0.002)
_COAT_F0 = f32(0.04)
_LUMINANCE_R, _LUMINANCE_G, _LUMINANCE_B = f32(0.2126), f32(0.7152), f32(0.0722)
_LEAST_SHEEN, _FITTED, _LEAST_FROST = f32(0.07), f32(0.1), f32(0.2)
Lit = tuple[Float32, int, Float32]
"""Lamps, how many of them have no place, and ambient light, as of `deferred.Lamps`."""


@inlined
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _at(block: Float32, field: int, i: int) -> Vector:
    return block[field + i], block[field + at.WIDTH + i], block[field + 2 * at.WIDTH + i]


@inlined
def _unit(v: Vector) -> Vector:
    scale = _ONE / math.sqrt(max(_dot(v, v), _LEAST))
    return v[0] * scale, v[1] * scale, v[2] * scale


@inlined
def _fifth(x: float) -> float:
    return x * x * (x * x) * x


@inlined
def _glossy(nh: float, nl: float, nv: float, alpha: float) -> float:
    a2 = alpha * alpha
    spread = nh * nh * (a2 - _ONE) + _ONE
    hidden = nl * math.sqrt(nv * nv * (_ONE - a2) + a2) + nv * math.sqrt(nl * nl * (_ONE - a2) + a2)
    return a2 * _HALF / (_PI * spread * spread * hidden)


@inlined
def _stretched(
    cosines: Vector, along: Vector, beside: Vector, alphas: tuple[float, float]
) -> float:
    """`cosines` of the normal to half vector, light and eye; likewise `along` and `beside`."""
    nh, nl, nv = cosines
    wide, alpha = alphas
    a2 = wide * alpha
    fx, fy, fz = alpha * along[0], wide * beside[0], a2 * nh
    w2 = a2 / (fx * fx + fy * fy + fz * fz)
    to_eye = math.sqrt((wide * along[2]) ** 2 + (alpha * beside[2]) ** 2 + nv * nv)
    to_light = math.sqrt((wide * along[1]) ** 2 + (alpha * beside[1]) ** 2 + nl * nl)
    return a2 * w2 * w2 / _PI * min(_HALF / (nl * to_eye + nv * to_light), _ONE)


@inlined
def _mix(low: float, high: float, share: float) -> float:
    """Between two constants, as float32."""
    return to_f32(low) + to_f32(high - low) * share


@inlined
def _fibre_fit(x: float, alpha: float) -> float:
    s = (_ONE - alpha) * (_ONE - alpha)
    a, b = _mix(21.5473, 25.3245, s), _mix(3.82987, 3.32435, s)
    c, d = _mix(0.19823, 0.16801, s), _mix(-1.97760, -1.27393, s)
    found: float = a / (_ONE + b * x**c) + d * x + _mix(-4.32054, -4.85967, s)
    return found


@inlined
def _fibre_shadow(x: float, alpha: float) -> float:
    if x < _HALF:
        return math.exp(_fibre_fit(x, alpha))
    return math.exp(_TWO * _fibre_fit(_HALF, alpha) - _fibre_fit(_ONE - x, alpha))


@inlined
def _fibres(nh: float, nl: float, nv: float, roughness: float) -> float:
    alpha = roughness * roughness
    lobe = (_TWO + _ONE / alpha) * max(_ONE - nh * nh, _ZERO) ** (_HALF / alpha) / (_TWO * _PI)
    nl, nv = min(nl, _ONE), min(nv, _ONE)
    shadows = _ONE + _fibre_shadow(nv, alpha) + _fibre_shadow(nl, alpha)
    found: float = lobe * min(_ONE / (shadows * _FOUR * nv * nl), _ONE)
    return found


@inlined
def _fibre_share(nv: float, roughness: float) -> float:
    r = max(roughness, _FITTED)
    a = to_f32(0.1022) / r - to_f32(0.6472) + to_f32(0.3144) * r
    b = to_f32(-0.6898) / r - to_f32(1.8652) + to_f32(1.1422) * r
    c = to_f32(-1.5261) / r + to_f32(4.2535) - to_f32(2.9285) * r
    return min(math.exp(a + (b + c * nv) * nv), _ONE)


@inlined
def _mirror(n: Vector, v: Vector) -> Vector:
    twice = _TWO * _dot(n, v)
    return twice * n[0] - v[0], twice * n[1] - v[1], twice * n[2] - v[2]


@inlined
def _add(block: Float32, field: int, i: int, part: float, light: Vector) -> None:
    for c in range(3):
        block[field + c * at.WIDTH + i] += part * light[c]


@inlined
def _has_sheen(block: Float32, i: int) -> bool:
    sheen = _at(block, at.SHEEN, i)
    return max(sheen[0], max(sheen[1], sheen[2])) > _ZERO


@kernel
def _by_lamp(block: Float32, i: int, toward: Vector, light: Vector) -> None:
    """Add what a point reflects of light from the unit direction: base, sheen and coat apart."""
    n, v = _at(block, at.NORMAL_X, i), _at(block, at.VIEW_X, i)
    h = _unit((toward[0] + v[0], toward[1] + v[1], toward[2] + v[2]))
    nl, nh, nv = _dot(n, toward), max(_dot(n, h), _ZERO), max(abs(_dot(n, v)), _LEAST_NV)
    if nl > _ZERO:
        lobe = _base_lobe(block, i, (nh, nl, nv), (h, toward, v))
        grazing = _fifth(_ONE - min(max(_dot(v, h), _ZERO), _ONE))
        f90, metallic = block[at.SPECULAR + i], block[at.METALLIC + i]
        strongest = max(block[at.F0_R + i], max(block[at.F0_G + i], block[at.F0_B + i]))
        kept = _ONE - (strongest + (f90 - strongest) * grazing)
        for c in range(3):
            f0, base = block[at.F0_R + c * at.WIDTH + i], block[at.BASE_R + c * at.WIDTH + i]
            plastic = kept * (_ONE - block[at.THROUGH + i]) * base / _PI + lobe * (
                f0 + (f90 - f0) * grazing
            )
            metal = lobe * (base + (_ONE - base) * grazing)
            mixed = plastic + (metal - plastic) * metallic
            block[at.RED + c * at.WIDTH + i] += nl * light[c] * mixed
        if _has_sheen(block, i):
            roughness = min(max(block[at.SHEEN_ROUGHNESS + i], _LEAST_SHEEN), _ONE)
            _add(block, at.FUZZ, i, nl * _fibres(min(nh, _ONE), nl, nv, roughness), light)
    if not block[at.COAT + i] > _ZERO:
        return
    n = _unit(_at(block, at.COAT_NORMAL, i))
    nl, nh, nv = _dot(n, toward), max(_dot(n, h), _ZERO), max(abs(_dot(n, v)), _LEAST_NV)
    if nl > _ZERO:
        alpha = max(block[at.COAT_ROUGHNESS + i] * block[at.COAT_ROUGHNESS + i], _LEAST_ALPHA)
        _add(block, at.SHINE, i, nl * _glossy(nh, nl, nv, alpha), light)


@inlined
def _base_lobe(block: Float32, i: int, cosines: Vector, towards: tuple[Vector, ...]) -> float:
    """Microfacets of the base; cosines of the normal, and unit vectors, to half, light and eye."""
    roughness, strength = block[at.ROUGHNESS + i], block[at.ANISOTROPY + i]
    alpha = max(roughness * roughness, _LEAST_ALPHA)
    along, beside = _at(block, at.ALONG, i), _unit(_at(block, at.BESIDE, i))
    if not strength > _ZERO or not _dot(along, along) > _ZERO:
        return _glossy(cosines[0], cosines[1], cosines[2], alpha)
    along = _unit(along)
    wide = alpha + (_ONE - alpha) * strength * strength
    return _stretched(
        cosines, (_dot(along, towards[0]), _dot(along, towards[1]), _dot(along, towards[2])),
        (_dot(beside, towards[0]), _dot(beside, towards[1]), _dot(beside, towards[2])),
        (wide, alpha),
    )  # fmt: skip


@kernel
def _by_surround(block: Float32, i: int, ambient: Float32, levels: Float32 | None) -> None:
    """Add what a point reflects of the light from around, likewise."""
    n, v = _at(block, at.NORMAL_X, i), _at(block, at.VIEW_X, i)
    coat = _unit(_at(block, at.COAT_NORMAL, i))
    facing = _dot(n, v)
    f90, metallic = block[at.SPECULAR + i], block[at.METALLIC + i]
    edge, roughness = f90 + (_ONE - f90) * metallic, block[at.ROUGHNESS + i]
    fuzz = _fibre_share(min(abs(facing), _ONE), block[at.SHEEN_ROUGHNESS + i])
    occlusion, dull = block[at.OCCLUSION + i], block[at.COAT_ROUGHNESS + i]
    ahead = mirrored_around(ambient, levels, _mirror(n, v), n, roughness)
    gloss = mirrored_around(ambient, levels, _mirror(coat, v), coat, dull)
    for c in range(3):
        around = around_on(ambient, c, n)
        base, f0 = block[at.BASE_R + c * at.WIDTH + i], block[at.F0_R + c * at.WIDTH + i]
        tint = f0 + (base - f0) * metallic
        scattered = (_ONE - metallic) * (_ONE - block[at.THROUGH + i])
        part = around * base * scattered + ahead[c] * mirrored(tint, edge, facing, roughness)
        block[at.RED + c * at.WIDTH + i] += occlusion * part
        block[at.FUZZ + c * at.WIDTH + i] += occlusion * around * fuzz
        block[at.SHINE + c * at.WIDTH + i] += occlusion * gloss[c]


@kernel
def _see_through(
    block: Float32, i: int, under: float, bending: float, ambient: Float32, levels: Float32 | None
) -> None:
    """Let light from behind through; `under` is the share that further layers leave.

    Its alpha becomes what hides the things behind, all colours alike. In which colours it differs
    from that, and what roughness scatters, is taken from the light around, as blurred.
    """
    v = _at(block, at.VIEW_X, i)
    nv = min(abs(_dot(_at(block, at.NORMAL_X, i), v)), _ONE)
    strongest = max(block[at.F0_R + i], max(block[at.F0_G + i], block[at.F0_B + i]))
    kept = _ONE - (strongest + (block[at.SPECULAR + i] - strongest) * _fifth(_ONE - nv))
    kept *= block[at.THROUGH + i] * (_ONE - block[at.METALLIC + i]) * under
    red = kept * block[at.BASE_R + i] * math.exp(-block[at.VOLUME + i])
    green = kept * block[at.BASE_G + i] * math.exp(-block[at.VOLUME + at.WIDTH + i])
    blue = kept * block[at.BASE_B + i] * math.exp(-block[at.VOLUME + 2 * at.WIDTH + i])
    shown = _LUMINANCE_R * red + _LUMINANCE_G * green + _LUMINANCE_B * blue
    frosted = min(block[at.ROUGHNESS + i] * bending, _ONE)
    shown = min(shown, _ONE) * (_ONE - frosted)
    if len(ambient):
        behind = -v[0], -v[1], -v[2]
        light = mirrored_around(ambient, levels, behind, behind, max(frosted, _LEAST_FROST))
        block[at.RED + i] += (red - shown) * light[0]
        block[at.GREEN + i] += (green - shown) * light[1]
        block[at.BLUE + i] += (blue - shown) * light[2]
    block[at.HIDDEN + i] = _ONE - shown


@kernel
def _laid_over(block: Float32, i: int) -> float:
    """Lay sheen over the base and the coat over all; the share that they leave of what is below."""
    v, sheen = _at(block, at.VIEW_X, i), _at(block, at.SHEEN, i)
    nv = min(abs(_dot(_at(block, at.NORMAL_X, i), v)), _ONE)
    share = _fibre_share(nv, block[at.SHEEN_ROUGHNESS + i])
    kept = _ONE - max(sheen[0], max(sheen[1], sheen[2])) * share
    nv = min(abs(_dot(_unit(_at(block, at.COAT_NORMAL, i)), v)), _ONE)
    coat = block[at.COAT + i] * (_COAT_F0 + (_ONE - _COAT_F0) * _fifth(_ONE - nv))
    for c in range(3):
        k = c * at.WIDTH + i
        under = kept * block[at.RED + k] + sheen[c] * block[at.FUZZ + k] + block[at.GLOW + k]
        block[at.RED + k] = under + (block[at.SHINE + k] - under) * coat
    left: float = kept * (_ONE - coat)
    return left


@kernel
def _light_point(block: Float32, i: int, bending: float, lit: Lit, levels: Float32 | None) -> None:
    """Radiance of a point with layers."""
    lamps, suns, ambient = lit
    for c in range(3):
        k = c * at.WIDTH + i
        block[at.RED + k] = block[at.FUZZ + k] = block[at.SHINE + k] = _ZERO
    for number in range(len(lamps)):
        toward, light = lamp_at(block, i, lamps, suns, number)
        _by_lamp(block, i, toward, light)
    if len(ambient):
        _by_surround(block, i, ambient, levels)
    under = _laid_over(block, i)
    if block[at.THROUGH + i] > _ZERO:
        _see_through(block, i, under, bending, ambient, levels)


@kernel
def _light_runs(
    block: Float32, whole: Int32, count: int, paint: MaterialBuffers, lit: Lit,
    levels: Float32 | None,
) -> None:  # fmt: skip
    first = 0
    while first < count:
        run = same_material(whole, first, count)
        first = run[1]
        m = whole[at.MATERIAL + run[0]]
        if paint[2][m] & LAYERED:
            for i in range(run[0], run[1]):
                _light_point(block, i, paint[0][m, BENDING], lit, levels)


@kernel
def light_layers(
    block: Float32, whole: Int32, count: int, paint: MaterialBuffers, lit: Lit,
    levels: Float32 | None, layered: int | None,
) -> None:  # fmt: skip
    """Replace the radiance of points whose materials have layers; nothing with None for them."""
    if layered is not None:
        _light_runs(block, whole, count, paint, lit, levels)
