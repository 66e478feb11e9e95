"""Sixteen samples of a line drawn at once: numba would take short runs sample by sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

LANES = 16
_FLOATS, _INTS = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(ir.IntType(32), LANES)
_Generator = tuple[Any, Callable[..., Any]]
# `Any` throughout: numba's and llvmlite's code generators have no types of their own.


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any, lanes: Any) -> Any:  # noqa: ANN401
    """Address of sixteen numbers of a contiguous array, from the flat index `index` on."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), lanes.as_pointer())


def _all(builder: Any, lanes: Any, value: Any) -> Any:  # noqa: ANN401
    single = builder.insert_element(ir.Constant(lanes, ir.Undefined), value, ir.IntType(32)(0))
    order = ir.Constant(_INTS, [0] * LANES)
    return builder.shuffle_vector(single, single, order)


@intrinsic
def draw_run(
    _: Any, disparity: Any, ids: Any, at: Any, count: Any, start: Any, slope: Any, number: Any  # noqa: ANN401
) -> _Generator:  # fmt: skip
    """Compile: of samples `at` to `at + 15`, draw the first `count` that lie no nearer already.

    `disparity` (n,) float32 and `ids` (n,) int32 are flat; lane i has disparity start + slope * i.
    """

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:  # noqa: ANN401
        near = _address(context, builder, signature.args[0], given[0], given[2], _FLOATS)
        shown = _address(context, builder, signature.args[1], given[1], given[2], _INTS)
        ramp = ir.Constant(_FLOATS, [float(lane) for lane in range(LANES)])
        steps = builder.fmul(ramp, _all(builder, _FLOATS, given[5]))
        mine = builder.fadd(_all(builder, _FLOATS, given[4]), steps)
        lane = ir.Constant(_INTS, list(range(LANES)))
        inside = builder.icmp_signed("<", lane, _all(builder, _INTS, given[3]))
        before = builder.load(near, align=4)
        drawn = builder.and_(inside, builder.fcmp_ordered(">=", mine, before))
        builder.store(builder.select(drawn, mine, before), near, align=4)
        number_ = _all(builder, _INTS, given[6])
        builder.store(builder.select(drawn, number_, builder.load(shown, align=4)), shown, align=4)
        return context.get_dummy_value()

    kinds = disparity, ids, types.intp, types.int32, types.float32, types.float32, types.int32
    return types.void(*kinds), generate
