"""The virtual camera of an object that is placed in the frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.cameras.placement import contact_point, place_camera
from nlens_video.core.errors import SceneError, UsageError
from nlens_video.core.placement import Placement
from nlens_video.report.ground_grid import horizon_row

BOX = np.array([[x, y, z] for x in (1.0, 2.0) for y in (3.0, 5.0) for z in (-1.0, 1.0)], np.float32)
FOOT = np.array([1.5, 3.0, 0.0])


def place(at=(0.5, 0.8), size=0.3, *, vertices=BOX, focal=35.0, frame=(96, 54), aspect=1.0, **k):
    placing = Placement(at=at, size=size, **k)
    return place_camera(vertices, contact_point(vertices), placing, focal, frame, aspect)


def seen(camera, points):
    return camera.pixels(camera.to_camera(np.atleast_2d(np.asarray(points, np.float64))))


@given(
    x=st.floats(0.0, 1.0),
    below=st.floats(0.05, 0.7),
    size=st.floats(0.02, 0.6),
    yaw=st.floats(-180, 180),
    horizon=st.floats(-0.5, 0.8),
    roll=st.one_of(st.just(0.0), st.floats(-40, 40)),
    focal=st.floats(14.0, 200.0),
    aspect=st.sampled_from([1.0, 0.5, 4 / 3]),
)
def test_placed_object_has_the_given_position_and_height(
    x, below, size, yaw, horizon, roll, focal, aspect
):
    falls = math.tan(math.radians(roll)) * (x - 0.5) * 96 * aspect / 54
    at = (x, horizon + falls + below)
    given = {"yaw_deg": yaw, "horizon": horizon, "roll_deg": roll}
    try:
        camera = place(at, size, **given, focal=focal, aspect=aspect)
    except SceneError as error:
        assert "reach behind the camera" in str(error)
        return
    foot = seen(camera, FOOT)[0]
    np.testing.assert_allclose(foot, [x * 96, at[1] * 54], atol=1e-6)
    assert foot[1] - seen(camera, BOX)[:, 1].min() == pytest.approx(size * 54, abs=1e-6)
    depth = -camera.to_camera(FOOT[None])[0, 2]
    rows, columns = np.clip([foot[1], foot[0]], 0.5, [53.5, 95.5])
    plane = camera.plane_disparity(3.0)
    assert camera.world_from_camera[1, 3] > 3.0
    if 1 < rows < 52 and 1 < columns < 94:
        row, column = int(rows), int(columns)
        around = plane[row - 1 : row + 2, column - 1 : column + 2]
        assert around.min() - 1e-9 <= 1 / depth <= around.max() + 1e-9


@pytest.mark.parametrize("horizon", [-0.3, 0.0, 0.5, 0.7])
def test_ground_ends_at_the_given_horizon(horizon):
    camera = place((0.3, 0.9), horizon=horizon)
    far = camera.world_from_camera[:3, 3] * [1, 0, 1] + [0, 3, 0]
    ahead = camera.world_from_camera[:3, :3] @ [0, 0, -1] * [1, 0, 1]
    assert seen(camera, far + 1e7 * ahead)[0, 1] == pytest.approx(horizon * 54, abs=0.01)
    np.testing.assert_allclose(camera.world_from_camera[1, 0], 0, atol=1e-12)  # not rolled


@given(
    horizon=st.floats(-0.3, 0.7), roll=st.floats(-45, 45), aspect=st.sampled_from([1.0, 0.5, 4 / 3])
)
def test_rolled_horizon_falls_to_the_right_about_the_middle_of_the_frame(horizon, roll, aspect):
    camera = place((0.5, 0.9), horizon=horizon, roll_deg=roll, aspect=aspect)
    left, middle, right = (horizon_row(camera, column) for column in (0.0, 48.0, 96.0))
    assert middle == pytest.approx(horizon * 54, abs=1e-6)
    fall = math.tan(math.radians(roll)) * 96 * aspect
    assert right - left == pytest.approx(fall, abs=1e-6)


def test_place_above_a_rolled_horizon_is_a_usage_error():
    assert place((0.1, 0.6), 0.1, horizon=0.5, roll_deg=10)  # the horizon rises to the left
    with pytest.raises(UsageError, match=r"above the horizon \(--horizon 0.5 --roll 10\)"):
        place((0.9, 0.6), 0.1, horizon=0.5, roll_deg=10)
    with pytest.raises(UsageError, match="--roll 50 is not an angle from -45 to 45"):
        Placement(at=(0.5, 0.8), size=0.2, roll_deg=50)


def test_yaw_rotates_the_front_counter_clockwise_from_above():
    eye = place().world_from_camera[:3, 3] - FOOT
    assert abs(eye[0]) < 1e-9
    assert eye[2] > 0
    # The front of the object, +Z, turned by 90 degrees towards +X, points to the viewer's right.
    turned = place(yaw_deg=90)
    front, back = seen(turned, [FOOT + [0, 0, 1], FOOT - [0, 0, 1]])
    assert front[0] > back[0]


def test_focal_length_refers_to_the_full_frame_diagonal():
    camera = place(focal=50.0, aspect=2.0)
    assert camera.fy == pytest.approx(50 / math.hypot(36, 24) * math.hypot(192, 54))
    assert camera.fx == pytest.approx(camera.fy / 2)


def test_contact_point_is_the_centre_between_the_legs():
    legs = [[0, 0, 0], [2, 0.005, 0], [2, 0, 4], [0, 0, 4], [9, 1, 9]]
    np.testing.assert_allclose(contact_point(np.array(legs, np.float32)), [1, 0, 2])
    np.testing.assert_allclose(contact_point(np.array(legs, np.float32), -1.0), [1, -1, 2])


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"at": (0.5, 0.5), "size": 0.2}, "lies above the horizon"),
        ({"at": (0.5, 0.3), "size": 0.2, "horizon": 0.4}, "greater Y or a smaller --horizon"),
        ({"at": (0.5, 0.9), "size": 0.0}, "--size 0 is a share"),
        ({"at": (math.nan, 0.9), "size": 0.1}, "must be numbers"),
    ],
)
def test_invalid_placement_is_a_usage_error(wrong, line):
    with pytest.raises(UsageError, match=line):
        Placement(**wrong)


def test_placement_that_reaches_behind_the_camera_is_refused():
    with pytest.raises(SceneError, match="give a smaller --size or a higher horizon"):
        place(size=1.0, vertices=BOX * [1, 1, 50])
    with pytest.raises(SceneError, match="reach behind the camera"):
        place(vertices=np.zeros((3, 3), np.float32))
