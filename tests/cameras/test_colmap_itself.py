"""Models that COLMAP itself has written."""

import numpy as np
import pycolmap
import pytest
from support.camera_files import RATE, SIZE, pose_of

from nlens_video.cameras.files import read_camera
from nlens_video.core.errors import SceneError


@pytest.fixture
def model():
    """Three pictures, none of which shows a point, and points on a ground."""
    found = pycolmap.Reconstruction()
    found.add_camera_with_trivial_rig(
        pycolmap.Camera(
            model="SIMPLE_RADIAL", width=SIZE[0], height=SIZE[1], params=[900, 480, 256, -0.05],
            camera_id=1,
        )
    )  # fmt: skip
    rng = np.random.default_rng(2)
    for x, z in zip(rng.uniform(-3, 3, 200), rng.uniform(-9, -1, 200), strict=True):
        found.add_point3D(np.array([x, 0.0, z]), pycolmap.Track(), np.zeros(3, np.uint8))
    for n in range(3):
        matrix = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(
            pose_of(yaw=0.0, roll=0.0, eye=(0.1 * n, 1.6, 0.0))
        )
        picture = pycolmap.Image(
            name=f"frame_{n + 1:04d}.png", camera_id=1, image_id=n + 1, keypoints=np.zeros((0, 2))
        )
        found.add_image_with_trivial_frame(picture, pycolmap.Rigid3d(matrix[:3]))
    return found


def test_text_model_is_read_whole_with_its_distortion(model, tmp_path):
    model.write_text(tmp_path)
    camera = read_camera(tmp_path, SIZE, RATE)
    assert [key.index for key in camera.keys] == [0, 1, 2]
    for n, key in enumerate(camera.keys):
        pose = pose_of(yaw=0.0, roll=0.0, eye=(0.1 * n, 1.6, 0.0))
        assert np.allclose(key.world_from_camera, pose, atol=1e-6)
    assert camera.distortion_k1 == pytest.approx(-0.05)
    assert camera.keys[0].fov_x_deg == pytest.approx(2 * np.degrees(np.arctan(480 / 900)))


@pytest.mark.parametrize("name", ["images.txt", "points3D.txt"])
def test_text_model_that_is_cut_off_after_a_line_is_refused(model, tmp_path, name):
    model.write_text(tmp_path)
    lines = (tmp_path / name).read_text().splitlines(keepends=True)
    (tmp_path / name).write_text("".join(lines[:-2]))
    with pytest.raises(SceneError, match="cut off: export it again"):
        read_camera(tmp_path, SIZE, RATE)


def test_binary_model_names_the_command_that_makes_text_of_it(model, tmp_path):
    model.write_binary(tmp_path)
    with pytest.raises(SceneError, match="a binary model of COLMAP.*--output_type TXT"):
        read_camera(tmp_path, SIZE, RATE)
