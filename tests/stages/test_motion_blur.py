"""Motion blur: against hand-worked kernels and against hundreds of moments."""

import json

import cv2
import numpy as np
import pytest
import shots
from hypothesis import given
from hypothesis import strategies as st
from scene.glb_builder import GlbBuilder

from nlens_video.cli import main
from nlens_video.effects.planner import MOTION_BLUR, Circumstances, decide
from nlens_video.frames import BlurredLayer, Box
from nlens_video.shutter import Shutter
from nlens_video.stages.motion_blur import (
    MOST_MOMENTS,
    measure_motion,
    moment_count,
    smeared,
    through_shutter,
    way_kernel,
)

FRAME = Box(0, 0, shots.WIDTH, shots.HEIGHT)


def test_kernel_of_a_way_along_the_rows_is_the_share_of_the_time_over_each_pixel():
    assert way_kernel(np.array([4.0, 0.0])) == pytest.approx(
        np.array([[0.125, 0.25, 0.25, 0.25, 0.125]]), abs=2e-3
    )


@given(st.floats(-40, 40), st.floats(-40, 40))
def test_kernel_keeps_light_and_place(across, down):
    kernel = way_kernel(np.array([across, down]))
    assert kernel.sum() == pytest.approx(1, abs=1e-5)
    y, x = (np.arange(n) - n // 2 for n in kernel.shape)
    assert (kernel.sum(0) * x).sum() == pytest.approx(0, abs=1e-3)
    assert (kernel.sum(1) * y).sum() == pytest.approx(0, abs=1e-3)


def test_object_that_does_not_move_comes_back_itself():
    layer = BlurredLayer(box=Box(5, 5, 9, 9), rgba=np.ones((4, 4, 4), np.float32))
    assert smeared(layer, np.zeros(2), FRAME) is layer


def test_object_that_the_frame_cuts_stays_opaque_at_the_border():
    layer = BlurredLayer(box=Box(0, 10, 40, 50), rgba=np.ones((40, 40, 4), np.float32))
    out = smeared(layer, np.array([12.0, 0.0]), FRAME)
    assert out.box == Box(0, 10, 46, 50)
    assert out.rgba[:, 0] == pytest.approx(1.0, abs=1e-6)
    assert out.rgba[:, 39, 3] == pytest.approx(0.5 + 1 / 24, abs=0.01)


def test_number_of_moments_is_odd_and_limited():
    counts = [moment_count(spread, 0.0) for spread in np.linspace(0, 200, 300)]
    assert all(count % 2 for count in counts)
    assert counts == sorted(counts)
    assert max(counts) == MOST_MOMENTS
    assert moment_count(20.0, 40.0) < moment_count(20.0, 0.0)


def test_motion_below_a_pixel_is_not_called_for():
    def places(moment):
        return np.array([[10.0 + 0.9 * moment, 20.0]])

    assert measure_motion(places, (-0.5, 0.0, 0.5), 0.0) is None


def test_vertices_behind_the_camera_have_no_motion_on_the_screen():
    assert measure_motion(lambda moment: None, (0.0, 0.5, 1.0), 0.0) is None


@pytest.mark.parametrize(
    ("scene", "wanted", "words"),
    [
        (Circumstances(moves=True, shutter=Shutter(frame_s=0.04)), True, "180 degrees, assumed"),
        (Circumstances(moves=False, shutter=Shutter(frame_s=0.04)), False, "moves"),
        (Circumstances(moves=True, shutter=Shutter()), False, "still"),
        (Circumstances(moves=True, shutter=Shutter(angle_deg=0, frame_s=1)), False, "--shutter 0"),
        (Circumstances(moves=True, pre_rendered=True), False, "layers"),
    ],
)
def test_motion_blur_is_decided_from_the_scene(scene, wanted, words):
    (decision,) = (one for one in decide("auto", scene) if one.effect == MOTION_BLUR)
    assert decision.wanted is wanted
    assert words in decision.reason


def spinning_glb(path, turn=np.pi / 3, way=0.5, seconds=0.2):
    """A textured card that turns and slides at once."""
    builder = GlbBuilder()
    rng = np.random.default_rng(3)
    pixels = cv2.resize(rng.integers(0, 256, (12, 12, 3), np.uint8), (96, 96), interpolation=0)
    material = builder.add(
        "materials",
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": builder.texture(pixels)}},
            "extensions": {"KHR_materials_unlit": {}},
        },
    )
    node = builder.node(mesh=builder.mesh(material=material), scale=[0.25] * 3)
    times = np.linspace(0, seconds, 9)
    angles = np.linspace(0, turn, 9) / 2
    turns = np.stack([0 * angles, 0 * angles, np.sin(angles), np.cos(angles)], axis=1)
    slide = np.stack([np.linspace(0, way, 9), 0 * angles + 0.4, 0 * angles - 1.6], axis=1)
    builder.animation(
        (node, "rotation", times, turns, "LINEAR"),
        (node, "translation", times, slide, "LINEAR"),
    )
    builder.node(camera=builder.camera(shots.YFOV), matrix=shots.camera_pose().T.ravel().tolist())
    return builder.write(path)


def psnr(a, b, where):
    return -10 * np.log10(np.mean((a - b)[where] ** 2))


@pytest.mark.needs_gl
@pytest.mark.parametrize("coc_px", [0.0, 12.0])
def test_turning_and_sliding_card_is_what_hundreds_of_moments_show(tmp_path, coc_px):
    from nlens_video.backends.render_pyrender import PyrenderObjectRenderer
    from nlens_video.kernels.scatter import blur_reach, scatter
    from nlens_video.lens import LensFit
    from nlens_video.scene.gltf import Scene
    from nlens_video.stages.l_reblur import ReblurLayer, crop_to_frame, object_coc

    scene = Scene.load(spinning_glb(tmp_path / "card.glb"))
    camera = shots.camera()
    shutter = Shutter(angle_deg=180.0, frame_s=1 / 12)
    fit = LensFit(slope=0.0, intercept=coc_px, width=shots.WIDTH, height=shots.HEIGHT)
    lens = ReblurLayer(scatter=scatter, reach=blur_reach, pixel_aspect=1.0)

    def through_lens(layer):
        if not coc_px:
            return crop_to_frame(layer, FRAME)
        return lens(object_coc(layer, fit), FRAME)

    def places(moment):
        return camera.pixels(camera.to_camera(scene.pose(moment).vertices().astype(np.float64)))

    motion = measure_motion(
        places, (0.1 - 0.5 * shutter.open_s, 0.1, 0.1 + 0.5 * shutter.open_s), coc_px
    )
    assert motion is not None and motion.span_px > 20

    def exposed(ways):
        with PyrenderObjectRenderer(scene) as renderer:
            moments = shutter.middles(0.1, len(ways))
            layers = (renderer.render(moment, camera) for moment in moments)
            layer = through_shutter(layers, ways, through_lens, FRAME)
        whole = np.zeros((FRAME.height, FRAME.width, 4), np.float32)
        whole[layer.box.slices_in(FRAME)] = layer.rgba
        return whole

    truth = exposed(np.zeros((301, 2)))
    result = exposed(motion.ways)
    sharp = exposed(np.zeros((1, 2)))
    where = truth[..., 3] > 0
    assert len(motion.ways) < 12
    assert psnr(result, truth, where) > 42
    assert psnr(sharp, truth, where) < 30


@pytest.mark.needs_gl
def test_command_smears_a_moving_object_and_leaves_it_sharp_when_told_to(tmp_path):
    plate = shots.write_video(tmp_path / "in.mp4", frames=4, audio=False)
    glb = spinning_glb(tmp_path / "card.glb")
    fit = shots.fit_json(tmp_path / "fit.json")
    outputs = {}
    for name, words in (
        ("auto", []),
        ("closed", ["--shutter", "0"]),
        ("without", ["--effects", "defocus"]),
        ("named", ["--effects", "defocus,motion-blur", "--shutter", "180"]),
    ):
        out = tmp_path / f"{name}_%04d.png"
        timings = tmp_path / f"{name}.json"
        common = [str(plate), str(glb), str(out), "--fit", str(fit), "--timings", str(timings)]
        assert main([*common, "-q", *words]) == 0
        outputs[name] = cv2.imread(str(out) % 2)
        nodes = json.loads(timings.read_text())["frames"][2]["nodes"]
        assert ("expose" in nodes) is (name in ("auto", "named"))
    assert np.array_equal(outputs["closed"], outputs["without"])
    assert np.array_equal(outputs["auto"], outputs["named"])
    assert np.abs(outputs["auto"].astype(int) - outputs["closed"]).max() > 30
