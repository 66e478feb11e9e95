import json
import math
import os
import subprocess

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.folders import ROOT, SAMPLES

pytestmark = [
    pytest.mark.needs_torch,
    pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning"),
]


def above_horizon(camera, size):
    """How far pixels are above the horizon (H, W), as the sine of their elevation [1]."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    rays = np.stack(
        [x - 0.5 * (width - 1), 0.5 * (height - 1) - y, np.full(x.shape, -camera.focal_px)], -1
    )
    up = Rotation.from_euler("XZ", [camera.pitch, camera.roll]).as_matrix()[1]
    return rays @ up / np.linalg.norm(rays, axis=-1)


def drawn_view(scene, pitch_deg=-12.0, roll_deg=3.0, focal_px=260.0):
    """Rough ground below a bright sky."""
    from models.camera.data import Camera, View

    camera = Camera(math.radians(pitch_deg), math.radians(roll_deg), focal_px)
    sky = above_horizon(camera, (240, 128)) > 0.0
    rough = np.random.default_rng(scene).integers(20, 90, (128, 240))
    code = np.where(sky, 230, rough).astype(np.uint8)
    return View(np.repeat(code[..., None], 3, axis=-1), camera, scene)


@pytest.fixture(scope="module")
def examples():
    from models.camera.data import draw_examples

    return draw_examples([drawn_view(scene, -2.0 * scene) for scene in range(1, 13)], 2, seed=3)


def test_crop_shows_what_its_camera_sees():
    from models.camera.data import draw_crop

    view = drawn_view(1)
    cameras = set()
    for seed in range(12):
        rgb, camera = draw_crop(np.random.default_rng(seed), view)
        above = above_horizon(camera, rgb.shape[1::-1]) * camera.focal_px
        inner = np.s_[4:-4, 4:-4]  # the crop may begin beyond the view by a pixel
        assert (rgb[..., 0][inner][above[inner] > 2.0] > 150).all()
        assert (rgb[..., 0][inner][above[inner] < -2.0] < 150).all()
        cameras.add(camera)
    assert len(cameras) == 12


def test_crop_of_a_view_too_narrow_to_turn_in_is_its_middle():
    from models.camera.data import Camera, View, draw_crop

    y, x = np.mgrid[:128, :240]
    rgb = np.stack([x, y, 0 * x], axis=-1).astype(np.uint8)  # each pixel says where it lies
    view = View(rgb, Camera(-0.2, 0.05, 1e6), 1)
    for seed in range(8):
        crop, camera = draw_crop(np.random.default_rng(seed), view)
        height, width = crop.shape[:2]
        reduced = min(240 / width, 128 / height)
        assert camera == Camera(-0.2, 0.05, 1e6 / reduced)
        y, x = np.mgrid[:height, :width]
        columns = (x - 0.5 * (width - 1)) * reduced + 0.5 * 239
        rows = (y - 0.5 * (height - 1)) * reduced + 0.5 * 127
        inner = np.s_[2:-2, 2:-2]
        np.testing.assert_allclose(crop[..., 0][inner], columns[inner], atol=1.0)
        np.testing.assert_allclose(crop[..., 1][inner], rows[inner], atol=1.0)


def test_scenes_kept_apart_are_not_trained_on(examples):
    apart, training = examples.part(apart=True), examples.part(apart=False)
    assert set(apart.scenes) == {10} and 10 not in training.scenes
    assert len(apart.scenes) + len(training.scenes) == len(examples.scenes) == 24


def test_rare_pitches_are_drawn_as_often_as_others():
    from models.camera.data import Examples
    from models.camera.train import Drawn

    pitches = np.float32([-0.1] * 900 + [-0.6] * 100)
    cameras = np.stack([pitches, 0 * pitches, 0 * pitches], axis=1)
    some = Examples(np.zeros((1000, 1, 1, 1), np.float16), cameras, pitches, np.arange(1000))
    shares = np.diff(Drawn.evenly(some).ends, prepend=0.0)
    assert shares[:900].sum() == pytest.approx(0.5) and shares.sum() == pytest.approx(1.0)


def test_camera_training_resumes_from_a_checkpoint(examples, resume):
    from models.camera.train import Drawn, Recipe, Run, normalise, validate

    recipe = Recipe(minutes=1, batch=8)
    run, again = Run(recipe), Run(recipe)
    for network in (run.network, run.average):
        normalise(network, examples)
    resume(run, again, Drawn.evenly(examples), 3)
    assert validate(again.average, examples) == validate(run.average, examples)


def test_likelihood_is_that_of_the_cue_that_the_solver_uses():
    import torch

    from models.camera.network import scaled, surprise
    from nlens_video.solve.still.picture_cue import picture_cue

    rng = np.random.default_rng(1)
    answer = rng.normal(0.0, 0.5, 9).astype(np.float32)
    answer[[1, 6, 8]] = 0.0  # else the mirrored picture, read alike, contradicts
    cue = picture_cue(lambda features, aspect: answer, np.zeros((128, 128, 3), np.float32))
    cameras = cue.middle + rng.normal(0.0, 0.01, (5, 3))
    truth = scaled(torch.from_numpy(cameras).float())
    told = surprise(torch.from_numpy(answer)[None].expand(5, -1), truth).numpy()
    # the likeliest of the one is the likeliest of the other
    assert (np.argsort(told) == np.argsort(-cue.log(cameras))).all()


def test_exported_camera_network_agrees_with_the_trained_one(tmp_path):
    import torch

    from models.camera.export import export
    from models.camera.network import CameraNet
    from nlens_video.networks.camera_network import OnnxCameraNetwork
    from nlens_video.solve.still.picture_cue import CHANNELS, COLUMNS, ROWS

    torch.manual_seed(0)
    network = CameraNet().eval()
    export(network, tmp_path / "camera.onnx")
    exported = OnnxCameraNetwork(tmp_path / "camera.onnx")
    features = np.random.default_rng(0).random((ROWS, COLUMNS, CHANNELS), dtype=np.float32)
    aspect = np.float32([0.5])
    with torch.inference_mode():
        answer = network(torch.from_numpy(features)[None], torch.from_numpy(aspect)[None])[0]
    np.testing.assert_allclose(exported(features, aspect), answer.numpy(), atol=2e-3)
    with pytest.raises(ValueError, match="features.shape"):
        exported(features[:, :4], aspect)


def test_torch_and_onnx_agree_on_the_shipped_camera_weights():
    import torch

    from models.camera.export import HERE, load_network
    from nlens_video.networks.camera_network import OnnxCameraNetwork
    from nlens_video.networks.model_store import find_model
    from nlens_video.solve.still.picture_cue import CHANNELS, COLUMNS, ROWS

    features = np.random.default_rng(0).random((ROWS, COLUMNS, CHANNELS), dtype=np.float32)
    aspect = np.float32([0.5])
    with torch.inference_mode():
        answer = load_network(HERE / "weights.pt")(
            torch.from_numpy(features)[None], torch.from_numpy(aspect)[None]
        )[0]
    shipped = OnnxCameraNetwork(find_model("camera").path)(features, aspect)
    np.testing.assert_allclose(shipped, answer.numpy(), atol=5e-3)


@pytest.mark.slow
@pytest.mark.needs_blender
def test_rendered_views_carry_their_cameras(tmp_path, monkeypatch):
    import sys

    from models.camera.data import draw_examples, load_view

    monkeypatch.syspath_prepend(str(SAMPLES))
    from truth.plan import draw_view

    path = os.pathsep.join([str(SAMPLES), *(p for p in sys.path if "site-packages" in p)])
    subprocess.run(
        ["blender", "-b", "-t", "1", "--python-use-system-env", "--python-exit-code", "3",
         "-P", ROOT / "models/camera/render.py", "--", tmp_path, "--first", "7", "--scenes", "1"],
        check=True, capture_output=True, env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip
    files = sorted(tmp_path.glob("*.json"))
    assert [file.stem for file in files] == [f"7_{view}" for view in range(5)]
    known = json.loads(files[0].read_text())
    assert known["pitch_deg"] in {draw_view(7, kind).pitch_deg for kind in ("wild", "built")}
    views = [view for view in map(load_view, files) if view is not None]
    assert views and all(view.rgb.shape == (128, 240, 3) for view in views)
    assert np.isfinite(draw_examples(views, 1, seed=1).features).all()
