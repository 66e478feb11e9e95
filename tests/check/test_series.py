"""Jumps, flicker and freezes of plain series of numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.check.series import (
    flicker,
    freezes,
    lone_jumps,
    lone_offset,
    outliers,
    second_difference,
    standard_error,
    steps,
    undone,
)

SMOOTH = 0.3 * np.sin(np.arange(60) / 9.0)
NOISE = 0.01 * np.random.default_rng(3).normal(size=60)


def test_second_difference_of_a_linear_series_is_zero():
    assert np.allclose(second_difference(np.linspace(3, -5, 20)), 0)


def test_second_difference_of_an_outlier_is_its_offset_and_half_of_it_beside():
    values = np.zeros(9)
    values[4] = 0.4
    assert second_difference(values)[3:6] == pytest.approx([-0.2, 0.4, -0.2])


@given(at=st.integers(2, 57), size=st.floats(0.3, 2.0), up=st.booleans())
def test_outlier_is_found_with_its_index_and_size(at, size, up):
    values = SMOOTH + NOISE
    values[at] += size if up else -size
    ((place, jump),) = outliers(second_difference(values), 0.15)
    assert place == at and jump == pytest.approx(size if up else -size, abs=0.06)


def test_smooth_series_has_neither_outlier_nor_flicker():
    assert (
        outliers(second_difference(SMOOTH + NOISE), 0.15) == []
        and flicker(second_difference(SMOOTH + NOISE), 0.02) == []
    )


def test_flicker_is_found_with_its_extent_and_amplitude_and_is_not_an_outlier():
    values = SMOOTH + NOISE
    values[20:40] += 0.2 * (-1.0) ** np.arange(20)
    ((first, last, amplitude),) = flicker(second_difference(values), 0.02)
    assert 16 <= first <= 22 and 37 <= last <= 43
    assert amplitude == pytest.approx(0.2, rel=0.15)
    assert outliers(second_difference(values[21:39]), 0.15) == []


def test_independent_noise_of_regions_is_not_flicker_but_a_common_one_is():
    own = 0.15 * np.random.default_rng(5).normal(size=(60, 8))
    shared = 0.03 * ((-1.0) ** np.arange(60))[:, None]
    error = standard_error(second_difference(own))
    assert np.median(error) == pytest.approx(0.15 * 1.22 / np.sqrt(8), rel=0.3)
    assert flicker(second_difference(own.mean(axis=1)), 0.015, error) == []
    steady = 0.1 * own + shared
    assert flicker(
        second_difference(steady.mean(axis=1)), 0.015, standard_error(second_difference(steady))
    )


def test_standard_error_ignores_unknown_regions():
    parts = np.random.default_rng(5).normal(size=(20, 8))
    parts[:, 4:] = np.nan
    parts[7] = np.nan
    error = standard_error(second_difference(parts))
    assert np.isfinite(error).all() and error[7] == 0 and error[3] > 0


def test_lasting_change_is_a_step_and_a_single_outlier_is_not():
    values = SMOOTH + 0.2 * NOISE
    values[30:] += 0.2
    ((place, size),) = steps(values, 0.1)
    assert place == 30 and size == pytest.approx(0.2, abs=0.03)
    single = SMOOTH + 0.2 * NOISE
    single[30] += 0.4
    assert steps(single, 0.1) == [] and outliers(second_difference(single), 0.15)
    assert steps(SMOOTH + 0.2 * NOISE, 0.1) == []


def test_end_of_a_single_outlier_among_uneven_values_is_no_step():
    before, after = [0.805, 0.795, 0.772, 0.746, 0.757, 0.78, 0.776], [0.746, 0.771, 0.763, 0.758]
    assert steps(np.array([*before, 0.917, *after, 0.775, 0.766]), 0.08) == []


def test_freeze_is_found_between_two_movements():
    motion = np.array([np.nan, 6, 7, 6, 0.2, 0.3, 9, 6, 6])
    assert freezes(np.nan_to_num(motion), 0.5) == [(4, 5)]


@pytest.mark.parametrize(
    "motion",
    [[0.0, 0.1, 0.1, 6, 6, 6], [6, 6, 6, 0.1, 0.1, 0.1], [6, 5, 6, 3, 5, 6]],
    ids=["starts to move", "comes to rest", "slows down"],
)
def test_starting_stopping_or_slowing_down_is_not_a_freeze(motion):
    assert freezes(np.array(motion, float), 0.5) == []


def test_offset_of_a_value_alone_is_exact_at_uneven_times():
    times = np.cumsum(np.random.default_rng(2).choice([1.0, 2.0, 3.0], 30))
    curve = 5.0 * times - 0.3 * times**2 + 0.002 * times**3
    np.testing.assert_allclose(
        lone_offset(second_difference(curve, times), times), np.zeros(30), atol=1e-9
    )
    straight = 5.0 * times + 3.0 * (np.arange(30) == 12)
    offset = lone_offset(second_difference(straight, times), times)
    assert offset[12] == pytest.approx(3.0) and np.argmax(np.abs(offset)) == 12


def test_a_value_off_alone_is_undone_by_its_neighbours():
    values = np.linspace(0.0, 40.0, 21)
    values[9] += 3.0
    expected = np.zeros(21)
    expected[9] = 3.0
    np.testing.assert_allclose(undone(second_difference(values)), expected, atol=1e-9)


@pytest.mark.parametrize(
    "values",
    [
        0.3 * np.arange(24.0) ** 2,
        6.0 * np.abs(np.arange(24.0) - 11.0) - 0.2 * (np.arange(24.0) - 11.0) ** 2,
        6.0 * np.abs(np.arange(24.0) - 11.4),
        5.0 * np.minimum(np.arange(24.0), 12.0),
        4.0 * np.sin(0.6 * np.arange(24.0)),
        9.0 * (np.arange(24.0) > 11.0),
    ],
    ids=["speeding up", "bouncing", "turning between frames", "stopping", "swinging", "leaping"],
)
def test_what_neighbours_do_not_undo_is_none(values):
    assert np.abs(undone(second_difference(values))).max() < 0.3


def test_values_that_go_to_and_fro_while_they_speed_up_are_undone_all_along():
    at = np.arange(24.0)
    bend = second_difference(0.2 * at * at + 0.5 * (-1.0) ** at)
    np.testing.assert_allclose(np.abs(undone(bend))[2:-2], 1.0, atol=0.1)


def jumps(place, limit=0.75):
    bend = second_difference(place)
    return lone_jumps(lone_offset(bend), bend, limit)


def test_offset_from_a_curve_of_third_order_is_that_of_the_value_alone():
    place = np.polyval([0.001, -0.03, 0.2, 5.0], np.arange(30.0))
    place[14] += 2.0
    offset = lone_offset(second_difference(place))
    assert offset[14] == pytest.approx(2.0) and np.count_nonzero(np.abs(offset) > 0.75) == 1


CRAWL_PX = [  # from frame to frame, in strokes
    -0.8, -0.8, -0.8, -1.0, -0.9, -1.9, -3.8, -6.1, -5.4, -4.3, -2.1, -0.5, -1.0, -1.0, -1.1, -1.2,
    -1.4, -2.4, -4.3, -6.1, -6.1, -4.7, -2.3, -1.0, -1.6, -1.5, -1.7, -1.7, -1.5, -2.5, -4.4, -5.4,
]  # fmt: skip


@pytest.mark.parametrize("at", range(5, 28))
def test_jump_by_3_px_is_found_on_every_frame_of_a_crawl(at):
    place = np.cumsum(CRAWL_PX)
    assert jumps(place) == []
    place[at] += 3.0
    assert min(abs(index - at) for index, _ in jumps(place)) <= 1


@pytest.mark.parametrize(
    "steps_px",
    [
        [0.7, -0.3, 0.5, 0.7, -0.4, 2.7, 1.7, -0.3, 0.8, 0.7, -1.1, 2.8, 1.5],
        [0.2, -0.4, 1.4, 4.4, 6.0, 3.5, 6.1, 1.7, -5.5, -4.5, -8.3, -7.8, -2.1],
    ],
    ids=["strokes of six frames", "a hop with a crouch before it"],
)
def test_motion_that_starts_and_stops_at_once_is_no_jump(steps_px):
    assert jumps(np.cumsum(steps_px)) == []
