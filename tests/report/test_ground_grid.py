"""Grid and horizon lie where the camera sees the ground."""

import math

import numpy as np
import pytest

from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera
from nlens_video.report.ground_grid import (
    GRID_COLOR,
    Grid,
    draw_grid,
    draw_horizon,
    grid_in_view,
    horizon_row,
    over_plate,
)
from nlens_video.scene.camera import Camera

SIZE = (320, 200)


def camera(pitch_deg, roll_deg=0.0, focal=300.0):
    p, r = math.radians(pitch_deg), math.radians(roll_deg)
    about_x = np.array([[1, 0, 0], [0, math.cos(p), -math.sin(p)], [0, math.sin(p), math.cos(p)]])
    about_z = np.array([[math.cos(r), -math.sin(r), 0], [math.sin(r), math.cos(r), 0], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3] = about_x @ about_z
    pose[1, 3] = 1.5
    return Camera.centred(pose, focal, *SIZE, 1.0)


def test_horizon_of_a_level_camera_is_the_middle_row():
    assert horizon_row(camera(0.0), 10.0) == pytest.approx(100.0)


def test_horizon_rises_by_the_tangent_of_the_pitch():
    # 300 px tan 10 degrees = 52.9 px above the middle of a camera that looks down
    assert horizon_row(camera(-10.0), 160.0) == pytest.approx(100.0 - 52.898, abs=0.01)


def test_horizon_leans_with_the_roll():
    rows = [horizon_row(camera(0.0, 5.0), column) for column in (0.0, 320.0)]
    # up leans left in the picture, so the right side of the horizon is lower by 320 px tan 5
    assert rows[1] - rows[0] == pytest.approx(320 * math.tan(math.radians(5.0)), abs=0.01)


def test_grid_line_covers_the_pixels_of_its_points():
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    looking = camera(-20.0)
    grid = Grid(np.array([0.0, 0.0, -5.0]), 1.0, cells=4)
    draw_grid(image, looking, grid)
    for point in ([0.0, 0.0, -3.5], [1.0, 0.0, -4.2], [-0.4, 0.0, -5.0]):
        column, row = looking.pixels(looking.to_camera(np.array([point])))[0]
        assert image[int(row), int(column)].max() > 0.5 * max(GRID_COLOR), point
    column, row = looking.pixels(looking.to_camera(np.array([[0.5, 0.0, -4.5]])))[0]
    assert not image[int(row), int(column)].any()


def test_grid_that_reaches_behind_the_camera_is_cut_there():
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    draw_grid(image, camera(-10.0), Grid(np.array([0.0, 0.0, 0.0]), 1.0, cells=4))
    assert image[150:].any()
    assert not image[: int(horizon_row(camera(-10.0), 0.0))].any()


def test_camera_that_sees_no_ground_has_no_grid():
    assert grid_in_view(camera(60.0), 0.0) is None
    assert grid_in_view(camera(-10.0), 2.0) is None  # ground above the camera
    grid = grid_in_view(camera(-10.0), 0.0)
    assert grid is not None and grid.middle[1] == 0.0 and grid.middle[2] < 0.0


def test_band_of_the_horizon_is_as_wide_as_its_error():
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    draw_horizon(image, camera(0.0), CameraErrors(pitch_deg=4.0, roll_deg=0.0))
    shaded = np.flatnonzero(image[:, 40].any(axis=1))
    # 300 px tan 4 degrees = 21.0 px each way, a little more off the middle
    assert shaded[0] == pytest.approx(100 - 21.0, abs=5)
    assert shaded[-1] == pytest.approx(100 + 21.0, abs=5)
    sharp = np.zeros_like(image)
    draw_horizon(sharp, camera(0.0), None)
    assert np.flatnonzero(sharp[:, 40].any(axis=1)).size < 8


def test_picture_of_another_size_gets_the_same_ground():
    pose = camera(-20.0).world_from_camera
    key = CameraKey(index=0, pts_s=0.0, world_to_camera=np.linalg.inv(pose), fov_x_deg=50.0)
    solved = SolvedCamera(width=320, height=200, keys=(key,))
    grid = grid_in_view(solved.at(0.0), 0.0)
    plate = np.zeros((200, 320, 3), np.uint8)
    small, large = (
        over_plate(np.zeros((200 * n, 320 * n, 3), np.uint8), solved, 0.0, grid) for n in (1, 2)
    )
    assert not plate.any()
    rows = [np.flatnonzero(one[:, one.shape[1] // 4].any(axis=1))[-1] for one in (small, large)]
    assert rows[1] == pytest.approx(2 * rows[0], abs=6)
