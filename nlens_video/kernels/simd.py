"""Hand-written vector code: LLVM vectors of fixed width as values inside compiled kernels.

numba vectorises plain loops over long arrays only. Work on four numbers here and four there it does
number by number, and sums over many steps it keeps in memory; these intrinsics keep both in vector
registers. All LLVM code of the package is here. Each docstring gives the NumPy expression that the
intrinsic equals, and `tests/kernels/test_simd.py` compares both. The last three are operations of
single kernels: the scatter's spans, the rasteriser's runs, texel filtering.

Arrays are contiguous; indices are flat and not negative, unless stated; nothing checks bounds.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.datamodel.registry import register_default
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin

# `Any` throughout: numba's and llvmlite's code generators have no types of their own, and to a type
# checker a kernel is plain Python, in which vector values do not exist.
Float4 = Any
_signature: Any = signature
_register: Any = infer_global
_lower: Any = lower_builtin
_init_type: Any = types.Type.__init__
_init_model: Any = PrimitiveModel.__init__

Emit = Callable[..., Any]
Typed = tuple[Any, Emit]
"""What `numba.extending.intrinsic` expects: a signature, and a function that emits LLVM code."""
DRAW_LANES = 16  # samples that `draw_samples` reads and writes, whatever `count` is
_F32, _I16, _I32 = ir.FloatType(), ir.IntType(16), ir.IntType(32)
_CONTRACT = ("contract",)  # a product and a sum may be rounded once (fused multiply-add)


class _Vector(types.Type):
    """numba's type of a vector of `count` numbers."""

    def __init__(self, name: str, kind: Any, count: int) -> None:
        self.llvm = ir.VectorType(kind, count)
        _init_type(self, name=name)


FLOAT4, FLOAT8, FLOAT16 = (_Vector(f"Float{count}", _F32, count) for count in (4, 8, 16))
DOUBLE8 = _Vector("Double8", ir.DoubleType(), 8)


@register_default(_Vector)
class _VectorModel(PrimitiveModel):
    """Held as one LLVM vector."""

    def __init__(self, manager: object, kind: _Vector) -> None:
        _init_model(self, manager, kind, kind.llvm)


def instruction(definition: Callable[..., Typed]) -> Any:
    """Make a definition an intrinsic, which kernels call and type checkers take as Any."""
    return intrinsic(definition)


def of_values(emit: Emit) -> Emit:
    """Lower an intrinsic of numbers and vectors by `emit(builder, *values)`."""

    def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
        return emit(builder, *values)

    return generate


def of_arrays(emit: Emit) -> Emit:
    """Lower an intrinsic that takes arrays by `emit(builder, pointer, *values)`.

    `pointer(n, index, vector)` is the address of a vector in the array that is argument `n`.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        def pointer(n: int, index: Any, vector: Any) -> Any:
            data = context.make_array(signature.args[n])(context, builder, values[n]).data
            return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())

        result = emit(builder, pointer, *values)
        return context.get_dummy_value() if result is None else result

    return generate


def shuffle(builder: Any, one: Any, other: Any, lanes: Any) -> Any:
    """Emit `np.concatenate([one, other])[lanes]`."""
    order = ir.Constant(ir.VectorType(_I32, len(lanes)), list(lanes))
    return builder.shuffle_vector(one, other, order)


def broadcast(builder: Any, value: Any, count: int) -> Any:
    """Emit `np.full(count, value)`."""
    empty = ir.Constant(ir.VectorType(value.type, count), ir.Undefined)
    one = builder.insert_element(empty, value, _I32(0))
    return shuffle(builder, one, one, [0] * count)


def _named(definition: Any, name: str) -> Any:
    definition.__name__ = definition.__qualname__ = name
    return instruction(definition)


def _load(kind: _Vector, name: str) -> Any:
    """Load float32 numbers: `values.flat[index : index + count]`."""

    def load(_: Any, values: Any, index: Any) -> Typed:
        def emit(builder: Any, pointer: Any, _: Any, index: Any) -> Any:
            return builder.load(pointer(0, index, kind.llvm), align=4)

        return kind(values, types.intp), of_arrays(emit)

    return _named(load, name)


def _store(kind: _Vector, name: str) -> Any:
    """Store float32 numbers: `values.flat[index : index + count] = numbers`."""

    def store(_: Any, values: Any, index: Any, numbers: Any) -> Typed:
        def emit(builder: Any, pointer: Any, _: Any, index: Any, numbers: Any) -> None:
            builder.store(numbers, pointer(0, index, kind.llvm), align=4)

        return types.void(values, types.intp, numbers), of_arrays(emit)

    return _named(store, name)


def _splat(kind: _Vector, name: str) -> Any:
    """Repeat a float32 number: `np.full(count, value)`."""

    def splat(_: Any, value: Any) -> Typed:
        emit = of_values(lambda builder, v: broadcast(builder, v, kind.llvm.count))
        return kind(types.float32), emit

    return _named(splat, name)


load4, store4, splat = _load(FLOAT4, "load4"), _store(FLOAT4, "store4"), _splat(FLOAT4, "splat")
load8 = _load(FLOAT8, "load8")
load16, store16 = _load(FLOAT16, "load16"), _store(FLOAT16, "store16")
splat16 = _splat(FLOAT16, "splat16")


@instruction
def pack4(_: Any, a: Any, b: Any, c: Any, d: Any) -> Typed:
    """`np.array([a, b, c, d])`, float32."""

    def emit(builder: Any, *values: Any) -> Any:
        made = ir.Constant(FLOAT4.llvm, ir.Undefined)
        for at, value in enumerate(values):
            made = builder.insert_element(made, value, _I32(at))
        return made

    return FLOAT4(*(types.float32,) * 4), of_values(emit)


@instruction
def lane(_: Any, numbers: Any, index: Any) -> Typed:
    """`numbers[index]`, float32."""
    emit = of_values(lambda builder, v, index: builder.extract_element(v, index))
    return types.float32(numbers, types.intp), emit


@instruction
def low4(_: Any, numbers: Any) -> Typed:
    """`numbers[:4]` of eight."""
    return FLOAT4(FLOAT8), of_values(lambda builder, v: shuffle(builder, v, v, range(4)))


@instruction
def to_f64(_: Any, numbers: Any) -> Typed:
    """`numbers.astype(np.float64)` of eight."""
    return DOUBLE8(FLOAT8), of_values(lambda builder, v: builder.fpext(v, DOUBLE8.llvm))


@instruction
def to_f32x8(_: Any, numbers: Any) -> Typed:
    """`numbers.astype(np.float32)` of eight float64."""
    return FLOAT8(DOUBLE8), of_values(lambda builder, v: builder.fptrunc(v, FLOAT8.llvm))


@instruction
def select_gt(_: Any, one: Any, other: Any, if_greater: Any, if_not: Any) -> Typed:
    """`np.where(one > other, if_greater, if_not)`."""

    def emit(builder: Any, one: Any, other: Any, if_greater: Any, if_not: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", one, other), if_greater, if_not)

    return one(one, other, if_greater, if_not), of_values(emit)


class _Arithmetic(ConcreteTemplate):
    """`+`, `-`, `*`, `/` of two vectors of one type, as NumPy's but for fused multiply-add."""

    cases = tuple(_signature(kind, kind, kind) for kind in (FLOAT4, FLOAT8, FLOAT16, DOUBLE8))


def _define(symbol: object, operation: str) -> None:
    def emit(builder: Any, one: Any, other: Any) -> Any:
        return getattr(builder, operation)(one, other, flags=_CONTRACT)

    _register(symbol)(_Arithmetic)
    for case in _Arithmetic.cases:
        _lower(symbol, *case.args)(of_values(emit))


_define(operator.add, "fadd")
_define(operator.sub, "fsub")
_define(operator.mul, "fmul")
_define(operator.truediv, "fdiv")


@instruction
def add_span_end(_: Any, sums: Any, at: Any, rgba: Any, x: Any, here: Any, further: Any) -> Typed:
    """Add one end of a span to a difference buffer, between two columns.

    With `light = [*rgba[x], 1, 0, 0, 0]`: `sums[at, :8] += here * light` and
    `sums[at, 8:] += further * light`; sums (n, 16), rgba (w, 4), float32. The upper half counts one
    column further on, so that neighbouring columns do not wait for each other's sums.
    """

    def emit(builder: Any, pointer: Any, *values: Any) -> None:
        _, at, _, x, here, further = values
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

    def emit(builder: Any, pointer: Any, *values: Any) -> None:
        at, count, start, slope, number = values[2:]
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

    def emit(builder: Any, pointer: Any, *values: Any) -> Any:
        _, upper, lower, across, down = values

        def pair(index: Any) -> Any:
            first = builder.shl(index, index.type(2))
            codes = builder.load(pointer(0, first, ir.VectorType(_I16, 8)), align=2)
            return builder.uitofp(codes, FLOAT8.llvm)

        def mix(one: Any, other: Any, part: Any) -> Any:
            away = builder.fsub(other, one, flags=_CONTRACT)
            return builder.fadd(one, builder.fmul(away, part, flags=_CONTRACT), flags=_CONTRACT)

        both = mix(pair(upper), pair(lower), broadcast(builder, down, 8))
        left, right = (shuffle(builder, both, both, range(k, k + 4)) for k in (0, 4))
        mixed = mix(left, right, broadcast(builder, across, 4))
        return builder.fmul(mixed, ir.Constant(FLOAT4.llvm, [1.0 / 65535.0] * 4))

    kinds = texels, types.intp, types.intp, types.float32, types.float32
    return FLOAT4(*kinds), of_arrays(emit)
