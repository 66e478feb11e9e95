"""Textures sampled by their definition in OpenGL 4 (section 8.14), a run of points at a time.

Which texels a point needs is worked out for many points at once; reading them, the one thing that
has no vector instruction worth having, comes in a loop of its own, so that no point waits for the
memory of the one before.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import (
    f32,
    fastmath_inlined,
    fastmath_kernel,
    floor,
    kernel,
    to_f32,
)
from nlens_video.kernels.simd_types import (
    FLOAT4,
    FLOATS,
    FUSED,
    Generator,
    instruction,
    lane,
    splat,
    spread,
)
from nlens_video.render.software import fragment as at
from nlens_video.render.software.fragment import Int32
from nlens_video.render.software.texture import CLAMP, LINEAR, MIRROR, Table, Texels

Run = tuple[int, int]
"""First point of a block, and one beyond the last."""
Rule = tuple[float, float, float, float, bool, bool, bool]
"""Columns and rows of a texture, its last level, the square of the change from which on it is
shrunk; whether enlarging and shrinking are linear, whether one level serves."""

# Columns of the atlas' table: first level, levels, filters for enlarging and shrinking, wrapping.
_FIRST, _COUNT, _MAG, _MIN, _WRAP_S, _WRAP_T = range(6)
_NEAREST_OF_NEAREST, _LINEAR_OF_NEAREST, _NEAREST_OF_TWO = 9984, 9985, 9986
_U = np.uint64  # of an index: one that might be negative is counted from the end
_ZERO, _HALF, _ONE, _TWO = (f32(v) for v in (0.0, 0.5, 1.0, 2.0))
_FAR, _LEAST = f32(1e6), f32(1e-30)
_ROOT, _OF_ODD = f32(math.sqrt(2.0)), f32(2.0 / math.log(2.0))
_THIRD, _FIFTH, _SEVENTH = f32(1.0 / 3.0), f32(1.0 / 5.0), f32(1.0 / 7.0)
_BIAS, _FRACTION_BITS = 127, 23  # of a float32
# `Any` throughout: llvmlite's code generators have no types of their own.
_FLOAT, _INT = ir.FloatType(), ir.IntType(32)
_PAIR, _CODES = ir.VectorType(ir.IntType(16), 8), ir.VectorType(ir.IntType(16), 4)
_EIGHT, _EIGHT_OF_ONE = ir.VectorType(_FLOAT, 8), ir.Constant(ir.VectorType(_INT, 8), [0] * 8)
_SCALE = ir.Constant(FLOATS, [1.0 / 65535.0] * 4)


def _mix(builder: Any, one: Any, other: Any, part: Any) -> Any:
    away = builder.fsub(other, one, flags=FUSED)
    return builder.fadd(one, builder.fmul(away, part, flags=FUSED), flags=FUSED)


@instruction
def _blend(_: Any, texels: Any, upper: Any, lower: Any, across: Any, down: Any) -> Generator:
    """Compile: mix texels `upper` and `lower` by `down`, and so the next ones; both by `across`."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, given[0]).data

        def pair(index: Any) -> Any:
            first = builder.gep(data, [builder.shl(index, index.type(2))])
            codes = builder.load(builder.bitcast(first, _PAIR.as_pointer()), align=2)
            return builder.uitofp(codes, _EIGHT)

        def half(numbers: Any, first: int) -> Any:
            order = ir.Constant(ir.VectorType(_INT, 4), list(range(first, first + 4)))
            return builder.shuffle_vector(numbers, numbers, order)

        parts = builder.insert_element(ir.Constant(_EIGHT, ir.Undefined), given[4], _INT(0))
        parts = builder.shuffle_vector(parts, parts, _EIGHT_OF_ONE)
        both = _mix(builder, pair(given[1]), pair(given[2]), parts)
        mixed = _mix(builder, half(both, 0), half(both, 4), spread(builder, given[3]))
        return builder.fmul(mixed, _SCALE)

    return FLOAT4(texels, *(types.intp,) * 2, *(types.float32,) * 2), generate


@instruction
def _exponent(_: Any, value: Any) -> Generator:
    """Compile: the exponent of 2 of a positive float32, as one."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        bits = builder.lshr(builder.bitcast(given[0], _INT), _INT(_FRACTION_BITS))
        return builder.sitofp(builder.sub(bits, _INT(_BIAS)), _FLOAT)

    return types.float32(types.float32), generate


@instruction
def _fraction(_: Any, value: Any) -> Generator:
    """Compile: a positive float32 without its exponent, from 1 to below 2."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        bits = builder.and_(builder.bitcast(given[0], _INT), _INT((1 << _FRACTION_BITS) - 1))
        return builder.bitcast(builder.or_(bits, _INT(_BIAS << _FRACTION_BITS)), _FLOAT)

    return types.float32(types.float32), generate


@instruction
def _half_to(_: Any, power: Any) -> Generator:
    """Compile: a half to the power of a whole number, 0 to 126, that is given as a float32."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        exponent = builder.sub(_INT(_BIAS), builder.fptosi(given[0], _INT))
        return builder.bitcast(builder.shl(exponent, _INT(_FRACTION_BITS)), _FLOAT)

    return types.float32(types.float32), generate


@fastmath_inlined
def _log2(value: float) -> float:
    """Of a positive number, to 1e-6: libm's takes one number at a time."""
    part = _fraction(value)
    large = part > _ROOT
    part = part * _HALF if large else part
    odd = (part - _ONE) / (part + _ONE)  # of the series of the inverse hyperbolic tangent
    square = odd * odd
    series = _ONE + square * (_THIRD + square * (_FIFTH + square * _SEVENTH))
    found: float = _exponent(value) + (_ONE if large else _ZERO) + _OF_ODD * odd * series
    return found


@fastmath_inlined
def _wrapped(u: float, wrap: int) -> float:
    """A coordinate as one in [0, 1]; 0 where it is too large to have a fraction."""
    u = u if abs(u) < _FAR else _ZERO
    clamped = u if u > _ZERO else _ZERO
    clamped = clamped if clamped < _ONE else _ONE
    mirrored = abs(u - _TWO * floor(u * _HALF + _HALF))
    mirrored = mirrored if mirrored < _ONE else _ONE
    repeated = u - floor(u)
    return clamped if wrap == CLAMP else (mirrored if wrap == MIRROR else repeated)


@fastmath_kernel
def _choose_levels(block: Float32, run: Run, rule: Rule) -> None:
    """Fill in which level each point of a run reads, and the share of the next."""
    width, height, last, edge, mag, least, single_level = rule
    for i in range(run[0], run[1]):
        ux, vx = block[_U(at.U_ACROSS + i)] * width, block[_U(at.V_ACROSS + i)] * height
        uy, vy = block[_U(at.U_DOWN + i)] * width, block[_U(at.V_DOWN + i)] * height
        across, down = ux * ux + vx * vx, uy * uy + vy * vy
        squared = across if across > down else down
        shrunk = squared > edge
        lod = _HALF * _log2(squared if shrunk else _ONE)
        lod = lod if lod < last else last
        lod = lod if lod > _ZERO else _ZERO
        near = floor(lod + _HALF)
        near = near if near < lod + _HALF else near - _ONE  # a half goes to the larger picture
        level = near if single_level else floor(lod)
        block[_U(at.LEVEL + i)] = level if level > _ZERO else _ZERO
        block[_U(at.NEXT + i)] = _ZERO if single_level else lod - level
        block[_U(at.SMOOTH + i)] = _ONE if (least if shrunk else mag) else _ZERO


@fastmath_kernel
def _choose_texels(
    block: Float32, whole: Int32, run: Run, rule: Rule, wrap: tuple[int, int]
) -> None:
    """Fill in the texels of both levels of each point, and the shares of those beside them."""
    width, height, last = rule[0], rule[1], rule[2]
    for k in range(2):
        for i in range(run[0], run[1]):
            level = block[_U(at.LEVEL + i)] + to_f32(k)
            level = level if level < last else last
            scale = _half_to(level)
            columns, rows = floor(width * scale), floor(height * scale)
            columns = columns if columns > _ONE else _ONE
            rows = rows if rows > _ONE else _ONE
            smooth = block[_U(at.SMOOTH + i)]
            x = _wrapped(block[_U(at.U + i)], wrap[0]) * columns - _HALF * smooth
            y = _wrapped(block[_U(at.V + i)], wrap[1]) * rows - _HALF * smooth
            left, top = floor(x), floor(y)
            block[_U(at.ACROSS + k * at.WIDTH + i)] = (x - left) * smooth
            block[_U(at.DOWN + k * at.WIDTH + i)] = (y - top) * smooth
            left = left if left < columns - _ONE + smooth else columns - _ONE
            top = top if top < rows - _ONE + smooth else rows - _ONE
            stride = np.int32(columns) + 2
            whole[_U(at.TEXEL + k * at.WIDTH + i)] = np.int32(top) * stride + np.int32(left)
            whole[_U(at.STRIDE + k * at.WIDTH + i)] = stride


@kernel
def _read(
    block: Float32, whole: Int32, run: Run, texels: Texels, levels: Table, table: tuple[int, int]
) -> None:  # fmt: skip
    """Mix the texels of each point; `table` has the texture's first and last level."""
    for i in range(run[0], run[1]):
        level = table[0] + int(block[at.LEVEL + i])
        here = levels[level, 0] + whole[at.TEXEL + i]
        below = here + whole[at.STRIDE + i]
        rgba = _blend(texels, here, below, block[at.ACROSS + i], block[at.DOWN + i])
        part = block[at.NEXT + i]
        if part > _ZERO:
            j = at.WIDTH + i
            here = levels[min(level + 1, table[1]), 0] + whole[at.TEXEL + j]
            below = here + whole[at.STRIDE + j]
            coarser = _blend(texels, here, below, block[at.ACROSS + j], block[at.DOWN + j])
            rgba = rgba + (coarser - rgba) * splat(part)
        block[at.TEXEL_R + i], block[at.TEXEL_G + i] = lane(rgba, 0), lane(rgba, 1)
        block[at.TEXEL_B + i], block[at.TEXEL_A + i] = lane(rgba, 2), lane(rgba, 3)


@kernel
def sample(
    block: Float32, whole: Int32, run: Run, atlas: tuple[Texels, Table, Table], texture: int
) -> None:  # fmt: skip
    """Fill in a texture's colours, linear RGBA, at a run of points of a block.

    Args:
        block: changed: coordinates and their change are read, `TEXEL_R` to `TEXEL_A` written.
        whole: changed.
        run: which points.
        atlas: texels, levels and table of an `Atlas`.
        texture: which texture.
    """
    texels, levels, table = atlas
    mag, least, base = table[texture, _MAG], table[texture, _MIN], table[texture, _FIRST]
    last = table[texture, _COUNT] - 1
    edge = _ONE
    if mag == LINEAR and (least == _NEAREST_OF_NEAREST or least == _NEAREST_OF_TWO):
        edge = _TWO
    smooth = least == LINEAR or least == _LINEAR_OF_NEAREST or least > _NEAREST_OF_TWO
    one = least == _NEAREST_OF_NEAREST or least == _LINEAR_OF_NEAREST
    rule = (
        to_f32(levels[base, 1]), to_f32(levels[base, 2]), to_f32(last), edge, mag == LINEAR,
        smooth, one,
    )  # fmt: skip
    _choose_levels(block, run, rule)
    _choose_texels(block, whole, run, rule, (table[texture, _WRAP_S], table[texture, _WRAP_T]))
    _read(block, whole, run, texels, levels, (base, base + last))
