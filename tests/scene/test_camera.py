"""Points of the world that a camera sees at places of its frame."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from support import shots


@given(st.floats(-60, 60), st.floats(5, 80), st.floats(0.3, 3.0))
def test_pixels_of_the_ground_are_found_where_it_projects_to(across, away, height):
    camera = shots.camera()
    ground_y = float(camera.world_from_camera[1, 3]) - height
    point = np.array([[0.01 * across, ground_y, -0.1 * away]])
    seen = camera.to_camera(point)
    if seen[0, 2] < -0.01:
        found, depth = camera.ground_seen_at(camera.pixels(seen), ground_y)
        np.testing.assert_allclose(found, point, atol=1e-6)
        np.testing.assert_allclose(depth, -seen[:, 2], atol=1e-6)


def test_no_ground_is_seen_above_the_horizon_or_from_below():
    camera = shots.camera()
    places = np.array([[240.0, -1e5], [240.0, 269.0]])
    points, depth = camera.ground_seen_at(places, 0.0)
    assert list(np.isnan(depth)) == [True, False]
    np.testing.assert_array_equal(np.isnan(points).any(axis=1), [True, False])
    assert np.isnan(camera.ground_seen_at(places, 100.0)[1]).all()


def test_points_lie_at_their_depth_where_their_pixels_are():
    camera = shots.camera()
    columns, rows = np.array([100.5, 110.5, 239.5]), np.array([80.5, 200.5])
    points = camera.points_at(np.full((2, 3), 2.5, np.float32), columns, rows)
    seen = camera.to_camera(points.reshape(-1, 3).astype(np.float64))
    np.testing.assert_allclose(-seen[:, 2], 2.5, rtol=1e-6)
    x, y = np.meshgrid(columns, rows)
    np.testing.assert_allclose(camera.pixels(seen), np.stack([x, y], -1).reshape(-1, 2), rtol=1e-5)
