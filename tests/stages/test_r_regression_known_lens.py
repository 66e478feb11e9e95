"""The fit combines what is known of the lens with the plate, by their errors."""

import numpy as np
import pytest
from support.planes import HEIGHT, WIDTH, ground, of_map

from nlens_video.core.known_lens import Expected, LensPrior
from nlens_video.core.layers import CocMap
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import FitLens

SLOPE, FOCUS = 40.0, 0.5


def plate(plane, scale=1.0, sigma=0.5):
    coc = scale * np.abs(SLOPE * (plane.disparity - FOCUS)).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, sigma))


def narrow():
    """A ground seen from above: hardly any disparity, so that many slopes explain it."""
    plane = ground(near=1.0, far=0.9)
    return GroundProjection(
        mask=plane.mask, disparity_of=of_map(np.clip(plane.disparity, 0.9, 1.0)), ground_y=0.0
    )


def test_known_aperture_gives_the_slope_that_the_ground_does_not_tell():
    plane = narrow()
    coc = plate(plane)
    rng = np.random.default_rng(0)
    coc = CocMap(
        coc_px=(coc.coc_px + rng.normal(0, 0.5, (HEIGHT, WIDTH))).astype(np.float32),
        sigma_px=np.full((HEIGHT, WIDTH), 3.0, np.float32),
    )
    known = LensPrior(slope=Expected(SLOPE, 0.03 * SLOPE))
    alone, together = FitLens()(coc, plane).fit, FitLens()(coc, plane, known=known).fit
    assert together.slope == pytest.approx(SLOPE, rel=0.04)
    assert together.slope_stderr < 0.2 * alone.slope_stderr
    assert together.slope_stderr <= 0.03 * SLOPE + 1e-6
    assert "with what is known of the lens" in together.method


def test_known_focus_gives_the_sign():
    plane = narrow()
    even = CocMap(
        coc_px=np.full((HEIGHT, WIDTH), SLOPE * (0.95 - FOCUS), np.float32),
        sigma_px=np.full((HEIGHT, WIDTH), 2.0, np.float32),
    )
    middle = 0.95
    for focus, sign in ((0.5, 1.0), (1.4, -1.0)):
        known = LensPrior(slope=Expected(SLOPE, 1.2), focus=Expected(focus, 0.02))
        fit = FitLens()(even, plane, known=known).fit
        assert np.sign(fit.slope * middle + fit.intercept) == sign
        assert fit.sign == "resolved"


@pytest.mark.parametrize(
    "known",
    [
        LensPrior(slope=Expected(SLOPE, 1.2)),
        LensPrior(focus=Expected(FOCUS, 0.015)),
        LensPrior(slope=Expected(SLOPE, 1.2), focus=Expected(FOCUS, 0.015)),
        LensPrior(intercept=Expected(-SLOPE * FOCUS, 0.8)),
    ],
)
def test_true_lens_is_found_with_smaller_errors_than_without(known):
    plane = ground()
    coc = plate(plane)
    alone, together = FitLens()(coc, plane).fit, FitLens()(coc, plane, known=known).fit
    there = np.linspace(0.2, 1.0, 5)
    assert np.abs(together.coc_px(there) - SLOPE * (there - FOCUS)).max() < 0.1
    assert (together.coc_stderr_px(there) <= alone.coc_stderr_px(there) + 1e-9).all()
    assert together.coc_stderr_px(there).sum() < 0.95 * alone.coc_stderr_px(there).sum()


def test_estimates_that_are_all_a_tenth_too_large_are_corrected_by_a_known_lens():
    plane = ground()
    known = LensPrior(slope=Expected(SLOPE, 1.2), focus=Expected(FOCUS, 0.015))
    read = plate(plane, scale=1.1, sigma=1.5)
    there = np.linspace(0.2, 1.0, 5)
    error = [
        np.abs(fit.coc_px(there) - SLOPE * (there - FOCUS)).mean()
        for fit in (FitLens()(read, plane).fit, FitLens()(read, plane, known=known).fit)
    ]
    assert error[1] < 0.5 * error[0]
