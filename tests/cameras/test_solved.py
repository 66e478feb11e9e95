"""camera.json: what is written is read again, and what is wrong is named."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nlens_video.cameras.camera_json import camera_of_json
from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError

ANGLE = st.floats(-80.0, 80.0)
PLACE = st.floats(-50.0, 50.0)


def matrix(pitch=-15.0, yaw=0.0, roll=0.0, eye=(0.0, 1.6, 0.0)):
    """World-to-camera matrix of a camera with these angles [deg]."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    pose[:3, 3] = eye
    return np.linalg.inv(pose)


def camera(*keys, **values):
    """A camera of 960x512 px with these keys."""
    keys = keys or (CameraKey(index=0, pts_s=0.0, world_to_camera=matrix(), fov_x_deg=50.0),)
    return SolvedCamera(width=960, height=512, keys=keys, **values)


@given(pitch=ANGLE, yaw=ANGLE, roll=ANGLE, x=PLACE, y=PLACE, z=PLACE, fov=st.floats(1.0, 170.0))
def test_camera_json_is_read_as_it_was_written(pitch, yaw, roll, x, y, z, fov):
    keys = tuple(
        CameraKey(
            index=n, pts_s=n / 24.0, world_to_camera=matrix(pitch, yaw + n, roll, (x, y, z)),
            fov_x_deg=fov,
        )
        for n in range(3)
    )  # fmt: skip
    written = camera(
        *keys, ground_y=0.25, fov="metadata", horizon="measured", path="moving", scale="metres",
        errors=CameraErrors(fov_deg=1.5, pitch_deg=0.5, roll_deg=0.25), method="by hand",
        principal_px=(481.0, 250.5), distortion_k1=-0.05,
    )  # fmt: skip
    read = camera_of_json(written.to_json())
    assert read.to_json() == written.to_json()
    assert [key.pts_s for key in read.keys] == [key.pts_s for key in keys]


def test_angles_have_the_signs_that_the_documentation_states():
    down_and_leaning = CameraKey(
        index=0, pts_s=0.0, world_to_camera=matrix(-15.0, 30.0, 2.0), fov_x_deg=50.0
    )
    assert math.isclose(down_and_leaning.pitch_deg, -15.0, abs_tol=1e-9)
    assert math.isclose(abs(down_and_leaning.roll_deg), 2.0, abs_tol=1e-9)


def test_still_camera_holds_for_all_times():
    still = camera()
    assert np.array_equal(still.at(0.0).world_from_camera, still.at(9.0).world_from_camera)


@given(share=st.floats(0.0, 1.0))
def test_between_frames_the_camera_turns_and_moves_evenly(share):
    first = CameraKey(index=0, pts_s=0.0, world_to_camera=matrix(yaw=0.0), fov_x_deg=40.0)
    second = CameraKey(
        index=1, pts_s=0.5, world_to_camera=matrix(yaw=10.0, eye=(1.0, 1.6, 0.0)), fov_x_deg=50.0
    )
    found = camera(first, second, path="moving").at(0.5 * share)
    expected = np.linalg.inv(matrix(yaw=10.0 * share, eye=(share, 1.6, 0.0)))
    # a turn about an axis that is not the camera's own is even in yaw
    assert np.allclose(found.world_from_camera, expected, atol=1e-9)
    assert math.isclose(
        2 * math.degrees(math.atan(480 / found.fx)), 40.0 + 10.0 * share, abs_tol=1e-9
    )


def test_camera_of_another_size_of_the_same_shape_scales_its_principal_point():
    assert camera(principal_px=(480.0, 256.0)).resized(480, 256).principal_px == (240.0, 128.0)


def test_camera_of_another_shape_is_refused():
    with pytest.raises(SceneError, match="960x512, the plate has 1920x1080"):
        camera().resized(1920, 1080)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"frames": []}, "is empty"),
        ({"frames": 3}, "expected an object"),
        ({"width": 0}, '"width" is 0'),
        ({"width": "wide"}, "'wide', expected a number"),
        ({"fov": "guessed"}, "expected one of measured, metadata, assumed"),
        ({"ground_y": float("nan")}, "expected a finite number"),
        ({"principal_px": [1.0]}, "a column and a row"),
    ],
)
def test_wrong_values_are_named(change, said):
    raw = {**json.loads(camera().to_json()), **change}
    with pytest.raises(SceneError, match=said):
        camera_of_json(json.dumps(raw))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"world_to_camera": [[1, 0], [0, 1]]}, "rigid 4x4"),
        ({"world_to_camera": (2.0 * np.eye(4)).tolist()}, "rigid 4x4"),
        ({"world_to_camera": np.diag([-1.0, 1.0, 1.0, 1.0]).tolist()}, "rigid 4x4"),
        ({"fov_x_deg": 180.0}, "expected 0 to 180"),
    ],
)
def test_wrong_frames_are_named(change, said):
    raw = json.loads(camera().to_json())
    raw["frames"][0].update(change)
    with pytest.raises(SceneError, match=said):
        camera_of_json(json.dumps(raw))


def test_times_must_rise():
    raw = json.loads(camera().to_json())
    raw["frames"] *= 2
    with pytest.raises(SceneError, match="must rise"):
        camera_of_json(json.dumps(raw))


def test_text_that_is_no_json_is_refused():
    with pytest.raises(SceneError, match="no JSON from line 1, column 2 on"):
        camera_of_json("{")


@pytest.mark.parametrize("guessed", [False, True])
def test_a_guessed_place_stays_one_in_the_file(guessed):
    written = camera(place=(0.4, 0.8), place_guessed=guessed)
    assert camera_of_json(written.to_json()).place_guessed is guessed
