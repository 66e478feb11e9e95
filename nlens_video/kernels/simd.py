"""Adding to sixteen sums at once, which numba by itself does one by one.

The lanes of a sum are red, green, blue, alpha, weight, and three that stay 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

LANES = 8
_FLOAT, _INT32 = ir.FloatType(), ir.IntType(32)
_Generator = tuple[Any, Callable[..., Any]]


def _row(context: Any, builder: Any, kind: Any, array: Any, index: Any, width: int) -> Any:  # noqa: ANN401
    """Address of row `index`, `width` numbers, of a contiguous array."""
    data = context.make_array(kind)(context, builder, array).data
    start = builder.gep(data, [builder.mul(index, index.type(width))])
    return builder.bitcast(start, ir.VectorType(_FLOAT, width).as_pointer())


def _shuffle(builder: Any, first: Any, second: Any, lanes: list[int]) -> Any:  # noqa: ANN401
    order = ir.Constant(ir.VectorType(_INT32, len(lanes)), lanes)
    return builder.shuffle_vector(first, second, order)


def _light(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:  # noqa: ANN401
    """A pixel's lanes: its colour and alpha, weight 1."""
    pixel = builder.load(_row(context, builder, kind, array, index, 4), align=4)
    one = ir.Constant(pixel.type, [1.0, 0.0, 0.0, 0.0])
    return _shuffle(builder, pixel, one, list(range(LANES)))


def _times(builder: Any, lanes: Any, factor: Any) -> Any:  # noqa: ANN401
    single = builder.insert_element(ir.Constant(lanes.type, ir.Undefined), factor, _INT32(0))
    return builder.fmul(lanes, _shuffle(builder, single, single, [0] * LANES))


def _add(builder: Any, sums: Any, lanes: Any) -> None:  # noqa: ANN401
    builder.store(builder.fadd(builder.load(sums, align=4), lanes), sums, align=4)


@intrinsic
def add_end(
    _: Any, sums: Any, at: Any, pixels: Any, x: Any, here: Any, further: Any  # noqa: ANN401
) -> _Generator:  # fmt: skip
    """Compile adding an end of a span between two places; sums (n, 16), pixels (w, 4) float32.

    The upper lanes count one place further on, so that neighbours in a row do not wait for each
    other's sums.
    """

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:  # noqa: ANN401
        light = _light(context, builder, signature.args[2], given[2], given[3])
        place = _row(context, builder, signature.args[0], given[0], given[1], 2 * LANES)
        both = _times(builder, light, given[4]), _times(builder, light, given[5])
        _add(builder, place, _shuffle(builder, *both, list(range(2 * LANES))))
        return context.get_dummy_value()

    kinds = sums, types.intp, pixels, types.intp, types.float32, types.float32
    return types.void(*kinds), generate
