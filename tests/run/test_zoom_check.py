"""A plate that zooms while the GLB's camera does not is told; one that agrees is not."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import shots
from support.glb_builder import GlbBuilder

from nlens_video.cli.main import main
from nlens_video.run.checks.zoom import ZoomTracker
from nlens_video.video.pixels.picture import ArrayPicture

FRAMES = 30


def scaled(rgb, factor, turn=0.0, shift=(0.0, 0.0)):
    height, width = rgb.shape[:2]
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), turn, factor)
    matrix[:, 2] += shift
    return cv2.warpAffine(rgb, matrix, (width, height), borderMode=cv2.BORDER_REFLECT)


def picture(rgb, seed=0, noise=1.5):
    grain = noise * np.random.default_rng(seed).standard_normal(rgb.shape)
    return ArrayPicture(np.uint8(np.clip(rgb + grain, 0, 255)), "rgb")


@pytest.mark.parametrize("total", [0.7, 0.9, 1.0, 1.15, 1.6])
def test_zoom_is_measured_over_many_frames_and_a_pan_is_not_a_zoom(total):
    rgb = shots.plate()
    watch = ZoomTracker()
    for at in range(21):
        factor = total ** (at / 20)
        zoom = watch(picture(scaled(rgb, factor, shift=(1.5 * at, 0.0)), at))
    assert zoom.shot == 0
    assert np.exp(zoom.log_scale) == pytest.approx(total, rel=0.015)


def test_zoom_tracking_restarts_at_a_cut_and_ignores_plates_without_detail():
    watch = ZoomTracker()
    assert watch(picture(shots.plate())).shot == 0
    other = watch(picture(np.rot90(shots.plate(9), 2), 1))
    assert (other.log_scale, other.shot) == (0.0, 1)
    grey = ZoomTracker()
    assert all(grey(picture(shots.grey(), seed, 0.0)).log_scale == 0.0 for seed in range(3))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A plate that zooms in by a fifth, one that does not, and the same of cameras."""
    folder = tmp_path_factory.mktemp("zoom")
    rgb = shots.plate()
    for at in range(FRAMES):
        grown = scaled(rgb, 1.2 ** (at / (FRAMES - 1)))
        shots.write_png(folder / f"zoom_{at:04d}.png", picture(grown, at).array)
        shots.write_png(folder / f"still_{at:04d}.png", picture(rgb, at).array)
    shots.cube_glb(folder / "still.glb")
    shots.fit_json(folder / "fit.json")
    moving = GlbBuilder()
    cube = moving.mesh(shots.CUBE, shots.CUBE_FACES)
    moving.node(mesh=cube, translation=[0, 0, -1.6], scale=[0.35] * 3)
    lens = moving.camera(shots.YFOV, aspect=shots.WIDTH / shots.HEIGHT)
    pose = shots.camera_pose()
    tilt = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    camera = moving.node(camera=lens, translation=pose[:3, 3].tolist(), rotation=tilt)
    ends = np.array([pose[:3, 3], pose[:3, 3] + [0, 0, -0.3]], np.float32)
    moving.animation((camera, "translation", [0.0, 1.2], ends, "LINEAR"))
    moving.write(folder / "moving.glb")
    return folder


def notes(folder, plate, glb, capsys):
    words = [folder / f"{plate}_%04d.png", folder / f"{glb}.glb", folder / "out_%04d.png"]
    more = ["--input-rate", "25", "--fit", folder / "fit.json", "--preset", "draft"]
    assert main([*map(str, words), *map(str, more)]) == 0
    said = capsys.readouterr().err
    return [line for line in said.splitlines() if "GLB's camera has" in line]


@pytest.mark.slow
@pytest.mark.needs_gl
def test_zoom_that_the_scenes_camera_lacks_is_reported(files, capsys):
    (line,) = notes(files, "zoom", "still", capsys)
    assert "grown by 1" in line or "grown by 2" in line
    assert "kept its size" in line and "field of view" in line


@pytest.mark.slow
@pytest.mark.needs_gl
def test_no_zoom_is_reported_if_both_are_static_or_the_camera_moves(files, capsys):
    assert notes(files, "still", "still", capsys) == []
    assert notes(files, "zoom", "moving", capsys) == []
