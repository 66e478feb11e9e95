import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.planes import of_map

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import CocMap
from nlens_video.evaluate.coc.baselines import (
    best_constant,
    best_factor,
    edge_blur,
    fit_line,
    matting_coc,
    nearest_blur,
    quadratic_coc,
    reblur_ratio_coc,
)
from nlens_video.stages.p_projection import GroundProjection


def step_edge(sigma, angle=0.0, size=120):
    """A step between two greys, seen through a Gaussian: the error function, exactly."""
    at = np.arange(size) - size / 2 + 0.3
    across = np.cos(angle) * at[None, :] + np.sin(angle) * at[:, None]
    wave = np.vectorize(math.erf)(across / (math.sqrt(2) * sigma))
    return np.repeat((0.5 + 0.3 * wave)[..., None], 3, axis=2).astype(np.float32)


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, 0.6])
@pytest.mark.parametrize("sigma", [1.0, 2.0, 4.0, 8.0])
def test_reblur_ratio_recovers_the_sigma_of_a_blurred_step_within_5_percent(sigma, angle):
    read = edge_blur(step_edge(sigma, angle))
    inner = np.zeros_like(read.known)
    inner[40:80, 40:80] = True  # the picture's border is an edge of its own
    found = read.sigma_px[read.known & inner]
    assert found.size >= 20
    assert np.median(found) == pytest.approx(sigma, rel=0.05)


@pytest.mark.parametrize("estimate", [reblur_ratio_coc, matting_coc])
def test_reblur_ratio_gives_the_diameter_of_the_disc_with_the_same_variance(estimate):
    coc = estimate(step_edge(3.0))
    assert coc.shape == (120, 120)
    assert np.median(coc) == pytest.approx(12.0, rel=0.05)


@pytest.mark.parametrize("estimate", [reblur_ratio_coc, matting_coc])
def test_reblur_ratio_of_a_picture_without_edges_is_zero(estimate):
    assert not estimate(np.full((60, 80, 3), 0.4, np.float32)).any()


@pytest.mark.parametrize("estimate", [reblur_ratio_coc, matting_coc])
def test_reblur_ratio_increases_with_blur(estimate):
    picture = np.concatenate([step_edge(1.5), step_edge(5.0)], axis=1)
    coc = estimate(picture)
    assert np.median(coc[:, 150:210]) > 2 * np.median(coc[:, 30:90])


STRIPS = ((0.0, 1.0), (0.5, 2.0), (1.0, 4.0))  # relative disparity, sigma


def strips(of):
    return np.concatenate([of(*strip) for strip in STRIPS], axis=1)


def test_quadratic_baseline_finds_the_blur_between_sharp_picture_and_plate():
    rng = np.random.default_rng(0)
    sharp = rng.random((96, 288, 3)).astype(np.float32)
    disparity = strips(lambda d, _: np.full((96, 96), d, np.float32))
    layers = {d: cv2.GaussianBlur(sharp, (0, 0), s) for d, s in STRIPS}
    plate = np.select([(disparity == d)[..., None] for d in layers], list(layers.values()))
    coc = quadratic_coc(nearest_blur(plate, sharp), disparity)
    for at, (_, sigma) in enumerate(STRIPS):
        assert coc[48, 96 * at + 48] == pytest.approx(4 * sigma, rel=0.1)


def test_quadratic_baseline_is_also_fitted_on_edge_blur():
    turned = {2.0: math.pi}  # the middle step falls, so that the strips meet without a seam
    plate = strips(lambda _, sigma: step_edge(sigma, turned.get(sigma, 0.0), size=96))
    disparity = strips(lambda d, _: np.full((96, 96), d, np.float32))
    coc = quadratic_coc(edge_blur(plate), disparity)
    for at, (_, sigma) in enumerate(STRIPS):
        assert coc[48, 96 * at + 48] == pytest.approx(4 * sigma, rel=0.05)


def test_quadratic_baseline_of_a_flat_picture_is_zero():
    flat = np.full((40, 60, 3), 0.5, np.float32)
    assert not quadratic_coc(edge_blur(flat), np.zeros((40, 60), np.float32)).any()


def test_best_factor_removes_a_scale():
    truth = np.float32([[1, 4], [9, 2]])
    assert best_factor(1.25 * truth, truth) == pytest.approx(0.8)
    assert best_factor(np.zeros_like(truth), truth) == 0
    part = truth.copy()
    part[0] = np.nan
    assert best_factor(1.25 * truth, part) == pytest.approx(0.8)


@given(st.floats(-5, 25))
def test_best_constant_has_the_smallest_error(other):
    truth = np.float32([[0, 3], [8, 20]])
    best = best_constant(truth)
    assert np.mean((best - truth) ** 2) <= np.mean((other - truth) ** 2) + 1e-6


def footprint(near=1.0, far=0.5):
    disparity = np.repeat(np.linspace(far, near, 40)[:, None], 30, axis=1)
    return GroundProjection(
        mask=np.ones((40, 30), bool), disparity_of=of_map(disparity), ground_y=0.0
    )


def seen(plane, slope, focus):
    coc = np.abs(slope * (plane.disparity - focus)).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.ones_like(coc))


@pytest.mark.parametrize("focus", [0.1, 0.75, 1.4], ids=["before", "within", "behind"])
def test_papers_regression_finds_a_lens_focused_before_within_or_behind_the_ground(focus):
    plane = footprint()
    fit = fit_line(seen(plane, 30.0, focus), plane)
    assert fit.slope == pytest.approx(30.0, rel=0.01)
    assert fit.focus_disparity == pytest.approx(focus, abs=0.01)
    assert fit.rmse_px < 0.5


def test_papers_regression_mistakes_a_constant_blur_for_defocus():
    plane = footprint()
    coc = seen(plane, 30.0, 0.75)
    floored = CocMap(coc_px=np.maximum(coc.coc_px, 2.5), sigma_px=coc.sigma_px)
    assert abs(fit_line(floored, plane).slope) < 5  # the V is not seen as one


def test_papers_regression_refuses_too_few_pixels():
    plane = footprint()
    plane.mask[:] = False
    plane.mask[0, :10] = True
    with pytest.raises(LensFitError, match="10 px of footprint"):
        fit_line(seen(plane, 30.0, 0.75), plane)
