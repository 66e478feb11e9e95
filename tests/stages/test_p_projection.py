import tracemalloc

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.scene.camera import Camera
from nlens_video.stages.p_projection import project_to_ground


def looking_down(height=2.0, angle=0.5, width=64, rows=48):
    """A camera at `height`, tilted down by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, c, s], [0, -s, c]]
    pose[1, 3] = height
    return Camera.from_yfov(pose, 1.0, width, rows)


def square_at(centre, half, y):
    x, z = centre
    a, b = [x - half, y, z - half], [x + half, y, z - half]
    c, d = [x + half, y, z + half], [x - half, y, z + half]
    return np.array([[a, b, c], [a, c, d]], float)


def test_plane_disparity_is_one_over_depth_of_the_visible_point():
    camera = looking_down()
    disparity = camera.plane_disparity(0.0)
    row, column = 40, 20
    ray = np.array(
        [(column + 0.5 - camera.cx) / camera.fx, -(row + 0.5 - camera.cy) / camera.fy, -1]
    )
    world_ray = camera.world_from_camera[:3, :3] @ ray
    depth = -camera.world_from_camera[1, 3] / world_ray[1]  # ray has unit depth per step
    assert disparity[row, column] == pytest.approx(1 / depth, rel=1e-12)


def test_plane_disparity_is_not_positive_above_the_horizon():
    camera = looking_down(angle=0.0)
    disparity = camera.plane_disparity(0.0)
    assert (disparity[: camera.height // 2] <= 0).all()
    assert (disparity[camera.height // 2 :] > 0).all()


def test_footprint_of_a_floating_square_is_its_vertical_projection():
    camera = looking_down()
    floating = project_to_ground(square_at((0.0, -3.0), 0.5, y=1.0), camera, 0.0)
    lying = project_to_ground(square_at((0.0, -3.0), 0.5, y=0.0), camera, 0.0)
    assert lying.mask.sum() > 20
    assert np.array_equal(floating.mask, lying.mask)


def test_footprint_is_conservative_by_at_most_its_outline():
    camera = looking_down(width=320, rows=240)
    ground = project_to_ground(square_at((0.2, -3.0), 0.6, y=0.3), camera, 0.0)
    columns = (np.arange(320) + 0.5 - camera.cx) / camera.fx
    rows = -(np.arange(240) + 0.5 - camera.cy) / camera.fy
    rays = np.stack(np.broadcast_arrays(columns[None], rows[:, None], -1.0), axis=-1)
    world = rays @ camera.world_from_camera[:3, :3].T
    points = world / np.where(ground.disparity > 0, ground.disparity, np.nan)[..., None]
    inside = (abs(points[..., 0] - 0.2) < 0.6) & (abs(points[..., 2] + 3.0) < 0.6)
    assert inside.sum() > 3000
    assert not (inside & ~ground.mask).any()
    touched = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert not (ground.mask & ~touched).any()


def test_footprint_reaching_behind_the_camera_keeps_its_visible_part():
    ground = project_to_ground(square_at((0.0, -1.0), 3.0, y=0.0), looking_down(), 0.0)
    assert ground.mask[-1].all()  # the ground at the lower border lies inside the square


@pytest.mark.parametrize("centre", [(0.0, 30.0), (500.0, -3.0)])
def test_footprint_out_of_view_is_empty(centre):
    assert not project_to_ground(square_at(centre, 0.5, y=0.0), looking_down(), 0.0).mask.any()


def test_footprint_far_beyond_the_frame_keeps_straight_edges():
    camera = looking_down(width=320, rows=240)
    strip = np.array([[-60.0, 0, 0.5], [1.0, 0, 0.5], [1.0, 0, -8.0], [-60.0, 0, -8.0]])
    ground = project_to_ground(strip[[[0, 1, 2], [0, 2, 3]]], camera, 0.0)
    columns = (np.arange(320) + 0.5 - camera.cx) / camera.fx
    rows = -(np.arange(240) + 0.5 - camera.cy) / camera.fy
    rays = np.stack(np.broadcast_arrays(columns[None], rows[:, None], -1.0), axis=-1)
    world = rays @ camera.world_from_camera[:3, :3].T
    points = world / np.where(ground.disparity > 0, ground.disparity, np.nan)[..., None]
    x, z = points[..., 0], points[..., 2]
    inside = (x > -60) & (x < 1) & (z > -8) & (z < 0.5)
    assert inside.sum() > 20_000
    assert (inside ^ ground.mask).sum() < 0.01 * inside.sum()


def test_footprint_is_empty_without_triangles_or_with_the_camera_in_the_plane():
    assert not project_to_ground(np.zeros((0, 3, 3)), looking_down(), 0.0).mask.any()


def test_ground_of_a_photograph_takes_a_byte_a_pixel():
    camera = looking_down(width=6000, rows=4000)
    tracemalloc.start()
    try:
        ground = project_to_ground(square_at((0.2, -3.0), 0.6, y=0.3), camera, 0.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert ground.mask.any() and peak < 1.1 * ground.mask.size
    edge_on = project_to_ground(square_at((0, -3), 0.5, 2.0), looking_down(height=2.0), 2.0)
    assert not edge_on.mask.any()


@settings(max_examples=40)
@given(scale=st.floats(1e-6, 1e6))
def test_footprint_does_not_depend_on_the_scenes_unit(scale):
    triangles = square_at((0.1, -3.0), 0.5, y=0.7)
    camera = looking_down()
    pose = camera.world_from_camera.copy()
    pose[:3, 3] *= scale
    scaled = Camera.from_yfov(pose, 1.0, camera.width, camera.height)
    expected = project_to_ground(triangles, camera, 0.1).mask
    assert np.array_equal(project_to_ground(triangles * scale, scaled, 0.1 * scale).mask, expected)
