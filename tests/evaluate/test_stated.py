"""What a fit states of its errors is held against the true lens of a plate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from support.truth_folder import INTERCEPT, SLOPE, write_plate

from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.coc.stated import stated_figures, stated_table, true_line
from nlens_video.evaluate.plates import load_plate

NAMES = ("object", "slope", "intercept")


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    return load_plate(write_plate(tmp_path_factory.mktemp("plate") / "one"))


def lens(slope=SLOPE, intercept=INTERCEPT, **more):
    return LensFit(
        slope=slope, intercept=intercept, width=320, height=180,
        slope_stderr=1.0, intercept_stderr=0.5, **more,
    )  # fmt: skip


@given(st.floats(0, 200), st.floats(-60, 0), st.integers(0, 2**31))
def test_true_line_finds_the_lens_from_the_cocs_of_two_depths_or_more(slope, intercept, seed):
    disparity = np.random.default_rng(seed).uniform(0.3, 0.6, 50)
    found = true_line(disparity, slope * disparity + intercept)
    assert found == pytest.approx((slope, intercept), abs=1e-6)


def test_true_lens_lies_within_every_stated_error(plate):
    figures = stated_figures(plate, lens())
    assert all(figures[f"{name}_within_one_percent"] == 100.0 for name in NAMES)
    assert figures["wrong_percent"] == figures["refused_percent"] == 0.0
    assert figures["resolved_percent"] == 100.0


def test_each_error_is_counted_by_its_own_stated_size(plate):
    figures = stated_figures(plate, lens(slope=SLOPE + 1.5, intercept=INTERCEPT - 1.1))
    assert figures["slope_within_one_percent"] == 0.0
    assert figures["slope_within_two_percent"] == 100.0
    assert figures["intercept_within_two_percent"] == 0.0
    # nearer than 1.6 m, where the object stands, both errors nearly cancel
    assert figures["object_within_one_percent"] == 100.0


def test_resolved_lens_of_the_other_sign_is_wrong_and_an_ambiguous_one_is_not(plate):
    other = lens(slope=0.0, intercept=-12.0)
    assert stated_figures(plate, other)["wrong_percent"] == 100.0
    assert stated_figures(plate, replace(other, sign="ambiguous"))["wrong_percent"] == 0.0


def test_refused_plates_count_among_all_and_nowhere_else(plate):
    table = stated_table()
    table.add("as rendered", "told", stated_figures(plate, lens()))
    table.add("as rendered", "refused", stated_figures(plate, None))
    (row,) = table.summary()
    assert row["refused_percent"] == 50.0
    assert row["resolved_percent"] == row["object_within_one_percent"] == 100.0
