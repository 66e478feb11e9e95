"""Four float32 numbers as one value inside compiled kernels: a vector register, by name.

numba makes vector instructions of loops over long arrays only. What is worked out point by point,
from four numbers here and four there, it takes one by one; with these it does not.
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
_signature: Any = signature
_register: Any = infer_global
_lower: Any = lower_builtin
_initialise: Any = types.Type.__init__
_hold: Any = PrimitiveModel.__init__
Generator = tuple[Any, Callable[..., Any]]
_INT32 = ir.IntType(32)
FLOATS = ir.VectorType(ir.FloatType(), 4)
_ORDER = ir.VectorType(_INT32, 4)
FUSED = ("contract",)  # a product and a sum may be rounded once in the place of twice


def instruction(generator: Callable[..., Generator]) -> Any:  # noqa: ANN401
    """Make a generator of LLVM's code a function that kernels call; to a type checker, of anything.

    Args:
        generator: `numba.extending.intrinsic` says what it gets and returns.
    """
    return intrinsic(generator)


class _Float4(types.Type):
    """The type of four numbers, to numba."""

    def __init__(self) -> None:
        _initialise(self, name="Float4")


FLOAT4 = _Float4()


@register_default(_Float4)
class _Float4Model(PrimitiveModel):
    """Held as a vector of LLVM's."""

    def __init__(self, manager: object, kind: object) -> None:
        _hold(self, manager, kind, FLOATS)


def spread(builder: Any, value: Any) -> Any:  # noqa: ANN401
    """LLVM's code for a number in all four lanes."""
    one = builder.insert_element(ir.Constant(FLOATS, ir.Undefined), value, _INT32(0))
    return builder.shuffle_vector(one, one, ir.Constant(_ORDER, [0] * 4))


@instruction
def row(_: Any, values: Any, index: Any) -> Generator:  # noqa: ANN401
    """Compile: row `index` >= 0 of contiguous float32 values (n, 4)."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:  # noqa: ANN401
        data = context.make_array(signature.args[0])(context, builder, given[0]).data
        at = builder.gep(data, [builder.shl(given[1], given[1].type(2))])
        return builder.load(builder.bitcast(at, FLOATS.as_pointer()), align=4)

    return FLOAT4(values, types.intp), generate


@instruction
def put_row(_: Any, values: Any, index: Any, numbers: Any) -> Generator:  # noqa: ANN401
    """Compile: write row `index` >= 0 of contiguous float32 values (n, 4)."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:  # noqa: ANN401
        data = context.make_array(signature.args[0])(context, builder, given[0]).data
        at = builder.gep(data, [builder.shl(given[1], given[1].type(2))])
        builder.store(given[2], builder.bitcast(at, FLOATS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(values, types.intp, numbers), generate


@instruction
def all_of(_: Any, value: Any) -> Generator:  # noqa: ANN401
    """Compile: a number four times."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:  # noqa: ANN401
        return spread(builder, given[0])

    return FLOAT4(types.float32), generate


@instruction
def four(_: Any, a: Any, b: Any, c: Any, d: Any) -> Generator:  # noqa: ANN401
    """Compile: four numbers as one value."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:  # noqa: ANN401
        made = ir.Constant(FLOATS, ir.Undefined)
        for lane, value in enumerate(given):
            made = builder.insert_element(made, value, _INT32(lane))
        return made

    return FLOAT4(*(types.float32,) * 4), generate


@instruction
def lane(_: Any, numbers: Any, index: Any) -> Generator:  # noqa: ANN401
    """Compile: one of the four numbers."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:  # noqa: ANN401
        return builder.extract_element(given[0], builder.trunc(given[1], _INT32))

    return types.float32(numbers, types.intp), generate


class _Arithmetic(ConcreteTemplate):
    """Of four numbers and four numbers, four numbers."""

    cases = (_signature(FLOAT4, FLOAT4, FLOAT4),)


def _define(symbol: object, name: str) -> None:
    """Compile an operator between such values as an instruction of LLVM's."""

    def generate(_: Any, builder: Any, __: Any, given: Any) -> Any:  # noqa: ANN401
        return getattr(builder, name)(*given, flags=FUSED)

    _register(symbol)(_Arithmetic)
    _lower(symbol, FLOAT4, FLOAT4)(generate)


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_symbol, _name)
