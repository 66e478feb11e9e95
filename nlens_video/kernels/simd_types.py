"""Four, eight or sixteen numbers as one value inside compiled kernels: a vector, by name.

numba makes vector instructions of plain loops over long arrays only. What is worked out point by
point from four numbers here and four there it takes one by one, and what is summed over many steps
it keeps in memory; with these it does not.
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
# checker a kernel is plain Python, in which the values below do not exist.
Float4 = Any
Float8 = Any
Double8 = Any
Float16 = Any
_signature: Any = signature
_register: Any = infer_global
_lower: Any = lower_builtin
_initialise: Any = types.Type.__init__
_hold: Any = PrimitiveModel.__init__

Generator = tuple[Any, Callable[..., Any]]
_INT32 = ir.IntType(32)
FUSED = ("contract",)  # a product and a sum may be rounded once in the place of twice


def instruction(generator: Callable[..., Generator]) -> Any:
    """Make a generator of LLVM's code a function that kernels call; to a type checker, of anything.

    Args:
        generator: `numba.extending.intrinsic` says what it gets and returns.
    """
    return intrinsic(generator)


class _Lanes(types.Type):
    """The type of so many numbers, to numba."""

    def __init__(self, name: str, kind: Any, count: int) -> None:
        self.count = count
        self.vector = ir.VectorType(kind, count)
        _initialise(self, name=name)


FLOAT4, FLOAT8 = _Lanes("Float4", ir.FloatType(), 4), _Lanes("Float8", ir.FloatType(), 8)
FLOAT16, DOUBLE8 = _Lanes("Float16", ir.FloatType(), 16), _Lanes("Double8", ir.DoubleType(), 8)
FLOATS = FLOAT4.vector
_KINDS = (FLOAT4, FLOAT8, FLOAT16, DOUBLE8)


@register_default(_Lanes)
class _LanesModel(PrimitiveModel):
    """Held as a vector of LLVM's."""

    def __init__(self, manager: object, kind: _Lanes) -> None:
        _hold(self, manager, kind, kind.vector)


def spread(builder: Any, value: Any, count: int = 4) -> Any:
    """LLVM's code for a number in all of so many lanes."""
    empty = ir.Constant(ir.VectorType(ir.FloatType(), count), ir.Undefined)
    one = builder.insert_element(empty, value, _INT32(0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(_INT32, count), [0] * count))


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Any) -> Any:
    """Address of the numbers of a contiguous array from the flat index `index` on."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


@instruction
def row(_: Any, values: Any, index: Any) -> Generator:
    """Compile: row `index` >= 0 of contiguous float32 values (n, 4)."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        first = builder.shl(given[1], given[1].type(2))
        at = _address(context, builder, signature.args[0], given[0], first, FLOATS)
        return builder.load(at, align=4)

    return FLOAT4(values, types.intp), generate


def _read(kind: _Lanes, name: str) -> Any:
    """Make what reads numbers of a contiguous float32 array from a flat index >= 0 on."""

    def read(_: Any, values: Any, index: Any) -> Generator:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            at = _address(context, builder, signature.args[0], given[0], given[1], kind.vector)
            return builder.load(at, align=4)

        return kind(values, types.intp), generate

    read.__name__ = read.__qualname__ = name
    return instruction(read)


def _write(kind: _Lanes, name: str) -> Any:
    """Make what writes numbers to a contiguous float32 array from a flat index >= 0 on."""

    def write(_: Any, values: Any, index: Any, numbers: Any) -> Generator:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            at = _address(context, builder, signature.args[0], given[0], given[1], kind.vector)
            builder.store(given[2], at, align=4)
            return context.get_dummy_value()

        return types.void(values, types.intp, numbers), generate

    write.__name__ = write.__qualname__ = name
    return instruction(write)


four_at, store4 = _read(FLOAT4, "four_at"), _write(FLOAT4, "store4")
eight_at = _read(FLOAT8, "eight_at")
sixteen, put_sixteen = _read(FLOAT16, "sixteen"), _write(FLOAT16, "put_sixteen")


@instruction
def splat(_: Any, value: Any) -> Generator:
    """Compile: a number four times."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return spread(builder, given[0])

    return FLOAT4(types.float32), generate


@instruction
def all_sixteen(_: Any, value: Any) -> Generator:
    """Compile: a number sixteen times."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return spread(builder, given[0], FLOAT16.count)

    return FLOAT16(types.float32), generate


@instruction
def four(_: Any, a: Any, b: Any, c: Any, d: Any) -> Generator:
    """Compile: four numbers as one value."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        made = ir.Constant(FLOATS, ir.Undefined)
        for at, value in enumerate(given):
            made = builder.insert_element(made, value, _INT32(at))
        return made

    return FLOAT4(*(types.float32,) * 4), generate


@instruction
def lane(_: Any, numbers: Any, index: Any) -> Generator:
    """Compile: one of the numbers."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return builder.extract_element(given[0], builder.trunc(given[1], _INT32))

    return types.float32(numbers, types.intp), generate


@instruction
def lower(_: Any, numbers: Any) -> Generator:
    """Compile: the first four of eight."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        order = ir.Constant(ir.VectorType(_INT32, 4), [0, 1, 2, 3])
        return builder.shuffle_vector(given[0], given[0], order)

    return FLOAT4(FLOAT8), generate


@instruction
def to_f64(_: Any, numbers: Any) -> Generator:
    """Compile: eight numbers as float64."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return builder.fpext(given[0], DOUBLE8.vector)

    return DOUBLE8(FLOAT8), generate


@instruction
def narrowed(_: Any, numbers: Any) -> Generator:
    """Compile: eight float64 numbers as float32."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return builder.fptrunc(given[0], FLOAT8.vector)

    return FLOAT8(DOUBLE8), generate


@instruction
def select_gt(_: Any, one: Any, other: Any, if_greater: Any, if_not: Any) -> Generator:
    """Compile: lane by lane, `if_greater` where `one` > `other`, else `if_not`."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", given[0], given[1]), given[2], given[3])

    return one(one, other, if_greater, if_not), generate


class _Arithmetic(ConcreteTemplate):
    """Of two values of as many numbers, one."""

    cases = tuple(_signature(kind, kind, kind) for kind in _KINDS)


def _define(symbol: object, name: str) -> None:
    """Compile an operator between such values as an instruction of LLVM's."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return getattr(builder, name)(*given, flags=FUSED)

    _register(symbol)(_Arithmetic)
    for kind in _KINDS:
        _lower(symbol, kind, kind)(generate)


_OPERATORS = (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")
for _symbol, _name in (*_OPERATORS, (operator.truediv, "fdiv")):
    _define(_symbol, _name)


LANES = 8
_FLOAT, _INT32 = ir.FloatType(), ir.IntType(32)
_Generator = tuple[Any, Callable[..., Any]]


def _row(context: Any, builder: Any, kind: Any, array: Any, index: Any, width: int) -> Any:
    """Address of row `index`, `width` numbers, of a contiguous array."""
    data = context.make_array(kind)(context, builder, array).data
    start = builder.gep(data, [builder.mul(index, index.type(width))])
    return builder.bitcast(start, ir.VectorType(_FLOAT, width).as_pointer())


def _shuffle(builder: Any, first: Any, second: Any, lanes: list[int]) -> Any:
    order = ir.Constant(ir.VectorType(_INT32, len(lanes)), lanes)
    return builder.shuffle_vector(first, second, order)


def _light(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """A pixel's lanes: its colour and alpha, weight 1."""
    pixel = builder.load(_row(context, builder, kind, array, index, 4), align=4)
    one = ir.Constant(pixel.type, [1.0, 0.0, 0.0, 0.0])
    return _shuffle(builder, pixel, one, list(range(LANES)))


def _times(builder: Any, lanes: Any, factor: Any) -> Any:
    single = builder.insert_element(ir.Constant(lanes.type, ir.Undefined), factor, _INT32(0))
    return builder.fmul(lanes, _shuffle(builder, single, single, [0] * LANES))


def _add(builder: Any, sums: Any, lanes: Any) -> None:
    builder.store(builder.fadd(builder.load(sums, align=4), lanes), sums, align=4)


@intrinsic
def add_end(
    _: Any, sums: Any, at: Any, pixels: Any, x: Any, here: Any, further: Any
) -> _Generator:  # fmt: skip
    """Compile adding an end of a span between two places; sums (n, 16), pixels (w, 4) float32.

    The upper lanes count one place further on, so that neighbours in a row do not wait for each
    other's sums.
    """

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        light = _light(context, builder, signature.args[2], given[2], given[3])
        place = _row(context, builder, signature.args[0], given[0], given[1], 2 * LANES)
        both = _times(builder, light, given[4]), _times(builder, light, given[5])
        _add(builder, place, _shuffle(builder, *both, list(range(2 * LANES))))
        return context.get_dummy_value()

    kinds = sums, types.intp, pixels, types.intp, types.float32, types.float32
    return types.void(*kinds), generate
