"""The linear lens model refuses numbers that float32 arithmetic cannot square."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from nlens_video.core.errors import LensFitError
from nlens_video.core.lens_fit import LensFit

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("value", [1e30, 1.01e18, math.inf, math.nan])
@pytest.mark.parametrize("name", ["slope", "intercept"])
def test_fit_out_of_range_is_refused(name, value):
    numbers = {"slope": 1.0, "intercept": 0.0, name: value}
    with pytest.raises(LensFitError, match="out of range"):
        LensFit(**numbers, width=8, height=8)


def test_file_with_a_number_out_of_range_is_refused():
    text = '{"slope": 1e30, "intercept": 0.0, "width": 8, "height": 8}'
    with pytest.raises(LensFitError, match='"slope" is 1e\\+30'):
        LensFit.from_json(text)


def test_largest_fit_is_accepted():
    fit = LensFit(slope=1e18, intercept=-1e18, width=8, height=8)
    assert fit.focus_disparity == 1.0


def lens(slope, intercept, **more):
    return LensFit(slope=slope, intercept=intercept, width=960, height=512, **more)


@pytest.mark.parametrize(
    ("slope", "error", "intercept", "words"),
    [
        (25.23, 430.0, -0.3369, "in focus everywhere"),
        (4.4, 610.0, -3.21, "the same blur at all depths (3.2 px)"),
        (0.0, 0.0, -7.0, "the same blur at all depths (7.0 px)"),
        (
            65.23456,
            1.27,
            -12.3,
            "coc_px = 65.2 \N{PLUS-MINUS SIGN} 1.3 \N{MIDDLE DOT} disparity - ",
        ),
        (2466.5, 96.6, 12.3, "coc_px = 2466 \N{PLUS-MINUS SIGN} 97 \N{MIDDLE DOT} disparity + "),
    ],
)
def test_lens_is_described_with_the_digits_that_its_error_warrants(slope, error, intercept, words):
    fit = lens(slope, intercept, slope_stderr=error, intercept_stderr=0.5)
    assert fit.describe().startswith(words)


def test_lens_is_described_with_the_objects_blur_and_its_error():
    fit = lens(40.0, -6.0, slope_stderr=1.0, intercept_stderr=0.3, object_disparity=0.4)
    assert "; CoC of the object 10.00 ± 0.50 px; " in fit.describe()
    unknown = lens(40.0, -6.0, slope_stderr=1.0, intercept_stderr=0.3)
    assert "of the object" not in unknown.describe()


def test_lens_says_how_well_it_fits_only_where_pixels_were_fitted():
    told = {"slope_stderr": 1.0, "rmse_px": 0.31, "sign_margin": 2.0, "method": "by hand"}
    fitted = lens(40.0, -6.0, n=900, **told).describe()
    assert fitted.endswith("residual 0.31 px, sign resolved (margin 2)")
    given = lens(40.0, -6.0, n=0, **told).describe()
    assert given.endswith("; by hand") and "residual" not in given


def test_lens_of_the_other_sign_is_kept_in_the_file_and_scaled():
    fit = lens(40.0, -6.0, sign="ambiguous", other=(30.0, -20.0))
    assert LensFit.from_json(fit.to_json()) == fit
    assert fit.for_width(480, 256).other == (15.0, -10.0)


@pytest.mark.parametrize("other", ["near", [1.0], [-1.0, 0.0], [1.0, 1e30], 3])
def test_file_with_a_nonsensical_other_lens_is_refused(other):
    text = json.dumps({"slope": 1.0, "intercept": 0.0, "width": 8, "height": 8, "other": other})
    with pytest.raises(LensFitError, match='"other" must be'):
        LensFit.from_json(text)


def test_blur_at_all_depths_is_that_of_the_ground_in_view():
    seen = ((0.1, 0.5), (0.2, 0.5), (0.3, 0.5))
    fit = lens(10.0, -1.0, slope_stderr=20.0, ground_seen=seen)
    assert fit.usual_coc_px == pytest.approx(1.0)


def test_error_of_the_coc_is_that_of_simulated_fits():
    covariance = np.array([[4.0, -1.5], [-1.5, 0.81]])
    drawn = np.random.default_rng(0).multivariate_normal((30.0, -9.0), covariance, 20000)
    fit = lens(30.0, -9.0, slope_stderr=2.0, intercept_stderr=0.9, correlation=-1.5 / 1.8)
    for disparity in (0.05, 0.4, 1.0):
        scatter = float(np.std(drawn @ (disparity, 1.0)))
        assert fit.coc_stderr_px(disparity) == pytest.approx(scatter, rel=0.03)
