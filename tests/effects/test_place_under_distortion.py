"""An object stands where `--at` says, wherever the distortion of the lens is known from."""

import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens

from nlens_video.core.box import undistorted_radius

pytestmark = pytest.mark.needs_gl
AT, K1 = (0.85, 0.85), 0.3


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bent")
    shots.write_png(folder / "plate.png", shots.grey())
    shots.cube_glb(folder / "cube.glb", camera=False)
    shots.fit_json(folder / "fit.json")
    shots.camera_json(folder / "straight.json")
    shots.camera_json(folder / "bent.json", distortion_k1=K1)
    return folder


def composite(files, out, effects, *words, plate=None):
    """The composite, and the columns and rows on which it differs from the plate."""
    plate = plate or files / "plate.png"
    run = nlens(
        plate, files / "cube.glb", out, "--fit", files / "fit.json",
        "--effects", effects, "--at", "{},{}".format(*AT), "--size", "0.06", *words,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    seen = cv2.imread(str(out)).astype(int)
    changed = (seen != cv2.imread(str(plate))).any(axis=2)
    return seen, np.flatnonzero(changed.any(axis=0)), np.flatnonzero(changed.any(axis=1))


def test_given_distortion_places_as_that_of_the_camera_file(files, tmp_path):
    solved, columns, rows = composite(
        files, tmp_path / "a.png", "distortion", "--camera-from", files / "bent.json"
    )
    given, *_ = composite(
        files, tmp_path / "b.png", "distortion",
        "--camera-from", files / "straight.json", "--distortion", K1,
    )  # fmt: skip
    assert np.array_equal(solved, given)
    _assert_at(columns, rows)


def test_distortion_that_is_left_out_does_not_move_the_object(files, tmp_path):
    bent, columns, rows = composite(
        files, tmp_path / "a.png", "none", "--camera-from", files / "bent.json"
    )
    straight, *_ = composite(
        files, tmp_path / "b.png", "none", "--camera-from", files / "straight.json"
    )
    assert np.array_equal(bent, straight)
    _assert_at(columns, rows)


def test_given_distortion_places_under_a_horizon_by_eye(files, tmp_path):
    words = ("--horizon", "0.2", "--distortion", "0.6")
    _assert_at(*composite(files, tmp_path / "a.png", "distortion", *words)[1:])


def test_distortion_that_is_measured_on_the_plate_places_too(files, tmp_path):
    height, width = 540, 960
    y, x = np.mgrid[0:height, 0:width] + 0.5
    across, down = x - 0.5 * width, y - 0.5 * height
    radius = np.hypot(across, down) / np.hypot(0.5 * width, 0.5 * height)
    straight = down * undistorted_radius(-0.08, 0.0, radius) / radius
    storeys = np.where(np.sin(0.11 * straight) > 0, 200, 60).astype(np.uint8)
    shots.write_png(tmp_path / "storeys.png", np.repeat(storeys[..., None], 3, axis=2))
    words = ("--camera-from", files / "straight.json")
    plate = tmp_path / "storeys.png"
    bent, columns, rows = composite(files, tmp_path / "a.png", "distortion", *words, plate=plate)
    straight, *_ = composite(files, tmp_path / "b.png", "none", *words, plate=plate)
    assert not np.array_equal(bent, straight)
    _assert_at(columns / 2, rows / 2)


def _assert_at(columns, rows):
    """The middle of the foot is at AT; the cube's near edge lies a little below it."""
    assert 0.5 * (columns[0] + columns[-1] + 1) == pytest.approx(AT[0] * shots.WIDTH, abs=3)
    assert 0 <= rows[-1] - AT[1] * shots.HEIGHT < 8
