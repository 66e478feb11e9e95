"""Surface points in shadow maps, in C++: the same bits at every level, and as the references."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.light_views import made_maps, made_points, made_views, made_weights
from support.native_levels import assert_same_bits

from nlens_video.effects.shadow.light_views import LightViews
from nlens_video.effects.shadow.shadow_maps import ShadowMaps, blocked
from nlens_video.effects.shadow.things_ref import (
    best_slopes_reference,
    blocked_reference,
    first_surfaces_reference,
    lost_light_reference,
    may_block_reference,
)
from nlens_video.native import kernels
from nlens_video.scene.illumination import polynomial

SEEDS = st.integers(0, 10_000)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.booleans(), st.booleans(), st.booleans())
def test_points_are_looked_up_as_by_the_reference(seed, far, transparent, weighted):
    rng = np.random.default_rng(seed)
    maps, points = made_maps(rng, far, transparent), made_points(rng, 300)
    weights = made_weights(rng, points) if weighted else None
    found, truth = blocked([maps], points, weights), blocked_reference(maps, points, weights)
    assert found[1] == pytest.approx(truth[1], abs=1e-4)
    assert (np.abs(found[0] - truth[0]) > 1e-4).mean() < 0.01  # places on a pixel's border
    assert truth[0].any()


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.booleans())
def test_first_surfaces_and_reach_are_those_of_the_reference(seed, far):
    rng = np.random.default_rng(seed)
    views, points = made_views(rng, far, 3), made_points(rng, 200)
    first, nearest = first_surfaces_reference(views, views.casters.points)
    assert (np.abs(views.first - first) > 1e-5).mean() < 0.01  # places on a cell's border
    assert views.nearest == pytest.approx(nearest)
    assert np.array_equal(views.may_block(points), may_block_reference(views, points))


def test_views_of_nothing_block_nothing_and_count_their_lights():
    rng = np.random.default_rng(1)
    views = LightViews.of(np.array([[0.0, 1.0, 0.0, 0.0]]), range(1), None, 0.1)
    points = made_points(rng, 10)
    assert not views.may_block(points).any()
    assert blocked([ShadowMaps.of(views)], points).tolist() == [[0.0] * 10, [1.0] * 10]


def test_lights_of_a_part_are_those_of_the_whole():
    rng = np.random.default_rng(2)
    maps, points = made_maps(rng, far=True, transparent=False), made_points(rng)
    weights = made_weights(rng, points)
    whole = blocked([maps], points, weights)
    parts = [
        ShadowMaps(maps.views.some(first, last), maps.bits >> first, maps.taken)
        for first, last in ((0, 3), (3, 8))
    ]
    assert blocked(parts, points, weights) == pytest.approx(whole, abs=1e-5)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(0, 4))
def test_flattest_window_and_loss_are_those_of_the_references(seed, reach):
    rng = np.random.default_rng(seed)
    across, down, left = rng.normal(size=(3, 9, 13))
    slopes = np.empty((9, 13, 2), np.float32)
    kernels.best_slopes(across, down, left, reach, slopes)
    assert slopes == pytest.approx(best_slopes_reference(across, down, left, reach), abs=1e-6)
    shares, loss = rng.random((3, 20), np.float32), np.empty((20, 3), np.float32)
    light = rng.random((3, 20, 3)) * (rng.random((20, 3)) > 0.2)
    kernels.lost_light(shares, light, loss)
    assert loss == pytest.approx(lost_light_reference(shares, light), abs=1e-6)


def test_ambient_light_is_the_polynomial_of_the_normal():
    rng = np.random.default_rng(3)
    normals, ambient = rng.normal(size=(50, 3)), rng.normal(size=(9, 3))
    light = np.empty((50, 3))
    kernels.ambient_light(normals, ambient, light)
    assert light == pytest.approx(np.maximum(polynomial(normals) @ ambient, 0.0))


@pytest.mark.parametrize("far", [False, True])
def test_shadow_maps_are_the_same_at_every_level(far):
    rng = np.random.default_rng(4)
    maps, points = made_maps(rng, far, transparent=True), made_points(rng)
    weights, views = made_weights(rng, points), maps.views
    drawn = (views.sides, views.first, views.at, maps.bits, maps.taken)
    windows, normals = rng.normal(size=(3, 20, 30)), rng.normal(size=(40, 3))
    shares, light_given = rng.random((3, 40), np.float32), rng.random((3, 40, 3))

    def run(module):
        first, nearest = np.zeros_like(views.first), np.zeros_like(views.nearest)
        module.first_surfaces(points, views.projection, views.sides, first, nearest)
        found, sums = np.zeros(len(points), bool), np.zeros((2, len(points)), np.float32)
        module.may_be_blocked(points, views.projection, nearest, found)
        module.add_blocked(points, views.projection, drawn, weights, sums)
        slopes, loss = np.zeros((20, 30, 2), np.float32), np.zeros((40, 3), np.float32)
        module.best_slopes(*windows, 3, slopes)
        module.lost_light(shares, light_given, loss)
        light = np.zeros((40, 3))
        module.ambient_light(normals, normals[:9].copy(), light)
        return first, nearest, found, sums, slopes, loss, light

    assert_same_bits(run)
