"""The fit where F is misled and the ground's texture is not."""

import numpy as np
import pytest
from support.textured_ground import camera, filmed, scene, texture

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import UNKNOWN_LENS, LensPrior
from nlens_video.core.layers import CocMap
from nlens_video.core.placement import Region
from nlens_video.stages.p_projection import project_to_ground
from nlens_video.stages.r_regression import FitLens
from nlens_video.stages.whole_ground.evidence import SURE_PX

TRUTH = (20.0, -14.0)


def readings(coc_px, sigma_px, luma):
    shape = luma.shape
    return CocMap(
        coc_px=np.broadcast_to(np.float32(coc_px), shape).copy(),
        sigma_px=np.broadcast_to(np.float32(sigma_px), shape).copy(),
        luma=luma,
    )


def known(seen_by):
    return UNKNOWN_LENS.prior(seen_by.fx, seen_by.width, 1.0)


def coc_at(fit, ground):
    there = float(np.median(ground.disparity[ground.mask]))
    return fit.slope * there + fit.intercept, TRUTH[0] * there + TRUTH[1]


def test_ground_whose_grain_hides_its_blur_is_read_by_its_texture():
    """F takes the grain for sharpness at all depths."""
    seen_by, ground = scene()
    luma = filmed(texture(1), TRUTH, seen_by)
    misled = readings(0.5, 0.7, luma)
    fit = FitLens()(misled, ground, known=known(seen_by)).fit
    found, true = coc_at(fit, ground)
    assert found == pytest.approx(true, abs=0.6)
    assert fit.sign == "resolved"
    assert fit.method.endswith("with the ground's texture")
    alone = FitLens()(misled, ground, known=known(seen_by), with_whole_ground=False).fit
    assert abs(coc_at(alone, ground)[0] - true) > 3.0
    assert "texture" not in alone.method


def test_refused_ground_is_told_by_its_texture():
    seen_by, ground = scene()
    unsure = readings(6.0, 30.0, filmed(texture(1), TRUTH, seen_by))
    with pytest.raises(LensFitError, match="does not tell the blur"):
        FitLens()(unsure, ground, known=known(seen_by), with_whole_ground=False)
    fit = FitLens()(unsure, ground, known=known(seen_by)).fit
    found, true = coc_at(fit, ground)
    assert found == pytest.approx(true, abs=0.6)


def test_sure_readings_need_no_texture():
    seen_by, ground = scene()
    blur = np.abs(TRUTH[0] * ground.disparity + TRUTH[1])
    sure = readings(blur, 0.3, filmed(texture(1), TRUTH, seen_by))
    fit = FitLens()(sure, ground, known=known(seen_by)).fit
    assert fit.coc_stderr_px(0.4) < SURE_PX
    assert "texture" not in fit.method


def test_readings_without_their_picture_are_fitted_alone():
    seen_by, ground = scene()
    luma = filmed(texture(1), TRUTH, seen_by)
    fit = FitLens()(
        CocMap(coc_px=np.full_like(luma, 0.5), sigma_px=np.full_like(luma, 0.7)), ground,
        known=known(seen_by),
    ).fit  # fmt: skip
    assert "texture" not in fit.method


def test_footprint_that_is_fitted_alone_is_fitted_by_its_readings():
    seen_by, ground = scene()
    misled = readings(0.5, 0.7, filmed(texture(1), TRUTH, seen_by))
    fit = FitLens(whole_plane=False)(misled, ground, known=known(seen_by)).fit
    assert "texture" not in fit.method


def test_texture_outside_of_the_region_tells_nothing_of_the_lens():
    seen_by, ground = scene()
    luma = filmed(texture(1), TRUTH, seen_by)
    luma[:, 400:] = filmed(texture(2), (60.0, -6.0), seen_by)[:, 400:]
    region = Region.of((0.0, 0.0, 400 / seen_by.width, 1.0))
    fit = FitLens(region=region)(readings(0.5, 0.7, luma), ground, known=known(seen_by)).fit
    found, true = coc_at(fit, ground)
    assert "region" in fit.method and "texture" in fit.method
    assert found == pytest.approx(true, abs=0.6)


def test_picture_of_another_size_gives_the_blur_in_pixels_of_the_frame():
    seen_by, ground = scene()
    wide = camera(width=2 * seen_by.width, height=2 * seen_by.height)
    twice = project_to_ground(np.empty((0, 3, 3)), wide, 0.0)
    twice.mask[:] = np.kron(ground.mask, np.ones((2, 2), bool))
    luma = filmed(texture(1), TRUTH, seen_by)
    large = CocMap(
        coc_px=np.full((wide.height, wide.width), 1.0, np.float32),
        sigma_px=np.full((wide.height, wide.width), 1.4, np.float32),
        luma=luma,
    )
    fit = FitLens()(large, twice, known=known(wide)).fit
    there = float(np.median(ground.disparity[ground.mask]))
    expected = 2.0 * (TRUTH[0] * there + TRUTH[1])
    assert fit.slope * there + fit.intercept == pytest.approx(expected, abs=1.2)


def test_preference_holds_where_the_texture_agrees_with_it():
    seen_by, ground = scene()
    misled = readings(6.0, 2.0, filmed(texture(1), TRUTH, seen_by))
    prior = LensPrior(prefer="near", usual_slope=known(seen_by).usual_slope)
    fit = FitLens()(misled, ground, known=prior).fit
    assert fit.sign in ("assumed", "resolved")
    assert coc_at(fit, ground)[0] < 0.0
