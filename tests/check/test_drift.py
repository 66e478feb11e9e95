"""An object that slides over a moving plate's ground is found, one that keeps its place is not."""

import json

import numpy as np
import pytest
from support.camera_paths import focal_of, rotation
from support.grounds import FOV_DEG, pictures, write_clip

from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.check.command import compare
from nlens_video.core.settings import SourceSettings

pytestmark = pytest.mark.slow
FRAMES = 14
PAN = [
    (rotation(np.radians(4 - 0.6 * n), np.radians(-20), 0.0), (0.0, 1.5, 0.0))
    for n in range(FRAMES)
]
STILL = [PAN[0]] * FRAMES
RNG = np.random.default_rng(8)
BODIES = [np.kron(RNG.integers(20, 235, (15, 10, 3)), np.ones((8, 8, 1))) for _ in range(FRAMES)]


@pytest.fixture(scope="module")
def plates(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drift")
    found = {name: list(pictures(poses)) for name, poses in (("pan", PAN), ("still", STILL))}
    return {
        name: (shown, write_clip(folder / f"{name}.mkv", shown)) for name, shown in found.items()
    }


def with_body(shown, place, body=lambda n: BODIES[0]):
    """The plate with a textured body whose foot is at `place(n)` on each frame [px]."""
    for n, picture in enumerate(shown):
        whole = picture.copy()
        column, row = (round(float(one)) for one in place(n))
        whole[row - 120 : row, column - 40 : column + 40] = body(n).astype(np.uint8)
        yield whole


def on_ground(n, point=(0.1, 0.0, -3.4)):
    """Where the pan shows a point of the ground on a frame [px]."""
    turn, eye = PAN[n]
    seen = (np.array(point) - eye) @ turn
    focal = focal_of(FOV_DEG)
    return 480 - focal * seen[0] / seen[2], 256 + focal * seen[1] / seen[2]


def camera_file(path, poses):
    keys = []
    for n, (turn, eye) in enumerate(poses):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn.T, -turn.T @ np.array(eye)
        keys.append(CameraKey(index=n, pts_s=n / 24, world_to_camera=matrix, fov_x_deg=FOV_DEG))
    path.write_text(SolvedCamera(width=960, height=512, keys=tuple(keys)).to_json())
    return path


def checked(plates, name, tmp_path, place, camera=None, **more):
    shown, plate = plates[name]
    result = write_clip(tmp_path / "out.mkv", with_body(shown, place, **more))
    verdict = compare(str(result), SourceSettings(spec=str(plate)), camera_from=camera).verdict
    assert json.dumps(verdict.as_json())
    return verdict


def fixed(n):
    return 480, 400


def walking(n):
    x, y = on_ground(n)
    return x + 7 * n, y


def test_object_at_rest_in_the_frame_of_a_pan_slides(plates, tmp_path):
    verdict = checked(plates, "pan", tmp_path, fixed)
    (found,) = verdict.of("drift")
    assert "slides over the plate's ground by up to" in found.text
    # 7.8 degrees of pan at a focal length of 1029 px
    assert found.value == pytest.approx(verdict.measures["drift_px"])
    assert verdict.measures["drift_px"] > 50.0


def test_object_that_keeps_its_place_on_the_ground_of_a_pan_does_not_slide(plates, tmp_path):
    verdict = checked(plates, "pan", tmp_path, on_ground)
    assert verdict.of("drift") == []
    assert any("--camera-from CAMERA" in note for note in verdict.notes)
    assert "?   object against the plate's ground" in verdict.as_text()


@pytest.mark.parametrize("name", ["pan", "still"])
def test_walking_object_is_no_false_alarm(plates, tmp_path, name):
    verdict = checked(plates, name, tmp_path, walking, body=lambda n: BODIES[n // 3])
    assert verdict.of("drift") == []


def test_walking_object_is_judged_by_the_camera_it_was_rendered_with(plates, tmp_path):
    right = camera_file(tmp_path / "right.json", PAN)
    wrong = camera_file(tmp_path / "wrong.json", STILL[:1])
    verdict = checked(plates, "pan", tmp_path, walking, right)
    assert verdict.of("drift") == []
    assert verdict.measures["drift_px"] < 1.0
    (found,) = checked(plates, "pan", tmp_path, walking, wrong).of("drift")
    assert "the camera does not follow the plate" in found.text


def test_object_on_a_still_plate_does_not_slide(plates, tmp_path):
    verdict = checked(plates, "still", tmp_path, fixed)
    assert verdict.of("drift") == []
    assert verdict.measures["drift_px"] < 0.5
