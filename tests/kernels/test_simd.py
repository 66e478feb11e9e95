"""Each vector intrinsic against the NumPy expression of its docstring."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nlens_video.kernels.numba_config import exponent, half_power, kernel, significand
from nlens_video.kernels.simd import (
    DRAW_LANES,
    add_span_end,
    bilinear4,
    draw_samples,
    lane,
    load4,
    load8,
    load16,
    low4,
    pack4,
    select_gt,
    splat,
    splat16,
    store4,
    store16,
    to_f32x8,
    to_f64,
)

NUMBERS = st.floats(-1000.0, 1000.0, width=32)


@kernel
def of_fours(values, factor, out):
    one, other = load4(values, 4), load4(values, 2)
    store4(out, 0, one + other)
    store4(out, 4, one - other)
    store4(out, 8, one * splat(factor))
    store4(out, 12, one / splat(factor))
    store4(out, 16, pack4(lane(one, 3), lane(one, 2), lane(one, 1), factor))


@kernel
def of_eights(values, out):
    total = to_f64(load8(values, 1)) + to_f64(load8(values, 2))
    found = to_f32x8(total)
    store4(out, 0, low4(found))
    out[4], out[5] = lane(found, 4), lane(found, 7)


@kernel
def of_sixteens(values, limit, out):
    numbers, most = load16(values, 3), splat16(limit)
    store16(out, 1, select_gt(numbers, most, most, numbers))


@given(arrays(np.float32, (2, 4), elements=NUMBERS), st.floats(0.125, 8.0, width=32))
def test_vector_operations_of_four_agree_with_numpy(values, factor):
    out, flat = np.zeros(20, np.float32), values.ravel()
    of_fours(values, np.float32(factor), out)
    one, other = flat[4:8], flat[2:6]
    np.testing.assert_array_equal(out[:4], one + other)
    np.testing.assert_array_equal(out[4:8], one - other)
    np.testing.assert_array_equal(out[8:12], one * np.float32(factor))
    np.testing.assert_array_equal(out[12:16], one / np.float32(factor))
    np.testing.assert_array_equal(out[16:], [*one[:0:-1], np.float32(factor)])


@given(arrays(np.float32, 10, elements=NUMBERS))
def test_sum_of_eight_is_in_float64(values):
    out = np.zeros(6, np.float32)
    of_eights(values, out)
    exact = (values[1:9].astype(np.float64) + values[2:10]).astype(np.float32)
    np.testing.assert_array_equal(out, exact[[0, 1, 2, 3, 4, 7]])


@given(arrays(np.float32, 19, elements=NUMBERS), NUMBERS)
def test_masked_selection_of_sixteen_writes_only_its_lanes(values, limit):
    out = np.full(18, 7.0, np.float32)
    of_sixteens(values, np.float32(limit), out)
    np.testing.assert_array_equal(out[1:17], np.minimum(values[3:], np.float32(limit)))
    assert out[0] == out[17] == 7.0


@kernel
def ends_of_spans(sums, rgba, here, further):
    add_span_end(sums, 1, rgba, 2, here, further)


@kernel
def runs_of_samples(disparity, ids, at, count, start, slope, number):
    draw_samples(disparity, ids, at, np.int32(count), start, slope, np.int32(number))


@kernel
def mixed_texels(texels, upper, lower, across, down, out):
    store4(out, 0, bilinear4(texels, upper, lower, across, down))


@kernel
def parts_of_a_number(value, out):
    out[0], out[1] = exponent(value), significand(value)


@kernel
def powers(out):
    for power in range(out.shape[0]):
        out[power] = half_power(np.float32(power))


@given(
    arrays(np.float32, (3, 4), elements=NUMBERS), st.floats(0, 1, width=32),
    st.floats(0, 1, width=32),
)  # fmt: skip
def test_span_end_adds_light_and_weight_to_both_halves_of_one_row(rgba, here, further):
    sums = np.ones((3, 16), np.float32)
    ends_of_spans(sums, rgba, np.float32(here), np.float32(further))
    light = np.array([*rgba[2], 1, 0, 0, 0], np.float32)
    expected = np.ones((3, 16), np.float32)
    expected[1] += np.concatenate([np.float32(here) * light, np.float32(further) * light])
    np.testing.assert_allclose(sums, expected, rtol=1e-6, atol=1e-4)


@given(
    arrays(np.float32, 24, elements=st.floats(0, 2, width=32)), st.integers(-3, 20),
    st.floats(0, 2, width=32), st.floats(-0.125, 0.125, width=32),
)  # fmt: skip
def test_depth_tested_run_writes_only_samples_that_are_not_farther(disparity, count, start, slope):
    ids = np.full(24, -1, np.int32)
    start, slope = np.float32(start), np.float32(slope)
    mine = start + slope * np.arange(DRAW_LANES, dtype=np.float32)
    drawn = (np.arange(DRAW_LANES) < count) & (mine >= disparity[4:20])
    near, shown = disparity.copy(), ids.copy()
    near[4:20][drawn], shown[4:20][drawn] = mine[drawn], 7
    runs_of_samples(disparity, ids, 4, count, start, slope, 7)
    np.testing.assert_allclose(disparity, near, rtol=1e-6)
    np.testing.assert_array_equal(ids, shown)


@given(
    arrays(np.uint16, (6, 4)), st.integers(0, 4), st.integers(0, 4), st.floats(0, 1, width=32),
    st.floats(0, 1, width=32),
)  # fmt: skip
def test_texels_are_interpolated_bilinearly(texels, upper, lower, across, down):
    out = np.zeros(4, np.float32)
    mixed_texels(texels.ravel(), upper, lower, np.float32(across), np.float32(down), out)
    t = texels / 65535.0
    left, right = ((1 - down) * t[upper + k] + down * t[lower + k] for k in (0, 1))
    np.testing.assert_allclose(out, (1 - across) * left + across * right, atol=1e-6)


@given(st.floats(2.0**-126, 2.0**120, width=32))
def test_split_number_is_its_significand_times_a_power_of_two(value):
    out = np.zeros(2, np.float32)
    parts_of_a_number(np.float32(value), out)
    assert 1.0 <= out[1] < 2.0
    assert float(out[1]) * 2.0 ** float(out[0]) == value


def test_powers_of_a_half_are_exact():
    out = np.zeros(127, np.float32)
    powers(out)
    np.testing.assert_array_equal(out, 0.5 ** np.arange(127))
