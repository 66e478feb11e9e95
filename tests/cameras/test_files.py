"""Cameras of other programs are read, and what is written is read again."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nlens_video.cameras.files import camera_bytes, read_camera
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError, UsageError

SIZE, RATE = (960, 512), Fraction(24)


def pose_of(pitch=-15.0, yaw=10.0, roll=1.0, eye=(0.2, 1.6, 0.5)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    pose[:3, 3] = eye
    return pose


def path_of(count=3, **angles):
    keys = tuple(
        CameraKey(
            index=n, pts_s=n / 24, fov_x_deg=50.0,
            world_to_camera=np.linalg.inv(pose_of(eye=(0.2 + 0.1 * n, 1.6, 0.5), **angles)),
        )
        for n in range(count)
    )  # fmt: skip
    return SolvedCamera(width=SIZE[0], height=SIZE[1], keys=keys, path="moving")


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


def fspy(pose):
    """fSpy's export of a camera; its world has Z up."""
    z_up = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    camera = z_up @ pose
    return {
        "principalPoint": {"x": 0.01, "y": -0.02},
        "viewTransform": {"rows": np.linalg.inv(camera).tolist()},
        "cameraTransform": {"rows": camera.tolist()},
        "horizontalFieldOfView": math.radians(50.0),
        "verticalFieldOfView": 0.5,
        "imageWidth": SIZE[0],
        "imageHeight": SIZE[1],
    }


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


def write_colmap(folder, poses, points, focal=1029.0):
    """A text model of COLMAP, whose cameras look along +Z with Y down."""
    folder.mkdir()
    (folder / "cameras.txt").write_text(f"# cameras\n1 SIMPLE_PINHOLE 960 512 {focal} 480 256\n")
    lines = []
    for n, pose in enumerate(poses):
        matrix = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(pose)
        x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
        shift = " ".join(f"{value:.12g}" for value in matrix[:3, 3])
        lines += [f"{n + 1} {w} {x} {y} {z} {shift} 1 shot/frame_{n + 7:04d}.png", "1 2 -1"]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text(
        "".join(
            f"{n} {x:.9g} {y:.9g} {z:.9g} 9 9 9 0.1 1 1\n" for n, (x, y, z) in enumerate(points)
        )
    )
    return folder


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
