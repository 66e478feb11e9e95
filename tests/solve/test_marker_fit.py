"""Ground and scale from markers: found in pictures, fitted, refused where they are no ground."""

import cv2
import numpy as np
import pytest
from support import marker_plates as plates

from nlens_video.cameras.ground import ground_frame, moved
from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera
from nlens_video.core.errors import InputError
from nlens_video.solve.marker_fit import metric_camera
from nlens_video.solve.marker_scene import ground_axes, stretched, stretched_plane
from nlens_video.solve.markers import MarkerFinder

pytestmark = pytest.mark.slow
FOUR = [
    plates.placed(number, 0.2, x, z, 12.0 * number)
    for number, (x, z) in enumerate([(-0.7, -2.8), (0.6, -2.7), (-0.4, -3.6), (0.8, -4.0)])
]
CAMERAS = [(-24.0, 1.0, 1.5, 50.0), (-18.0, -2.0, 1.2, 55.0), (-35.0, 3.0, 2.4, 40.0)]


def solved(things, camera, fov_deg, side, start=None, **look):
    finder = MarkerFinder()
    finder.add(plates.plate(things, camera, fov_deg, **look))
    return metric_camera(start or plates.rough(), *finder.sightings(), side_m=side)


def assert_pose(found, camera, tilt_deg, scale):
    """Directions to a tilt [deg] and the height to a share of it."""
    first = found.keys[0].world_from_camera
    up, expected = first[1, :3], camera[1, :3]
    assert np.degrees(np.arccos(min(1.0, up @ expected))) < tilt_deg
    assert first[1, 3] == pytest.approx(camera[1, 3], rel=scale)
    assert found.scale == "metres" and found.horizon == "measured" and found.ground_y == 0.0


@pytest.mark.parametrize(("pitch", "roll", "height", "fov"), CAMERAS)
def test_four_markers_give_pose_scale_and_field_of_view(pitch, roll, height, fov):
    camera = plates.pose(pitch, roll, height)
    found = solved(FOUR, camera, fov, 0.2)
    assert_pose(found, camera, 0.3, 0.01)
    assert found.keys[0].fov_x_deg == pytest.approx(fov, rel=0.02)
    assert found.fov == "measured"


@pytest.mark.parametrize("dictionary", ["DICT_4X4_50", "DICT_6X6_250", "DICT_APRILTAG_36h11"])
def test_one_marker_suffices_where_the_field_of_view_is_known(dictionary):
    camera = plates.pose(-24.0, 1.0, 1.5)
    thing = plates.placed(3, 0.3, 0.1, -3.0, 20.0, getattr(cv2.aruco, dictionary))
    found = solved([thing], camera, 50.0, 0.3, plates.rough(50.0, 0.1))
    assert_pose(found, camera, 0.3, 0.01)
    assert "1 marker (" in found.method


def test_board_is_fitted_as_one():
    camera = plates.pose(-30.0, 2.0, 1.4)
    found = solved([plates.board(0.12, 0.1, -2.4, 15.0)], camera, 45.0, 0.09)
    assert "a board of" in found.method
    assert_pose(found, camera, 0.15, 0.005)
    assert found.keys[0].fov_x_deg == pytest.approx(45.0, rel=0.01)
    assert found.errors.pitch_deg < 0.2


def test_twice_the_side_is_twice_the_scale():
    camera = plates.pose(-24.0, 0.0, 1.5)
    one, two = (solved(FOUR, camera, 50.0, side) for side in (0.2, 0.4))
    heights = [found.keys[0].world_from_camera[1, 3] for found in (one, two)]
    assert heights[1] == pytest.approx(2.0 * heights[0], rel=1e-3)


def test_moving_camera_gets_the_scale_that_the_markers_parallax_tells():
    finder, keys, eyes = MarkerFinder(), [], []
    for index in range(6):
        camera = plates.pose(-24.0, 1.0, 1.5, yaw_deg=2.0 * index, x=0.1 * index, z=-0.06 * index)
        finder.add(plates.plate(FOUR, camera, 50.0))
        eyes.append(camera)
        keys.append(CameraKey(index=index, pts_s=0.1 * index, fov_x_deg=50.0,
                              world_to_camera=np.linalg.inv(camera)))  # fmt: skip
    true = SolvedCamera(width=960, height=512, keys=tuple(keys), path="moving", fov="measured",
                        errors=CameraErrors(fov_deg=0.05))  # fmt: skip
    arbitrary = np.eye(4)
    arbitrary[:3, :3] *= 1.6 / 1.5
    found = metric_camera(moved(true, arbitrary), *finder.sightings(), side_m=0.2)
    assert_pose(found, eyes[0], 0.3, 0.01)
    path = [key.world_from_camera[:3, 3] for key in found.keys]
    walked = np.linalg.norm(eyes[-1][:3, 3] - eyes[0][:3, 3])
    assert np.linalg.norm(path[-1] - path[0]) == pytest.approx(walked, rel=0.01)
    assert [key.fov_x_deg for key in found.keys] == [50.0] * 6


def sideways(turn_deg=0.0):
    """A camera that goes 0.6 m sideways over one marker: its true path, and the sightings."""
    finder, keys = MarkerFinder(), []
    thing = plates.placed(3, 0.4, 0.1, -2.4, 10.0)
    for index in range(6):
        camera = plates.pose(-24.0, 1.0, 1.5, yaw_deg=turn_deg * index, x=0.12 * index - 0.3)
        finder.add(plates.plate([thing], camera, 50.0))
        keys.append(CameraKey(index=index, pts_s=0.1 * index, fov_x_deg=50.0,
                              world_to_camera=np.linalg.inv(camera)))  # fmt: skip
    true = SolvedCamera(width=960, height=512, keys=tuple(keys), path="moving", fov="measured",
                        errors=CameraErrors(fov_deg=2.0, pitch_deg=0.9, roll_deg=0.5))  # fmt: skip
    return true, finder.sightings()


def on_its_ground(camera, pixels, seen_from):
    """Where a frame shows the points of the ground that the first frame shows at pixels (N, 2)."""
    first, other = camera.at(camera.keys[0].pts_s), camera.at(camera.keys[seen_from].pts_s)
    rays = np.column_stack(
        [(pixels - (first.cx, first.cy)) / first.fx * (1, -1), -np.ones(len(pixels))]
    ) @ first.world_from_camera[:3, :3].T  # fmt: skip
    eye = first.world_from_camera[:3, 3]
    points = eye + rays * ((camera.ground_y - eye[1]) / rays[:, 1])[:, None]
    local = (points - other.world_from_camera[:3, 3]) @ other.world_from_camera[:3, :3]
    return (other.cx, other.cy) + other.fx * local[:, :2] / -local[:, 2:] * (1, -1)


@pytest.mark.parametrize("turn_deg", [0.0, 0.6])
@pytest.mark.parametrize("share", [0.95, 1.05])
def test_marker_corrects_the_field_of_view_of_a_path_and_the_pitch_that_hangs_on_it(
    share, turn_deg
):
    true, sightings = sideways(turn_deg)
    # A path without much of a turn is seen alike through another focal length, on a tilted ground.
    start = stretched(true, share)
    tilted = stretched_plane(np.array([0.0, 1.0, 0.0]), 0.0, share, true.keys[0].world_from_camera)
    start = moved(start, ground_frame(*tilted, start.keys[0].world_from_camera, 1.6))
    assert abs(start.keys[0].fov_x_deg - 50.0) > 1.8
    assert abs(start.keys[0].pitch_deg + 24.0) > 0.9
    found = metric_camera(start, *sightings, side_m=0.4)
    assert found.keys[0].fov_x_deg == pytest.approx(50.0, abs=0.2)
    assert found.keys[0].pitch_deg == pytest.approx(-24.0, abs=0.1)
    assert found.keys[0].world_from_camera[1, 3] == pytest.approx(1.5, rel=0.005)
    assert abs(found.keys[0].pitch_deg + 24.0) < 3.0 * found.errors.pitch_deg
    pixels = np.array([(300.0, 250.0), (700.0, 300.0), (480.0, 450.0), (350.0, 420.0)])
    seen, expected = (on_its_ground(one, pixels, 5) for one in (found, true))
    assert abs(seen - expected).max() < 0.5


def test_marker_beside_the_ground_of_a_path_is_told():
    true, sightings = sideways()
    leaning = ground_axes(np.radians(1.5), 0.0)[:, 1]
    pose = true.keys[0].world_from_camera
    start = moved(true, ground_frame(leaning, float(leaning @ pose[:3, 3]) - 1.5, pose, 1.6))
    found = metric_camera(start, *sightings, side_m=0.4)
    assert "degrees off the ground of the path's points" in found.method
    same = metric_camera(true, *sightings, side_m=0.4)
    assert "degrees off" not in same.method


def test_stray_marker_of_another_size_is_left_out():
    camera = plates.pose(-24.0, 1.0, 1.5)
    stray = plates.placed(30, 0.33, 0.0, -2.3)
    found = solved([*FOUR, stray], camera, 50.0, 0.2, plates.rough(50.0, 0.1))
    assert found.keys[0].world_from_camera[1, 3] == pytest.approx(1.5, rel=0.03)


def test_plate_without_a_marker_is_refused():
    with pytest.raises(InputError, match="no marker of OpenCV's dictionaries is seen"):
        solved([], plates.pose(-24.0, 0.0, 1.5), 50.0, 0.2)


def test_marker_on_a_wall_is_refused():
    # Upright before a level camera: the picture of a marker on the ground seen from above.
    picture = cv2.resize(plates.marker(3), (200, 200), interpolation=cv2.INTER_AREA)
    wall = np.full((512, 960), 128, np.uint8)
    wall[150:350, 380:580] = picture
    finder = MarkerFinder()
    finder.add(wall)
    with pytest.raises(InputError, match="does not lie flat on the ground"):
        metric_camera(plates.rough(50.0, 1.0, 0.0), *finder.sightings(), side_m=0.2)


def test_texture_without_markers_shows_none():
    rng = np.random.default_rng(5)
    finder = MarkerFinder()
    finder.add(cv2.GaussianBlur(rng.integers(0, 255, (270, 480), np.uint8), (0, 0), 2.0))
    assert finder.sightings() == ([], "")
