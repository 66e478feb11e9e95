"""Hand-written vector code: LLVM vectors of fixed width as values inside compiled kernels.

numba vectorises plain loops over long arrays only. Work on four numbers here and four there it does
number by number, and sums over many steps it keeps in memory; these intrinsics keep both in vector
registers. All LLVM code of the package is here and in `simd_operations`. Each docstring gives the
NumPy expression that the intrinsic equals, and `tests/kernels/test_simd.py` compares both.

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
_F32, _I32 = ir.FloatType(), ir.IntType(32)
CONTRACT = ("contract",)  # a product and a sum may be rounded once (fused multiply-add)


def instruction(definition: Callable[..., Typed]) -> Any:
    """Make a definition an intrinsic, which kernels call and type checkers take as Any."""
    return intrinsic(definition)


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
        def pointer(argument: int, index: Any, vector: Any) -> Any:
            array = context.make_array(signature.args[argument])
            data = array(context, builder, values[argument]).data
            return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())

        result = emit(builder, pointer, *values)
        return context.get_dummy_value() if result is None else result

    return generate


def shuffle(builder: Any, one: Any, other: Any, lanes: Any) -> Any:
    """Emit `np.concatenate([one, other])[lanes]`."""
    order = list(lanes)
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_I32, len(order)), order))


def broadcast(builder: Any, value: Any, count: int) -> Any:
    """Emit `np.full(count, value)`."""
    empty = ir.Constant(ir.VectorType(value.type, count), ir.Undefined)
    one = builder.insert_element(empty, value, _I32(0))
    return shuffle(builder, one, one, [0] * count)


@instruction
def load_row4(_: Any, values: Any, index: Any) -> Typed:
    """Row of four float32: `values[index]` of values (n, 4)."""

    def emit(builder: Any, pointer: Any, _: Any, index: Any) -> Any:
        first = builder.shl(index, index.type(2))
        return builder.load(pointer(0, first, FLOAT4.llvm), align=4)

    return FLOAT4(values, types.intp), of_arrays(emit)


def _load(kind: _Vector, name: str) -> Any:
    """Load float32 numbers: `values.flat[index : index + count]`."""

    def load(_: Any, values: Any, index: Any) -> Typed:
        def emit(builder: Any, pointer: Any, _: Any, index: Any) -> Any:
            return builder.load(pointer(0, index, kind.llvm), align=4)

        return kind(values, types.intp), of_arrays(emit)

    load.__name__ = load.__qualname__ = name
    return instruction(load)


def _store(kind: _Vector, name: str) -> Any:
    """Store float32 numbers: `values.flat[index : index + count] = numbers`."""

    def store(_: Any, values: Any, index: Any, numbers: Any) -> Typed:
        def emit(builder: Any, pointer: Any, _: Any, index: Any, numbers: Any) -> None:
            builder.store(numbers, pointer(0, index, kind.llvm), align=4)

        return types.void(values, types.intp, numbers), of_arrays(emit)

    store.__name__ = store.__qualname__ = name
    return instruction(store)


load4, store4 = _load(FLOAT4, "load4"), _store(FLOAT4, "store4")
load8 = _load(FLOAT8, "load8")
load16, store16 = _load(FLOAT16, "load16"), _store(FLOAT16, "store16")


@instruction
def splat(_: Any, value: Any) -> Typed:
    """`np.full(4, value)`, float32."""
    return FLOAT4(types.float32), of_values(lambda builder, v: broadcast(builder, v, 4))


@instruction
def splat16(_: Any, value: Any) -> Typed:
    """`np.full(16, value)`, float32."""
    return FLOAT16(types.float32), of_values(lambda builder, v: broadcast(builder, v, 16))


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

    def emit(builder: Any, numbers: Any, index: Any) -> Any:
        return builder.extract_element(numbers, builder.trunc(index, _I32))

    return types.float32(numbers, types.intp), of_values(emit)


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


def _define(symbol: object, instruction: str) -> None:
    def emit(builder: Any, one: Any, other: Any) -> Any:
        return getattr(builder, instruction)(one, other, flags=CONTRACT)

    _register(symbol)(_Arithmetic)
    for case in _Arithmetic.cases:
        _lower(symbol, *case.args)(of_values(emit))


_define(operator.add, "fadd")
_define(operator.sub, "fsub")
_define(operator.mul, "fmul")
_define(operator.truediv, "fdiv")
