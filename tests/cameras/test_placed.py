"""Objects on the ground of a solved camera: where the frame shows them, and that they stay."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from nlens_video.cameras.placed import in_solved_world, place_on_ground, stand_on_ground
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError, UsageError
from nlens_video.core.placement import GroundPlacing, Placement

WIDTH, HEIGHT = 960, 512
BODY = np.array(
    [(x, y, z) for x in (-0.5, 0.5) for y in (0.0, 2.0) for z in (-0.5, 0.5)], np.float32
)
CONTACT = np.zeros(3)


def key(index, pitch=-15.0, yaw=0.0, roll=0.0, eye=(0.0, 1.6, 0.0)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    pose[:3, 3] = eye
    return CameraKey(
        index=index, pts_s=index / 24, world_to_camera=np.linalg.inv(pose), fov_x_deg=50.0
    )


def solved(*keys):
    return SolvedCamera(width=WIDTH, height=HEIGHT, keys=keys)


def pixels(camera, points):
    return camera.pixels(camera.to_camera(np.atleast_2d(np.asarray(points, np.float64))))


@given(
    x=st.floats(0.2, 0.8), y=st.floats(0.6, 0.95), size=st.floats(0.1, 0.4),
    yaw=st.floats(-180.0, 180.0), pitch=st.floats(-30.0, -8.0), roll=st.floats(-5.0, 5.0),
)  # fmt: skip
def test_object_touches_the_ground_at_its_pixel_and_has_its_size(x, y, size, yaw, pitch, roll):
    placing = Placement(at=(x, y), size=size, yaw_deg=yaw, horizon=None)
    camera = place_on_ground(BODY, CONTACT, placing, solved(key(0, pitch, 20.0, roll)), 0.0).at(0.0)
    foot = pixels(camera, CONTACT)[0]
    assert foot == pytest.approx((x * WIDTH, y * HEIGHT), abs=1e-6)
    highest = pixels(camera, BODY)[:, 1].min()
    assert (foot[1] - highest) / HEIGHT == pytest.approx(size, abs=1e-9)


def test_object_stays_on_its_point_of_the_ground_while_the_camera_moves():
    path = solved(key(0), key(24, pitch=-18.0, yaw=8.0, roll=1.0, eye=(0.6, 1.4, -0.5)))
    placing = Placement(at=(0.4, 0.8), size=0.3, horizon=None)
    placed = place_on_ground(BODY, CONTACT, placing, path, 0.0)
    first = path.at(0.0)
    ray = np.array([(0.4 * WIDTH - 480) / first.fx, -(0.8 * HEIGHT - 256) / first.fy, -1.0])
    direction = first.world_from_camera[:3, :3] @ ray
    eye = first.world_from_camera[:3, 3]
    ground = eye - eye[1] / direction[1] * direction
    for time_s in (0.0, 0.4, 1.0):
        expected = pixels(path.at(time_s), ground)
        assert pixels(placed.at(time_s), CONTACT) == pytest.approx(expected, abs=1e-6)


def test_front_faces_the_viewer_at_yaw_0_wherever_the_camera_heads():
    placing = Placement(at=(0.5, 0.8), size=0.3, horizon=None)
    for heading in (0.0, 70.0, -130.0):
        camera = place_on_ground(BODY, CONTACT, placing, solved(key(0, yaw=heading)), 0.0).at(0.0)
        towards = camera.world_from_camera[:3, 3]
        assert math.atan2(towards[0], towards[2]) == pytest.approx(0.0, abs=1e-9)


def test_place_above_the_horizon_is_refused():
    placing = Placement(at=(0.5, 0.1), size=0.05, horizon=None)
    with pytest.raises(SceneError, match="above the horizon"):
        place_on_ground(BODY, CONTACT, placing, solved(key(0, pitch=0.0)), 0.0)


def test_object_made_in_the_solved_world_is_seen_by_its_cameras():
    path = solved(key(0, yaw=30.0))
    seen = in_solved_world(path).at(0.0)
    assert np.allclose(seen.world_from_camera, path.at(0.0).world_from_camera)


@pytest.mark.parametrize("pitch", [-5.0, -15.0, -40.0])
@pytest.mark.parametrize("wide", [1.0, 9.0])
def test_chosen_place_is_on_the_ground_and_the_object_fits(pitch, wide):
    path, body = solved(key(0, pitch=pitch)), BODY * np.array([wide, 1.0, 1.0], np.float32)
    placed, said = stand_on_ground(body, CONTACT, GroundPlacing(), path, 0.0)
    found = pixels(placed.at(0.0), body)
    assert (found > 0).all() and (found < (WIDTH, HEIGHT)).all()
    assert said.startswith("--at 0.5,")


def test_place_that_the_solve_found_free_is_taken():
    path = replace(solved(key(0)), place=(0.3, 0.7))
    placed, _ = stand_on_ground(BODY, CONTACT, GroundPlacing(), path, 0.0)
    foot = pixels(placed.at(0.0), CONTACT)[0]
    assert foot == pytest.approx((0.3 * WIDTH, 0.7 * HEIGHT), abs=1e-6)


@pytest.mark.parametrize("at", [(0.5, 0.7), (0.3, 0.9)])
def test_height_in_metres_is_that_of_the_object_in_the_plate(at):
    path = replace(solved(key(0)), scale="metres")
    placed, said = stand_on_ground(BODY, CONTACT, GroundPlacing(at=at, height_m=0.5), path, 0.0)
    # The body is 2 high in its file and half a metre in the plate: the camera stands 1.6 m high.
    camera = placed.at(0.0)
    assert camera.world_from_camera[1, 3] == pytest.approx(1.6 * 2.0 / 0.5)
    assert pixels(camera, CONTACT)[0] == pytest.approx((at[0] * WIDTH, at[1] * HEIGHT), abs=1e-6)
    assert "--height 0.5m" in said


def test_height_in_metres_is_refused_where_the_scale_is_not_known():
    wish = GroundPlacing(at=(0.5, 0.8), height_m=0.5)
    with pytest.raises(UsageError, match="scale is not known; give --size"):
        stand_on_ground(BODY, CONTACT, wish, solved(key(0)), 0.0)


def test_camera_that_looks_up_has_no_place():
    with pytest.raises(SceneError, match="no ground"):
        stand_on_ground(BODY, CONTACT, GroundPlacing(), solved(key(0, pitch=40.0)), 0.0)
