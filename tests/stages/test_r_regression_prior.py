"""Removal of the training prior from the estimated CoC."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.planes import ground

from nlens_video.core.layers import CocMap, CocPrior
from nlens_video.stages.r_regression import FitLens
from nlens_video.stages.r_samples import remove_prior

PRIOR = CocPrior(mean=2.3, deviation=1.0)


def posterior(said, wide, prior=PRIOR):
    """Median and mean absolute error of what a network believes: evidence times prior."""
    precision = 1 / wide**2 + 1 / prior.deviation**2
    mean = (np.log1p(said) / wide**2 + prior.mean / prior.deviation**2) / precision
    coc = np.expm1(mean)
    return coc, precision**-0.5 / np.sqrt(2) * (1 + coc)


@given(said=st.floats(0.3, 60.0), wide=st.floats(0.02, 1.0))
def test_removing_the_prior_recovers_the_likelihood(said, wide):
    coc, sigma = posterior(np.array([said]), wide)
    found, error = remove_prior(coc, sigma, PRIOR)
    assert found[0] == pytest.approx(said, rel=1e-6, abs=1e-6)
    assert error[0] == pytest.approx(wide / np.sqrt(2) * (1 + said), rel=1e-6)


def test_confident_estimate_is_unchanged_by_removing_the_prior():
    coc, sigma = np.array([0.5, 8.0, 40.0]), np.array([0.01, 0.05, 0.2])
    found, _ = remove_prior(coc, sigma, PRIOR)
    np.testing.assert_allclose(found, coc, rtol=2e-3, atol=2e-3)


def test_prior_is_removed_in_the_networks_pixel_scale():
    coc, sigma = np.array([2.0, 20.0]), np.array([0.8, 4.0])
    found, error = remove_prior(coc, sigma, PRIOR)
    half = CocPrior(mean=2.3, deviation=1.0, scale=0.5)
    np.testing.assert_allclose(remove_prior(coc / 2, sigma / 2, half), (found / 2, error / 2))


@given(coc=st.floats(0.0, 400.0), sigma=st.floats(1e-3, 1e4))
def test_debiased_estimate_is_finite_for_any_input(coc, sigma):
    found, error = remove_prior(np.array([coc]), np.array([sigma]), PRIOR)
    assert np.isfinite(found).all() and (found >= 0).all()
    assert np.isfinite(error).all() and (error > 0).all()


def test_uncertain_estimates_do_not_flatten_the_slope():
    plane = ground()
    said = np.abs(40.0 * (plane.disparity - 0.45))
    coc, sigma = posterior(said, 0.5)
    shrunk = CocMap(coc_px=np.float32(coc), sigma_px=np.float32(sigma))
    flat = FitLens()(shrunk, plane).fit.slope
    whole = CocMap(coc_px=np.float32(coc), sigma_px=np.float32(sigma), prior=PRIOR)
    slope = FitLens()(whole, plane).fit.slope
    assert flat < 38.5
    assert slope == pytest.approx(40.0, rel=0.02)
