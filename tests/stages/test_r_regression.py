import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.planes import HEIGHT, WIDTH, ground, of_map

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import UNKNOWN_LENS, LensPrior
from nlens_video.core.layers import CocMap
from nlens_video.graph.nodes.object_and_lens import constant_fit
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import FitLens
from nlens_video.stages.r_robust_v import VCandidate, VFit, add_unresolved_covariance


def plate(plane, slope, focus, sigma=0.5):
    coc = np.abs(slope * (plane.disparity - focus)).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, sigma))


@pytest.mark.slow
@settings(max_examples=60)
@given(slope=st.floats(6.0, 80.0), focus=st.floats(0.02, 1.5))
def test_noise_free_lens_is_recovered(slope, focus):
    plane = ground()
    fit = FitLens()(plate(plane, slope, focus), plane).fit
    assert fit.slope == pytest.approx(slope, rel=2e-2)
    there = plane.disparity[plane.mask]
    assert np.abs(fit.coc_px(there) - slope * (there - focus)).max() < 0.1


@pytest.mark.parametrize(("focus", "sign"), [(0.1, 1), (1.2, -1)])
def test_sign_of_the_coc_is_resolved_from_the_trend_of_blur(focus, sign):
    plane = ground()
    fit = FitLens()(plate(plane, 30.0, focus), plane).fit
    middle = float(np.median(plane.disparity[plane.mask]))
    assert np.sign(fit.slope * middle + fit.intercept) == sign
    assert fit.sign == "resolved" and fit.sign_margin > 0.5


def short_ground(far, least):
    """A ground none of which has a disparity below `least`."""
    plane = ground(near=1.0, far=far)
    disparity = np.maximum(plane.disparity, least)
    return GroundProjection(mask=plane.mask, disparity_of=of_map(disparity), ground_y=0)


def test_sign_of_the_coc_is_ambiguous_without_a_trend_of_blur():
    plane = short_ground(far=0.995, least=0.99)
    rng = np.random.default_rng(3)
    coc = (8.0 + rng.normal(0, 0.4, (HEIGHT, WIDTH))).astype(np.float32)
    fit = FitLens()(CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.5)), plane).fit
    assert fit.sign == "ambiguous"
    assert abs(fit.slope + fit.intercept) == pytest.approx(8.0, abs=0.5)


def steep_ground_of_one_blur():
    """A ground that spans so little disparity that either sign explains its blur."""
    plane = short_ground(far=0.9, least=0.9)
    rng = np.random.default_rng(3)
    coc = (8.0 + rng.normal(0, 1.0, (HEIGHT, WIDTH))).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, 2.0)), plane


@pytest.mark.parametrize(("prefer", "sign"), [("near", -1.0), ("far", 1.0)])
def test_preference_decides_between_two_lenses_that_explain_the_plate(prefer, sign):
    coc, plane = steep_ground_of_one_blur()
    fit = FitLens()(coc, plane, known=LensPrior(prefer=prefer)).fit
    assert fit.sign == "assumed"
    assert fit.slope * 0.95 + fit.intercept == pytest.approx(sign * 8.0, abs=1.0)
    assert fit.other is not None
    assert fit.other[0] * 0.95 + fit.other[1] == pytest.approx(-sign * 8.0, abs=1.0)


def test_fit_of_unclear_sign_keeps_both_lenses():
    fit = FitLens()(*steep_ground_of_one_blur()).fit
    assert fit.sign == "ambiguous"
    here, there = fit.slope * 0.95 + fit.intercept, fit.other[0] * 0.95 + fit.other[1]
    assert here * there < 0.0


@pytest.mark.parametrize("prefer", ["near", "far"])
def test_preference_changes_nothing_where_the_plate_tells_the_sign(prefer):
    plane = ground()
    coc = plate(plane, 30.0, 0.1)
    assert FitLens()(coc, plane, known=LensPrior(prefer=prefer)).fit == FitLens()(coc, plane).fit


USUAL = UNKNOWN_LENS.prior(focal_px=1333.0, width_px=960, unit_m=1.0)
"""What is known of any lens, of 50 mm before a full frame."""


def sharp_everywhere(plane, seed=1):
    """Readings of a ground whose grain is taken for sharpness."""
    rng = np.random.default_rng(seed)
    coc = np.abs(0.4 + rng.normal(0.0, 0.1, (HEIGHT, WIDTH))).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.5))


def test_ground_that_reads_sharp_at_all_depths_leaves_the_lens_open():
    plane = ground()
    coc, there = sharp_everywhere(plane), float(np.median(plane.disparity[plane.mask]))
    readings, open_too = FitLens()(coc, plane).fit, FitLens()(coc, plane, known=USUAL).fit
    assert readings.coc_stderr_px(there) < 0.5
    blur_of_a_usual_lens = USUAL.usual_slope * there
    assert 0.3 < open_too.coc_stderr_px(there) / blur_of_a_usual_lens < 0.7
    assert open_too.sign == "ambiguous" and not open_too.depends_on_depth
    share = readings.coc_stderr_px(there) / open_too.coc_stderr_px(there)
    assert open_too.readings_share == pytest.approx(float(share), rel=1e-3)


@pytest.mark.parametrize(("told", "larger"), [(0.1, 1.58), (3.5, 1.17), (12.0, 1.02)])
def test_readings_are_trusted_the_less_the_less_they_tell_the_slope(told, larger):
    readings = np.array([[4.0, -3.0], [-3.0, 3.0]])
    lens = VCandidate(slope=2.0 * told, focus=0.5)
    whole = add_unresolved_covariance(readings, lens, None, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(np.sqrt(whole / readings), larger, rtol=0.01)


def test_usual_lenses_change_nothing_where_the_blur_clearly_changes_with_depth():
    plane = ground()
    coc = plate(plane, 60.0, 0.5)
    plain, aware = FitLens()(coc, plane).fit, FitLens()(coc, plane, known=USUAL).fit
    assert (aware.slope, aware.intercept) == (plain.slope, plain.intercept)
    assert aware.slope_stderr == pytest.approx(plain.slope_stderr, rel=0.02)
    assert aware.sign == "resolved"


def test_error_covers_the_other_lens_where_the_sign_is_open():
    coc, plane = steep_ground_of_one_blur()
    fit = FitLens()(coc, plane, known=LensPrior(usual_slope=1e-6)).fit
    assert fit.coc_stderr_px(0.95) == pytest.approx(16.0 / np.sqrt(2.0), rel=0.2)


@pytest.mark.parametrize("slope", [1.0, 3.0, 6.0, 12.0, 25.0])
@pytest.mark.parametrize("sigma", [0.4, 1.5, 4.0])
def test_sign_is_never_resolved_with_a_slope_within_two_errors_of_zero(slope, sigma):
    plane = ground()
    rng = np.random.default_rng(5)
    true = slope * np.abs(plane.disparity - 0.2)
    coc = np.abs(true + rng.normal(0.0, 0.5 * sigma, true.shape)).astype(np.float32)
    fit = FitLens()(CocMap(coc_px=coc, sigma_px=np.full_like(coc, sigma)), plane, known=USUAL).fit
    assert fit.sign != "resolved" or fit.slope >= 2.0 * fit.slope_stderr


def ground_of_fine_grain():
    """Readings whose slope is told by themselves, and not any more with what they leave open."""
    plane = ground()
    rng = np.random.default_rng(5)
    true = 3.0 * np.abs(plane.disparity - 0.2)
    coc = np.abs(true + rng.normal(0.0, 0.2, true.shape)).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.4)), plane


def test_lens_that_usual_lenses_leave_open_keeps_the_other_one():
    coc, plane = ground_of_fine_grain()
    assert FitLens()(coc, plane).fit.sign == "resolved"
    fit = FitLens()(coc, plane, known=USUAL).fit
    assert fit.sign == "ambiguous" and fit.other is not None
    there = float(np.median(plane.disparity[plane.mask]))
    assert (fit.slope * there + fit.intercept) * (fit.other[0] * there + fit.other[1]) < 0.0


@pytest.mark.parametrize(("prefer", "sign"), [("near", -1.0), ("far", 1.0)])
def test_preference_decides_where_usual_lenses_leave_the_sign_open(prefer, sign):
    coc, plane = ground_of_fine_grain()
    fit = FitLens()(coc, plane, known=replace(USUAL, prefer=prefer)).fit
    there = float(np.median(plane.disparity[plane.mask]))
    assert fit.sign == "assumed" and sign * (fit.slope * there + fit.intercept) > 0.0


def test_upright_objects_on_the_ground_do_not_bias_the_fit():
    plane = ground()
    true = plate(plane, 40.0, 0.5)
    coc = true.coc_px.copy()
    coc[30:75, 20:110] = 3.0  # a wall of one depth: a third of the plane
    coc[60:110, 180:] = 17.0
    fit = FitLens()(CocMap(coc_px=coc, sigma_px=true.sigma_px), plane).fit
    there = plane.disparity[plane.mask]
    assert np.abs(fit.coc_px(there) - 40.0 * (there - 0.5)).max() < 0.6


def test_footprint_decides_between_two_ground_levels():
    plane = ground(footprint=(slice(85, 120), slice(60, 180)))
    upper, lower = plate(plane, 40.0, 0.5), plate(plane, 24.0, 0.9)
    coc = lower.coc_px.copy()
    coc[80:] = upper.coc_px[80:]  # the object stands on the nearer, upper level
    fit = FitLens()(CocMap(coc_px=coc, sigma_px=upper.sigma_px), plane).fit
    there = plane.disparity[plane.mask]
    assert np.abs(fit.coc_px(there) - 40.0 * (there - 0.5)).max() < 1.0


def test_uncertain_samples_have_little_weight():
    plane = ground()
    true = plate(plane, 30.0, 0.4)
    coc, sigma = true.coc_px.copy(), true.sigma_px.copy()
    coc[:, ::2] *= 0.4  # a smooth table read as sharp, and known to be unsure
    sigma[:, ::2] = 12.0
    fit = FitLens()(CocMap(coc_px=coc, sigma_px=sigma), plane).fit
    assert fit.slope == pytest.approx(30.0, rel=0.03)


@pytest.mark.slow
def test_standard_errors_account_for_errors_shared_by_samples():
    inside, trials, places, copies = 0, 200, 12, 50
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        disparity = np.repeat(rng.uniform(0.1, 1.0, places), copies)
        error = np.repeat(rng.normal(0, 0.8, places), copies)  # one error for all copies
        count = places * copies
        problem = VFit(
            disparity=disparity,
            coc_px=30.0 * (1.3 - disparity) + error,
            error_px=np.full(count, 0.8),
            share=np.full(count, 1 / count),
            infinity_px=96.0,
        )
        lens = problem.solve()
        covariance = problem.covariance(lens, np.arange(count), independent=places)
        inside += abs(lens.slope - 30.0) < np.sqrt(covariance[0, 0])
    assert 0.58 * trials <= inside <= 0.78 * trials


def test_standard_errors_include_the_bias_common_to_a_plate():
    plane = ground()
    true = plate(plane, 30.0, 1.3)
    exact = FitLens()(true, plane).fit
    # no residual shows that all samples may err alike by half a pixel, their sigma
    assert exact.slope == pytest.approx(30.0, abs=0.1)
    assert 0.5 < exact.slope_stderr < 3.0


def test_papers_fit_uses_the_footprint_alone():
    plane = ground()
    fit = FitLens(whole_plane=False)(plate(plane, 30.0, 0.9), plane).fit
    assert fit.method.endswith("the footprint")
    there = plane.disparity[plane.mask]
    assert np.abs(fit.coc_px(there) - 30.0 * (there - 0.9)).max() < 0.2


def test_fit_without_a_footprint_is_noted():
    plane = ground(footprint=None)
    assert "without a footprint" in FitLens()(plate(plane, 30.0, 0.5), plane).fit.method


def test_error_for_a_ground_out_of_view_states_what_to_do():
    plane = ground()
    gone = GroundProjection(
        mask=np.zeros_like(plane.mask),
        disparity_of=of_map(-np.ones_like(plane.disparity)),
        ground_y=0.0,
    )
    with pytest.raises(LensFitError, match="--ground-y"):
        FitLens()(plate(plane, 30.0, 0.5), gone)


def test_estimate_without_information_is_an_error():
    plane = ground()
    rng = np.random.default_rng(0)
    coc = np.abs(rng.normal(0, 30, (HEIGHT, WIDTH))).astype(np.float32)
    with pytest.raises(LensFitError, match="does not tell the blur"):
        FitLens()(CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.3)), plane)


def test_nan_estimates_are_ignored():
    plane = ground()
    true = plate(plane, 30.0, 0.4)
    coc = true.coc_px.copy()
    coc[::2] = np.nan
    fit = FitLens()(CocMap(coc_px=coc, sigma_px=true.sigma_px), plane).fit
    assert fit.slope == pytest.approx(30.0, rel=0.02)


def test_constant_fit_is_the_confident_median_of_the_footprint():
    plane = ground()
    coc = np.full((HEIGHT, WIDTH), 30.0, np.float32)
    coc[plane.mask] = 7.0
    fit = constant_fit(CocMap(coc_px=coc, sigma_px=np.ones_like(coc)), plane)
    assert (fit.slope, fit.intercept, fit.sign) == (0.0, -7.0, "assumed")


def test_short_span_of_disparity_does_not_give_an_extreme_slope():
    plane = ground(near=1.0, far=0.97)  # a ground seen from above
    plane = GroundProjection(
        mask=plane.mask, disparity_of=of_map(np.maximum(plane.disparity, 0.97)), ground_y=0
    )
    true = plate(plane, 30.0, 0.5)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        drift = np.cumsum(rng.normal(0, 0.05, HEIGHT))[:, None]  # errors that neighbours share
        noise = rng.normal(0, 0.5, true.coc_px.shape)
        coc = np.abs(true.coc_px + drift + noise).astype(np.float32)
        fit = FitLens(whole_plane=False)(
            CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.7)), plane
        ).fit
        assert fit.slope < 40 and abs(fit.slope - 30) < 2 * fit.slope_stderr
        assert fit.slope + fit.intercept == pytest.approx(15.0, abs=1.0) or fit.sign != "resolved"
