"""Cameras of other programs are read, and what is written is read again."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.camera_files import RATE, SIZE, fspy, path_of, pose_of, write_colmap

from nlens_video.cameras.files import camera_bytes, read_camera
from nlens_video.core.errors import SceneError, UsageError


def test_camera_json_is_read(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(path_of().to_json())
    assert read_camera(path, SIZE, RATE).to_json() == path_of().to_json()


@given(
    pitch=st.floats(-80.0, 80.0), yaw=st.floats(-179.0, 179.0), roll=st.floats(-80.0, 80.0)
)  # fmt: skip
def test_chan_is_read_as_it_was_written(tmp_path_factory, pitch, yaw, roll):
    path = tmp_path_factory.mktemp("chan") / "camera.chan"
    path.write_bytes(camera_bytes(path_of(pitch=pitch, yaw=yaw, roll=roll), path))
    read = read_camera(path, SIZE, RATE)
    for one, other in zip(read.keys, path_of(pitch=pitch, yaw=yaw, roll=roll).keys, strict=True):
        assert np.allclose(one.world_to_camera, other.world_to_camera, atol=1e-6)
        assert one.fov_x_deg == pytest.approx(other.fov_x_deg, abs=1e-6)
        assert one.pts_s == other.pts_s


def test_chan_of_nuke_rotates_about_z_then_x_then_y(tmp_path):
    path = tmp_path / "camera.chan"
    path.write_text("1001\t1 2 3\t-15 30 5\t27.5\n1002 1 2 3 -15 30 5 27.5\n")
    first = read_camera(path, SIZE, RATE).keys[0]
    x, y, z = (
        Rotation.from_euler(axis, angle, degrees=True)
        for axis, angle in (("X", -15.0), ("Y", 30.0), ("Z", 5.0))
    )
    assert first.index == 0
    assert np.allclose(first.world_from_camera[:3, :3], (y * x * z).as_matrix())
    assert np.allclose(first.world_from_camera[:3, 3], (1.0, 2.0, 3.0))
    tan = math.tan(math.radians(27.5 / 2)) * SIZE[0] / SIZE[1]
    assert first.fov_x_deg == pytest.approx(2 * math.degrees(math.atan(tan)))


@pytest.mark.parametrize(
    "text",
    ["", "1 2 3\n", "1 0 0 0 0 0 0 190\n", "1 0 0 0 0 0 0 x\n", "1 0 0 0 0 0 0 nan\n",
     "1 0 0 0 0 0 0 30\n1 0 0 0 0 0 0 30\n"],
)  # fmt: skip
def test_damaged_chan_is_refused(tmp_path, text):
    path = tmp_path / "camera.chan"
    path.write_text(text)
    with pytest.raises(SceneError, match="camera.chan"):
        read_camera(path, SIZE, RATE)


def test_export_of_fspy_is_read_with_the_ground_at_its_origin(tmp_path):
    path = tmp_path / "plate.json"
    path.write_text(json.dumps(fspy(pose_of())))
    camera = read_camera(path, SIZE, RATE)
    assert np.allclose(camera.keys[0].world_from_camera, pose_of())
    assert camera.keys[0].fov_x_deg == pytest.approx(50.0)
    assert camera.principal_px == pytest.approx((480 + 4.8, 256 + 9.6))
    assert camera.ground_y == 0.0


@pytest.mark.parametrize("missing", ["imageWidth", "principalPoint", "viewTransform"])
def test_export_of_fspy_with_a_wrong_value_is_refused(tmp_path, missing):
    path = tmp_path / "plate.json"
    path.write_text(json.dumps({**fspy(pose_of()), missing: {}}))
    with pytest.raises(SceneError, match="fSpy"):
        read_camera(path, SIZE, RATE)


def test_model_of_colmap_is_put_on_the_ground_of_its_points(tmp_path):
    rng = np.random.default_rng(2)
    ground = np.column_stack([rng.uniform(-3, 3, 200), np.zeros(200), rng.uniform(-9, -1, 200)])
    turn = Rotation.from_euler("xyz", (70.0, -20.0, 130.0), degrees=True).as_matrix()
    moved = 0.3 * ground @ turn.T + 4.0
    poses = []
    for n in range(3):
        pose = pose_of(yaw=2.0 * n, roll=0.0, eye=(0.1 * n, 1.5, 0.0))
        pose[:3, 3] = 0.3 * turn @ pose[:3, 3] + 4.0
        pose[:3, :3] = turn @ pose[:3, :3]
        poses.append(pose)
    camera = read_camera(write_colmap(tmp_path / "sparse", poses, moved), SIZE, RATE)
    assert [key.index for key in camera.keys] == [0, 1, 2]
    assert camera.keys[0].pitch_deg == pytest.approx(-15.0, abs=1e-3)
    assert camera.keys[0].roll_deg == pytest.approx(0.0, abs=1e-3)
    heights = [key.world_from_camera[1, 3] for key in camera.keys]
    assert heights == pytest.approx([1.6] * 3, abs=1e-3)
    assert camera.keys[0].fov_x_deg == pytest.approx(2 * math.degrees(math.atan(480 / 1029.0)))


@pytest.mark.parametrize("name", ["f_{}.jp2", "f.{}.j2k", "{}.3fr", "f.{}", "cam2/f{}", "{}/l.tif"])
def test_frame_of_a_picture_of_colmap_is_the_last_number_before_its_suffix(tmp_path, name):
    rng = np.random.default_rng(2)
    ground = np.column_stack([rng.uniform(-3, 3, 200), np.zeros(200), rng.uniform(-9, -1, 200)])
    poses = [pose_of(roll=0.0, eye=(0.1 * n, 1.6, 0.0)) for n in range(3)]
    model = write_colmap(tmp_path / "sparse", poses, ground)
    pictures = (model / "images.txt").read_text()
    for n, frame in enumerate((10, 12, 15)):
        pictures = pictures.replace(f"shot/frame_{n + 7:04d}.png", name.format(f"{frame:04d}"))
    (model / "images.txt").write_text(pictures)
    assert [key.index for key in read_camera(model, SIZE, RATE).keys] == [0, 2, 5]


def test_model_of_colmap_without_a_ground_is_refused(tmp_path):
    folder = write_colmap(tmp_path / "sparse", [pose_of()], np.zeros((5, 3)))
    with pytest.raises(SceneError, match="no ground among 5 points"):
        read_camera(folder, SIZE, RATE)


def test_folder_without_a_model_is_refused(tmp_path):
    with pytest.raises(SceneError, match="cameras.txt"):
        read_camera(tmp_path, SIZE, RATE)


@pytest.mark.parametrize("text", ["", "{", "[]", "hello"])
def test_file_that_holds_no_camera_is_refused(tmp_path, text):
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises(SceneError):
        read_camera(path, SIZE, RATE)


def test_name_without_a_format_is_refused(tmp_path):
    with pytest.raises(UsageError, match=".json, .glb, .chan, .usda"):
        camera_bytes(path_of(), tmp_path / "camera.txt")
