"""Screen bounds of everything within the convex hull of a set of points."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from nlens_video.core.layers import Box
from nlens_video.scene.camera import Camera
from nlens_video.scene.screen_projection import misses, places, travel_bound_px, travel_ref

BOX = Box(-20, -20, 340, 220)


def random_camera(rng):
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = rng.normal(size=3)
    return Camera.from_yfov(pose, 0.3 + rng.random(), 320, 200, 1.0 + rng.random())


def points_near(rng, camera, count, spread):
    """World points around a place up to six units in front of the camera or one behind it."""
    middle = np.array([*rng.normal(size=2) * 3.0, -rng.uniform(-1.0, 6.0)])
    own = middle + spread * rng.normal(size=(count, 3))
    return own @ camera.world_from_camera[:3, :3].T + camera.world_from_camera[:3, 3]


def inside_hull(rng, points, count=200):
    """Random points of the convex hull of points (..., N, 3), the same combination of each."""
    return rng.dirichlet(np.full(points.shape[-2], 0.3), count) @ points


@settings(max_examples=200)
@given(seed=st.integers(0, 100_000), count=st.integers(1, 20), spread=st.sampled_from([0.02, 3.0]))
def test_points_of_a_culled_hull_project_outside_the_box(seed, count, spread):
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    points = points_near(rng, camera, count, spread)
    seen = camera.to_camera(inside_hull(rng, points))
    seen = seen[seen[:, 2] < 0.0]
    x, y = camera.pixels(seen).T
    hits = (x >= BOX.x0) & (x <= BOX.x1) & (y >= BOX.y0) & (y <= BOX.y1)
    if misses(points, camera, BOX):
        assert not hits.any()


def test_hull_beside_or_behind_the_frame_is_culled_and_one_inside_is_not():
    camera = Camera.from_yfov(np.eye(4), 1.0, 320, 200)
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    assert not misses(cube + [0, 0, -9], camera, BOX)
    assert misses(cube + [0, 0, 9], camera, BOX)
    assert misses(cube + [90, 0, -9], camera, BOX)
    assert not misses(cube, camera, BOX)
    assert not misses(np.empty((0, 3)), camera, BOX)


def test_hull_with_nan_or_infinite_points_is_never_culled():
    camera = Camera.from_yfov(np.eye(4), 1.0, 320, 200)
    for wrong in (np.nan, np.inf, -np.inf):
        points = np.full((2, 3), wrong)
        with np.errstate(invalid="ignore"):
            assert not misses(points, camera, Box(0, 0, 1, 1))
            assert travel_bound_px([points, points], [camera, camera]) == np.inf


@settings(max_examples=200)
@given(
    seed=st.integers(0, 100_000), moments=st.integers(1, 4), count=st.integers(1, 9),
    step=st.sampled_from([0.0, 1e-3, 0.3]), zoom=st.sampled_from([0.0, 1e-3, 0.3]),
)  # fmt: skip
def test_screen_motion_of_a_hull_stays_within_the_bound(seed, moments, count, step, zoom):
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    scales = np.exp(zoom * rng.normal(size=moments))
    cameras = [replace(camera, fx=camera.fx * by, fy=camera.fy * by) for by in scales]
    points = points_near(rng, camera, count, 0.3)
    points = points + step * rng.normal(size=(moments, count, 3)).cumsum(axis=0)
    bound = travel_bound_px(list(points), cameras)
    assert bound == pytest.approx(travel_ref(list(points), cameras), rel=1e-9)
    assume(bound < np.inf)
    ways = [
        seen.pixels(seen.to_camera(own))
        for seen, own in zip(cameras, inside_hull(rng, points), strict=True)
    ]
    travelled = np.linalg.norm(np.diff(ways, axis=0), axis=-1).sum(axis=0)
    assert (travelled <= bound * (1.0 + 1e-9) + 1e-9).all()


@settings(max_examples=50)
@given(seed=st.integers(0, 100_000), single=st.booleans())
def test_places_are_those_of_the_camera_and_none_is_behind_it(seed, single):
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    points = points_near(rng, camera, 40, 3.0).astype(np.float32 if single else np.float64)
    seen = camera.to_camera(points.astype(np.float64))
    found = places(points[::-1][::-1], camera)
    before = seen[:, 2] < 0.0
    np.testing.assert_array_equal(np.isnan(found), np.tile(~before[:, None], 3))
    depth = -seen[before, 2]
    np.testing.assert_allclose(found[before, 2], depth, rtol=1e-9, atol=1e-9)
    near = depth > 1e-3  # beyond, columns and rows are as large as they are uncertain
    np.testing.assert_allclose(
        found[before, :2][near], camera.pixels(seen[before])[near], rtol=1e-7, atol=1e-7
    )
