"""Jumps, flicker and freezes of plain series of numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.check.series import (
    flicker,
    freezes,
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
