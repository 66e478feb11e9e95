"""The ground among the points of a scene."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nlens_video.cameras.ground import fit_ground, ground_frame


def scene(seed=0, below=0):
    """Points on a ground, of things on it and of a wall, and two cameras above."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack([rng.uniform(-3, 3, 300), np.zeros(300), rng.uniform(-9, -1, 300)])
    ground[:, 1] = rng.normal(0.0, 0.003, 300)
    things = rng.uniform((-3, 0, -9), (3, 1.5, -1), (150, 3))
    wall = np.column_stack([rng.uniform(-5, 5, 200), rng.uniform(0, 3, 200), np.full(200, -10.0)])
    under = rng.uniform((-3, -1, -9), (3, -0.2, -1), (below, 3))
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("X", -15.0, degrees=True).as_matrix()
    poses[:, :3, 3] = [(0.0, 1.5, 1.0), (0.5, 1.4, 0.8)]
    return np.concatenate([ground, things, wall, under]), poses


@settings(max_examples=20, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-180.0, 180.0)] * 3), scale=st.floats(0.01, 100.0),
    shift=st.floats(-100.0, 100.0),
)  # fmt: skip
def test_ground_is_found_in_any_world(turn, scale, shift):
    points, poses = scene()
    rotation = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    moved = scale * points @ rotation.T + shift
    cameras = poses.copy()
    cameras[:, :3, :3] = rotation @ poses[:, :3, :3]
    cameras[:, :3, 3] = scale * poses[:, :3, 3] @ rotation.T + shift
    normal, offset = fit_ground(moved, cameras)
    assert normal @ rotation[:, 1] == pytest.approx(1.0, abs=2e-5)
    assert (cameras[0, :3, 3] @ normal - offset) / scale == pytest.approx(1.5, abs=0.01)


def test_wall_is_not_taken_for_the_ground():
    points, poses = scene()
    wall = points[points[:, 2] < -9.9]
    assert fit_ground(np.concatenate([wall, wall + (0.1, 0.0, 0.0)]), poses) is None


def test_rough_slope_too_steep_for_a_ground_is_none_though_planes_within_it_are_flatter():
    _, poses = scene()
    rng = np.random.default_rng(0)
    slope = rng.uniform((-3, 0, -3), (3, 0, 3), (400, 3))
    slope[:, 1] = rng.normal(0.0, 0.1, 400)
    lean = Rotation.from_euler("X", 70.0 - 15.0, degrees=True)  # 70 degrees from the cameras' up
    assert fit_ground(lean.apply(slope) + (0.0, -1.0, -6.0), poses) is None


def test_table_with_points_below_it_is_not_the_ground():
    points, poses = scene()
    rng = np.random.default_rng(1)
    table = np.column_stack([rng.uniform(-1, 1, 350), np.full(350, 0.8), rng.uniform(-3, -1, 350)])
    normal, offset = fit_ground(np.concatenate([points, table]), poses)
    assert abs(offset) < 0.02


def test_too_few_points_give_no_ground():
    points, poses = scene()
    assert fit_ground(points[:10], poses) is None


def test_ground_becomes_the_plane_y_0_under_the_first_camera():
    points, poses = scene()
    rotation = Rotation.from_euler("xyz", (40.0, 20.0, -70.0), degrees=True).as_matrix()
    moved = 3.0 * points @ rotation.T + 5.0
    cameras = poses.copy()
    cameras[:, :3, :3] = rotation @ poses[:, :3, :3]
    cameras[:, :3, 3] = 3.0 * poses[:, :3, 3] @ rotation.T + 5.0
    level = ground_frame(*fit_ground(moved, cameras), cameras[0], 1.6)
    eye = level[:3, :3] @ cameras[0, :3, 3] + level[:3, 3]
    heights = (moved[:300] @ level[:3, :3].T + level[:3, 3])[:, 1]
    assert np.allclose(eye, (0.0, 1.6, 0.0), atol=1e-9)
    assert abs(heights).max() < 0.05
