"""Readings and texture combined by their errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from nlens_video.core.known_lens import NO_PRIOR, Expected, LensPrior
from nlens_video.core.lens_fit import LensFit
from nlens_video.stages.texture.ground_lens import GroundLens
from nlens_video.stages.whole_ground.combination import combined, lens_beforehand, lenses_of_fit

MIDDLE = 0.5


def by_readings(slope=20.0, intercept=-16.0, slope_error=6.0, intercept_error=3.0, **more):
    return LensFit(
        slope=slope, intercept=intercept, slope_stderr=slope_error,
        intercept_stderr=intercept_error, width=960, height=540, sign_margin=2.0, **more,
    )  # fmt: skip


def by_texture(slope=20.0, intercept=-16.0, error_px=0.5, unlikelier=0.0):
    """A lens whose CoC errs alike at `MIDDLE` and, by the slope, half of it away."""
    to_intercept = np.array([[1.0, 0.0], [-MIDDLE, 1.0]])
    apart = np.diag([(error_px / (0.5 * MIDDLE)) ** 2, error_px**2])
    covariance = to_intercept @ apart @ to_intercept.T
    return GroundLens(
        slope=slope, intercept=intercept, covariance=covariance, unlikelier=unlikelier
    )


def together(fit, by_ground, middle=MIDDLE):
    return combined(fit, lenses_of_fit(fit), by_ground, middle, "the texture")


def coc(fit, at=MIDDLE):
    return fit.slope * at + fit.intercept


@given(slope=st.floats(5.0, 60.0), focus=st.floats(0.0, 2.0))
def test_two_that_agree_are_surer_than_each(slope, focus):
    lens = slope, -slope * focus
    fit, texture = by_readings(*lens), by_texture(*lens)
    both = together(fit, [texture])
    assert (both.slope, both.intercept) == pytest.approx(lens, abs=1e-6)
    assert both.coc_stderr_px(MIDDLE) <= min(0.5, fit.coc_stderr_px(MIDDLE)) + 1e-9


def test_surer_of_two_counts_more():
    fit = by_readings(20.0, -16.0, slope_error=2.0, intercept_error=2.0)
    both = together(fit, [by_texture(20.0, -14.0, error_px=0.5)])
    assert abs(coc(both) - -4.0) < abs(coc(both) - -6.0)
    assert -6.0 < coc(both) < -4.0


def test_texture_that_contradicts_the_readings_is_left_out():
    fit = by_readings(20.0, -16.0, slope_error=1.0, intercept_error=0.5)
    assert together(fit, [by_texture(40.0, -2.0)]) is None


def test_texture_chooses_between_the_lenses_that_the_readings_leave_open():
    open_fit = replace(
        by_readings(20.0, -16.0, slope_error=4.0, intercept_error=2.0),
        sign="ambiguous", sign_margin=0.1, other=(20.0, -4.0),
    )  # fmt: skip
    both = together(open_fit, [by_texture(21.0, -4.6)])
    assert coc(both) == pytest.approx(5.9, abs=0.4)
    assert both.sign == "resolved" and both.sign_margin > 1.0 and both.other is None


def test_sign_that_neither_tells_stays_open_with_both_lenses():
    open_fit = replace(
        by_readings(4.0, -4.0, slope_error=8.0, intercept_error=4.0),
        sign="ambiguous", sign_margin=0.0, other=(4.0, 0.0),
    )  # fmt: skip
    both = together(open_fit, [by_texture(4.0, -4.0, error_px=3.0)])
    assert both.sign == "ambiguous"
    assert both.other == (4.0, 0.0)


@pytest.mark.parametrize(("texture", "sign"), [(-12.0, "resolved"), (-7.5, "ambiguous")])
def test_sign_that_the_readings_resolve_stays_so_on_their_side(texture, sign):
    """The CoC by the readings is -6 px; by the texture it is -2 or 2.5 px."""
    fit = by_readings(20.0, -16.0, slope_error=9.0, intercept_error=2.0)
    both = together(fit, [by_texture(20.0, texture, error_px=1.0)])
    assert both.sign == sign


def test_preference_of_the_user_is_kept():
    chosen = replace(by_readings(), sign="assumed")
    assert together(chosen, [by_texture()]).sign == "assumed"


def test_lens_on_the_side_that_the_user_prefers_is_taken_and_the_other_kept():
    """The likelier of both lenses of the ground lies on the other side, at 5 px."""
    lenses = by_texture(20.0, -5.0), by_texture(20.0, -15.0, unlikelier=1.0)
    found = {}
    for intercept in (-16.0, -4.0):
        chosen = replace(by_readings(20.0, intercept), sign="assumed")
        nothing = lens_beforehand(NO_PRIOR, chosen, MIDDLE)
        found[intercept] = combined(chosen, [nothing], lenses, MIDDLE, "a network")
    near, far = found.values()  # sides of the plane in focus
    assert (coc(near), coc(far)) == pytest.approx((-5.0, 5.0), abs=1e-3)
    assert far.other == pytest.approx((near.slope, near.intercept), abs=1e-3)
    assert near.other == pytest.approx((far.slope, far.intercept), abs=1e-3)


@pytest.mark.parametrize(
    ("known", "kept"),
    [
        (LensPrior(intercept=Expected(-14.0, 0.01)), lambda fit: fit.intercept + 14.0),
        (LensPrior(focus=Expected(0.8, 0.001)), lambda fit: coc(fit, 0.8)),
        (LensPrior(slope=Expected(12.0, 0.01)), lambda fit: fit.slope - 12.0),
    ],
)
def test_what_is_known_beforehand_is_kept_and_the_ground_tells_the_rest(known, kept):
    """The ground's lens is 20 and -16 with an error of 3 px."""
    fit = by_readings(18.0, -14.0)
    own = lens_beforehand(known, fit, MIDDLE)
    both = combined(fit, [own], [by_texture(error_px=3.0)], MIDDLE, "a network")
    assert kept(both) == pytest.approx(0.0, abs=0.1)
    assert both.coc_stderr_px(MIDDLE) <= 3.01


def test_ground_that_contradicts_what_is_known_beforehand_is_left_out():
    """Focused at infinity; the ground's lens is 20 and -16 with an error of 0.5 px."""
    fit = by_readings(18.0, -14.0)
    own = lens_beforehand(LensPrior(intercept=Expected(0.0, 0.01)), fit, MIDDLE)
    assert combined(fit, [own], [by_texture()], MIDDLE, "a network") is None


def test_nothing_known_leaves_the_lens_to_the_ground():
    fit, lens = by_readings(30.0, -2.0), by_texture()
    both = combined(fit, [lens_beforehand(NO_PRIOR, fit, MIDDLE)], [lens], MIDDLE, "a network")
    assert (both.slope, both.intercept) == pytest.approx((20.0, -16.0), rel=1e-5)
    assert both.coc_stderr_px(MIDDLE) == pytest.approx(0.5, rel=1e-3)


def test_second_likely_lens_widens_the_error():
    fit = by_readings(slope_error=40.0, intercept_error=20.0)
    one = by_texture(20.0, -16.0)
    alone = together(fit, [one])
    for unlikelier, widened in ((0.5, True), (40.0, False)):
        other = by_texture(20.0, -12.0, unlikelier=unlikelier)
        both = together(fit, [one, other])
        wider = both.coc_stderr_px(MIDDLE) > 1.5 * alone.coc_stderr_px(MIDDLE)
        assert wider == widened


@pytest.mark.parametrize("texture", [by_texture(1e-9, -3.0), by_texture(20.0, 0.0)])
def test_combination_is_a_lens_or_none(texture):
    fit = by_readings(1e-6, 0.0, slope_error=3.0, intercept_error=3.0)
    both = together(fit, [texture])
    assert both is None or (both.slope > 0.0 and both.intercept <= 0.0)


@given(scale=st.floats(1e-6, 1e6), error=st.floats(1e-3, 1e3), texture_error=st.floats(1e-3, 1e3))
def test_any_errors_and_units_give_finite_numbers(scale, error, texture_error):
    fit = by_readings(20.0 * scale, -16.0, slope_error=error * scale, intercept_error=error)
    lens = by_texture(error_px=texture_error)
    to_unit = np.diag([scale, 1.0])
    covariance = to_unit @ lens.covariance @ to_unit
    texture = GroundLens(slope=20.0 * scale, intercept=-16.0, covariance=covariance)
    both = together(fit, [texture], MIDDLE / scale)
    if both is not None:
        assert np.isfinite([both.slope, both.intercept, both.slope_stderr, both.correlation]).all()
        assert abs(both.correlation) <= 1.0 + 1e-6


def test_no_texture_gives_no_combination():
    assert together(by_readings(), []) is None
