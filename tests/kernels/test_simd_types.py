"""Several numbers as one value in a kernel: each operation against numpy's."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nlens_video.kernels.numba_config import kernel
from nlens_video.kernels.simd_types import (
    all_sixteen,
    eight_at,
    four,
    four_at,
    lane,
    lower,
    narrowed,
    put_sixteen,
    row,
    select_gt,
    sixteen,
    splat,
    store4,
    to_f64,
)

NUMBERS = st.floats(-1000.0, 1000.0, width=32)


@kernel
def of_fours(values, factor, out):
    one, other = row(values, 1), four_at(values, 2)
    store4(out, 0, one + other)
    store4(out, 4, one - other)
    store4(out, 8, one * splat(factor))
    store4(out, 12, one / splat(factor))
    store4(out, 16, four(lane(one, 3), lane(one, 2), lane(one, 1), factor))


@kernel
def of_eights(values, out):
    total = to_f64(eight_at(values, 1)) + to_f64(eight_at(values, 2))
    found = narrowed(total)
    store4(out, 0, lower(found))
    out[4], out[5] = lane(found, 4), lane(found, 7)


@kernel
def of_sixteens(values, limit, out):
    numbers, most = sixteen(values, 3), all_sixteen(limit)
    put_sixteen(out, 1, select_gt(numbers, most, most, numbers))


@settings(deadline=None)
@given(arrays(np.float32, (2, 4), elements=NUMBERS), st.floats(0.125, 8.0, width=32))
def test_four_numbers_are_added_multiplied_divided_and_put_together(values, factor):
    out, flat = np.zeros(20, np.float32), values.ravel()
    of_fours(values, np.float32(factor), out)
    one, other = flat[4:8], flat[2:6]
    np.testing.assert_array_equal(out[:4], one + other)
    np.testing.assert_array_equal(out[4:8], one - other)
    np.testing.assert_array_equal(out[8:12], one * np.float32(factor))
    np.testing.assert_array_equal(out[12:16], one / np.float32(factor))
    np.testing.assert_array_equal(out[16:], [*one[:0:-1], np.float32(factor)])


@settings(deadline=None)
@given(arrays(np.float32, 10, elements=NUMBERS))
def test_eight_numbers_are_summed_in_float64(values):
    out = np.zeros(6, np.float32)
    of_eights(values, out)
    exact = (values[1:9].astype(np.float64) + values[2:10]).astype(np.float32)
    np.testing.assert_array_equal(out, exact[[0, 1, 2, 3, 4, 7]])


@settings(deadline=None)
@given(arrays(np.float32, 19, elements=NUMBERS), NUMBERS)
def test_sixteen_numbers_are_chosen_lane_by_lane_and_no_others_written(values, limit):
    out = np.full(18, 7.0, np.float32)
    of_sixteens(values, np.float32(limit), out)
    np.testing.assert_array_equal(out[1:17], np.minimum(values[3:], np.float32(limit)))
    assert out[0] == out[17] == 7.0
