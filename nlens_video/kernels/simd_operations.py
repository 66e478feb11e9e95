"""Vector operations of single kernels: the scatter's spans, the rasteriser's runs, texel mixing.

Conventions are those of `simd`: contiguous arrays, flat indices, no bounds checks; each docstring
gives the NumPy expression that the intrinsic equals.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

from nlens_video.kernels.simd import (
    CONTRACT,
    FLOAT4,
    FLOAT8,
    FLOAT16,
    Typed,
    broadcast,
    instruction,
    of_arrays,
    of_values,
    shuffle,
)

_F32, _I16, _I32 = ir.FloatType(), ir.IntType(16), ir.IntType(32)
_BIAS, _FRACTION_BITS = 127, 23  # of a float32
DRAW_LANES = 16
"""Samples that `draw_samples` reads and writes, whatever `count` is."""


@instruction
def add_span_end(_: Any, sums: Any, at: Any, rgba: Any, x: Any, here: Any, further: Any) -> Typed:
    """Add one end of a span to a difference buffer, between two columns.

    With `light = [*rgba[x], 1, 0, 0, 0]`: `sums[at, :8] += here * light` and
    `sums[at, 8:] += further * light`; sums (n, 16), rgba (w, 4), float32. The upper half counts one
    column further on, so that neighbouring columns do not wait for each other's sums.
    """

    def emit(
        builder: Any, pointer: Any, _: Any, at: Any, __: Any, x: Any, here: Any, further: Any
    ) -> None:
        pixel = builder.load(pointer(2, builder.mul(x, x.type(4)), FLOAT4.llvm), align=4)
        one = ir.Constant(pixel.type, [1.0, 0.0, 0.0, 0.0])
        light = shuffle(builder, pixel, one, range(8))
        place = pointer(0, builder.mul(at, at.type(16)), FLOAT16.llvm)
        both = [builder.fmul(light, broadcast(builder, part, 8)) for part in (here, further)]
        added = builder.fadd(
            builder.load(place, align=4), shuffle(builder, both[0], both[1], range(16))
        )
        builder.store(added, place, align=4)

    kinds = sums, types.intp, rgba, types.intp, types.float32, types.float32
    return types.void(*kinds), of_arrays(emit)


@instruction
def draw_samples(
    _: Any, disparity: Any, ids: Any, at: Any, count: Any, start: Any, slope: Any, number: Any
) -> Typed:  # fmt: skip
    """Depth test and write of a run of at most `DRAW_LANES` samples.

    With `i = np.arange(min(count, 16))` and `mine = start + slope * i`: where
    `mine >= disparity.flat[at + i]`, disparity becomes `mine` and `ids.flat[at + i]` `number`.
    """

    def emit(
        builder: Any, pointer: Any, _: Any, __: Any, at: Any, count: Any, start: Any, slope: Any,
        number: Any,
    ) -> None:  # fmt: skip
        ints = ir.VectorType(_I32, DRAW_LANES)
        near, shown = pointer(0, at, FLOAT16.llvm), pointer(1, at, ints)
        start, slope, count, number = (
            broadcast(builder, value, DRAW_LANES) for value in (start, slope, count, number)
        )
        ramp = ir.Constant(FLOAT16.llvm, [float(i) for i in range(DRAW_LANES)])
        mine = builder.fadd(start, builder.fmul(ramp, slope))
        inside = builder.icmp_signed("<", ir.Constant(ints, list(range(DRAW_LANES))), count)
        before = builder.load(near, align=4)
        drawn = builder.and_(inside, builder.fcmp_ordered(">=", mine, before))
        builder.store(builder.select(drawn, mine, before), near, align=4)
        builder.store(builder.select(drawn, number, builder.load(shown, align=4)), shown, align=4)

    kinds = disparity, ids, types.intp, types.int32, types.float32, types.float32, types.int32
    return types.void(*kinds), of_arrays(emit)


@instruction
def bilinear4(_: Any, texels: Any, upper: Any, lower: Any, across: Any, down: Any) -> Typed:
    """RGBA between four 16-bit texels, as float32 in [0, 1].

    With `t = texels.reshape(-1, 4) / 65535`: `t[upper]` and `t[lower]` mixed by `down`, likewise
    the texels to the right of them, `t[upper + 1]` and `t[lower + 1]`; both results by `across`.
    """

    def emit(
        builder: Any, pointer: Any, _: Any, upper: Any, lower: Any, across: Any, down: Any
    ) -> Any:
        def pair(index: Any) -> Any:
            first = builder.shl(index, index.type(2))
            codes = builder.load(pointer(0, first, ir.VectorType(_I16, 8)), align=2)
            return builder.uitofp(codes, FLOAT8.llvm)

        def mix(one: Any, other: Any, part: Any) -> Any:
            away = builder.fsub(other, one, flags=CONTRACT)
            return builder.fadd(one, builder.fmul(away, part, flags=CONTRACT), flags=CONTRACT)

        both = mix(pair(upper), pair(lower), broadcast(builder, down, 8))
        left, right = (shuffle(builder, both, both, range(k, k + 4)) for k in (0, 4))
        mixed = mix(left, right, broadcast(builder, across, 4))
        return builder.fmul(mixed, ir.Constant(FLOAT4.llvm, [1.0 / 65535.0] * 4))

    kinds = texels, types.intp, types.intp, types.float32, types.float32
    return FLOAT4(*kinds), of_arrays(emit)


@instruction
def exponent(_: Any, value: Any) -> Typed:
    """`np.floor(np.log2(value))` of a positive, normal float32, as float32."""

    def emit(builder: Any, value: Any) -> Any:
        bits = builder.lshr(builder.bitcast(value, _I32), _I32(_FRACTION_BITS))
        return builder.sitofp(builder.sub(bits, _I32(_BIAS)), _F32)

    return types.float32(types.float32), of_values(emit)


@instruction
def significand(_: Any, value: Any) -> Typed:
    """`value / 2**exponent(value)` of a positive, normal float32, in [1, 2)."""

    def emit(builder: Any, value: Any) -> Any:
        bits = builder.and_(builder.bitcast(value, _I32), _I32((1 << _FRACTION_BITS) - 1))
        return builder.bitcast(builder.or_(bits, _I32(_BIAS << _FRACTION_BITS)), _F32)

    return types.float32(types.float32), of_values(emit)


@instruction
def half_power(_: Any, power: Any) -> Typed:
    """`0.5 ** power` of a whole number from 0 to 126, given as float32."""

    def emit(builder: Any, power: Any) -> Any:
        bits = builder.sub(_I32(_BIAS), builder.fptosi(power, _I32))
        return builder.bitcast(builder.shl(bits, _I32(_FRACTION_BITS)), _F32)

    return types.float32(types.float32), of_values(emit)
