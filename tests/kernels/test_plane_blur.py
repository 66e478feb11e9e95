"""The blur of a plane: against its definition, a sampled lens, and the scatter that it replaces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.core.layers import Box
from nlens_video.kernels.scatter.plane_blur import LARGEST_COC_PX, PlaneCoc, blur_plane
from nlens_video.kernels.scatter.plane_blur_ref import blur_plane_ref
from nlens_video.kernels.scatter.scatter import scatter


def coc_map(coc, target):
    """The CoC at each pixel of a target (h, w)."""
    return coc.at(np.arange(target.y0, target.y1)[:, None], np.arange(target.x0, target.x1))


@settings(max_examples=8, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 12), st.integers(1, 16)),
    corner=st.floats(-9.0, 9.0),
    slope=st.floats(-0.3, 0.3),
    aspect=st.sampled_from([1.0, 0.5, 1.6]),
    grown=st.integers(-3, 6),
    seed=st.integers(0, 99),
)
def test_fast_and_definition_agree(shape, corner, slope, aspect, grown, seed):
    values = np.random.default_rng(seed).random((*shape, 3), dtype=np.float32)
    coc = PlaneCoc(corner, 0.0, slope)
    target = Box(-grown, -grown, max(shape[1] + grown, 1), max(shape[0] + grown, 1))
    if target.empty:
        return
    found = blur_plane(values, coc, target, aspect)
    exact = blur_plane_ref(values, coc, target, aspect)
    np.testing.assert_allclose(found[..., :3], exact, atol=1e-4)
    np.testing.assert_allclose(found[..., 3], found[..., :3].mean(axis=2), atol=1e-6)


def test_columns_of_a_rolled_plane_share_discs_without_a_visible_step():
    values = np.random.default_rng(5).random((12, 60, 3), dtype=np.float32)
    coc, target = PlaneCoc(3.0, 0.05, 0.1), Box(0, 0, 60, 12)
    away = blur_plane(values, coc, target)[..., :3] - blur_plane_ref(values, coc, target)
    assert np.abs(away).max() < 0.03 and np.sqrt(np.mean(away**2)) < 5e-3


def test_plane_in_focus_is_left_as_it_is():
    values = np.random.default_rng(1).random((9, 11, 3), dtype=np.float32)
    found = blur_plane(values, PlaneCoc(0.0, 0.0, 0.0), Box(0, 0, 11, 9))
    np.testing.assert_allclose(found[..., :3], values, atol=1e-5)


@pytest.mark.parametrize("coc", [2.0, 7.3, LARGEST_COC_PX])
def test_light_is_kept(coc):
    values = np.random.default_rng(2).random((20, 24, 3), dtype=np.float32)
    found = blur_plane(values, PlaneCoc(coc, 0.0, 0.0), Box(-20, -20, 44, 40))
    np.testing.assert_allclose(found[..., :3].sum((0, 1)), values.sum((0, 1)), rtol=1e-4)


def test_even_loss_stays_even_however_the_ground_leans():
    even = np.full((80, 90, 3), 0.7, np.float32)
    found = blur_plane(even, PlaneCoc(-6.0, 0.02, 0.2), Box(16, 16, 74, 64))
    np.testing.assert_allclose(found, 0.7, atol=1e-5)


@pytest.mark.slow
def test_leaning_plane_agrees_with_a_sampled_lens():
    rng = np.random.default_rng(3)
    values = np.zeros((90, 90, 3), np.float32)
    values[30:60, 20:70] = rng.random(3, dtype=np.float32)
    coc = PlaneCoc(-4.0, 0.01, 0.15)
    whole = Box(0, 0, 90, 90)
    rows, columns = np.mgrid[0:90, 0:90].astype(float)
    seen, points = np.zeros(values.shape), 100
    for number in range(points):  # where on the plane each pixel's ray through the lens arrives
        radius, angle = np.sqrt((number + 0.5) / points), 2.399963 * number
        u, v = radius * np.cos(angle), radius * np.sin(angle)
        there = coc_map(coc, whole) / (1.0 + 0.5 * (coc.across * u + coc.down * v))
        x, y = columns - 0.5 * u * there, rows - 0.5 * v * there
        low_x, low_y = np.floor(x).astype(int), np.floor(y).astype(int)
        for down, along in ((0, 0), (0, 1), (1, 0), (1, 1)):
            weight = abs(1 - down - (y - low_y)) * abs(1 - along - (x - low_x))
            at = (low_y + down).clip(0, 89), (low_x + along).clip(0, 89)
            seen += weight[..., None] * values[at] / points
    away = blur_plane(values, coc, whole)[..., :3] - seen
    assert np.sqrt(np.mean(away**2)) < 6e-3  # the scatter's is 4e-3: both of edges in focus


@pytest.mark.parametrize("across", [0.0, 0.015])
def test_plane_blur_and_scatter_agree(across):
    rows, columns = np.mgrid[0:70, 0:110]
    soft = np.exp(-(((columns - 55) / 18.0) ** 2) - ((rows - 35) / 9.0) ** 2)
    values = np.float32(0.8 * soft[..., None] * (1.0, 0.9, 0.8))
    coc = PlaneCoc(2.0, across, 0.1)
    target = Box(0, 0, 110, 70)
    rgba = np.concatenate([values, values.mean(axis=2, keepdims=True)], axis=2)
    scattered = scatter(rgba, np.float32(coc_map(coc, target)))
    np.testing.assert_allclose(blur_plane(values, coc, target), scattered, atol=6e-3)


def test_map_of_a_plane_is_told_from_others():
    coc = PlaneCoc(-3.0, 0.02, 0.15)
    of_plane = np.float32(coc_map(coc, Box(0, 0, 60, 40)))
    found = PlaneCoc.of(of_plane)
    assert (found.corner, found.across, found.down) == pytest.approx((-3.0, 0.02, 0.15), abs=1e-5)
    of_plane[10:20, 20:40] += 1.0
    assert PlaneCoc.of(of_plane) is None


def test_threads_share_the_rows_without_a_difference():
    values = np.random.default_rng(4).random((60, 50, 3), dtype=np.float32)
    coc, target = PlaneCoc(-3.0, 0.03, 0.1), Box(-5, -5, 55, 65)
    one, many = (blur_plane(values, coc, target, threads=n) for n in (1, 4))
    np.testing.assert_array_equal(one, many)
