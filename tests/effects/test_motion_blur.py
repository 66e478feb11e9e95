"""Motion blur against hand-worked kernels and hundreds of shutter samples."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from support import shots
from support.glb_builder import GlbBuilder

from nlens_video import Compositor
from nlens_video.cli.main import main
from nlens_video.core.layers import BlurredLayer, Box, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Shutter
from nlens_video.effects.motion_blur import (
    MOST_MOMENTS,
    line_kernel,
    mean_layer,
    mean_of_blurred,
    measure_motion,
    moment_count,
    motion_blurred,
)
from nlens_video.effects.planner import MOTION_BLUR, ShotFacts, decide
from nlens_video.graph.nodes.motion_blur import followed
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.scene.camera import Camera
from nlens_video.stages.l_reblur import ReblurLayer, crop_to_frame, object_coc

FRAME = Box(0, 0, shots.WIDTH, shots.HEIGHT)


def test_line_kernel_weights_each_pixel_by_the_time_spent_over_it():
    assert line_kernel(np.array([4.0, 0.0])) == pytest.approx(
        np.array([[0.125, 0.25, 0.25, 0.25, 0.125]]), abs=2e-3
    )


@given(st.floats(-40, 40), st.floats(-40, 40))
def test_line_kernel_keeps_energy_and_position(across, down):
    kernel = line_kernel(np.array([across, down]))
    assert kernel.sum() == pytest.approx(1, abs=1e-5)
    y, x = (np.arange(n) - n // 2 for n in kernel.shape)
    assert (kernel.sum(0) * x).sum() == pytest.approx(0, abs=1e-3)
    assert (kernel.sum(1) * y).sum() == pytest.approx(0, abs=1e-3)


def test_object_at_rest_is_returned_unchanged():
    layer = BlurredLayer(box=Box(5, 5, 9, 9), rgba=np.ones((4, 4, 4), np.float32))
    assert motion_blurred(layer, np.zeros(2), FRAME) is layer


def test_motion_blurred_object_cut_by_the_frame_stays_opaque_at_the_border():
    layer = BlurredLayer(box=Box(0, 10, 40, 50), rgba=np.ones((40, 40, 4), np.float32))
    out = motion_blurred(layer, np.array([12.0, 0.0]), FRAME)
    assert out.box == Box(0, 10, 46, 50)
    assert out.rgba[:, 0] == pytest.approx(1.0, abs=1e-6)
    assert out.rgba[:, 39, 3] == pytest.approx(0.5 + 1 / 24, abs=0.01)


def test_number_of_shutter_samples_is_odd_and_limited():
    counts = [moment_count(spread, 0.0) for spread in np.linspace(0, 200, 300)]
    assert all(count % 2 for count in counts)
    assert counts == sorted(counts)
    assert max(counts) == MOST_MOMENTS
    assert moment_count(20.0, 40.0) < moment_count(20.0, 0.0)


def test_motion_below_a_pixel_needs_no_blur():
    places = [np.array([[10.0 + 0.9 * moment, 20.0]]) for moment in (-0.5, 0.0, 0.5)]
    assert measure_motion(places, np.zeros((3, 1))) is None
    assert measure_motion([3.0 * seen for seen in places], np.zeros((3, 1))) is not None


def test_fast_motion_hidden_by_defocus_needs_fewer_shutter_samples():
    still, moved = np.zeros((3, 2)), np.array([[0.0, 0.0], [2.0, 0.0], [16.0, 0.0]])
    places = [still, 0.5 * moved, moved]
    in_focus, fast_blurred = (
        measure_motion(places, np.tile(coc_px, (3, 1))) for coc_px in ([0.0] * 3, [0.0, 0.0, 20.0])
    )
    assert len(in_focus.ways) == 5 and len(fast_blurred.ways) == 3
    assert in_focus.spread_px == fast_blurred.spread_px == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("scene", "wanted", "words"),
    [
        (
            ShotFacts(moves=True, shutter=Shutter(frame_s=0.04)),
            True,
            "(180 degrees or 0.02 s, assumed)",
        ),
        (ShotFacts(moves=False, shutter=Shutter(frame_s=0.04)), False, "moves"),
        (ShotFacts(moves=True, shutter=Shutter()), False, "still"),
        (
            ShotFacts(moves=True, shutter=Shutter(angle_deg=0, frame_s=1)),
            False,
            "--shutter-angle 0",
        ),
        (ShotFacts(moves=True, pre_rendered=True), False, "layers"),
    ],
)
def test_motion_blur_is_planned_from_the_scenes_animation(scene, wanted, words):
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


def card_at(x, depth, shade):
    """A square of 40 px on a layer of its own, its depth the same all over."""
    rgba = np.zeros((60, 60, 4), np.float32)
    rgba[10:50, 10:50] = (shade, 0.5, 0.2, 1.0)
    away = np.where(rgba[..., 3] > 0.0, np.float32(depth), np.float32(np.inf))
    return ObjectLayer(box=Box(x, 30, x + 60, 90), rgba=rgba, depth=away)


@pytest.mark.parametrize(("nearer", "parts"), [(0.004, 1), (0.012, 3)])
def test_shutter_samples_are_reblurred_together_unless_their_coc_changes(nearer, parts):
    # it slides by 8 px and comes nearer, out of the focus at depth 1
    layers = [card_at(50 + 2 * i, 1.0 - nearer * i, 0.3 + 0.01 * i) for i in range(5)]
    fit = LensFit(slope=60.0, intercept=-60.0, width=shots.WIDTH, height=shots.HEIGHT)
    lens = ReblurLayer(scatter=scatter, reach=blur_reach)
    frame = Box(0, 0, 200, 120)

    def through_lens(layer):
        return lens(object_coc(layer, fit), frame)

    def whole(layer):
        out = np.zeros((120, 200, 4), np.float32)
        out[layer.box.slices_in(frame)] = layer.rgba
        return out

    disparity = [[1.0 / (1.0 - nearer * at)] for at in (-0.5, 2.0, 4.5)]
    motion = measure_motion(
        [np.array([[x, 0.0]]) for x in (0.0, 5.0, 10.0)], fit.coc_px(np.array(disparity))
    )
    motion = replace(motion, ways=np.zeros((5, 2)))
    assert len(motion.parts) == parts
    truth = np.mean([whole(through_lens(layer)) for layer in layers], axis=0)
    means = [through_lens(mean_layer(layers[number] for number in part)) for part in motion.parts]
    result = whole(mean_of_blurred(means, [len(part) for part in motion.parts]))
    assert psnr(result, truth, truth[..., 3] > 0) > 45
    assert psnr(whole(through_lens(layers[2])), truth, truth[..., 3] > 0) < 32


def test_shutter_sample_out_of_view_is_transparent_in_the_mean():
    half = mean_layer([card_at(50, 1.0, 0.4), None])
    assert half.rgba[30, 30] == pytest.approx([0.2, 0.25, 0.1, 0.5])
    assert half.depth[30, 30] == pytest.approx(1.0) and np.isinf(half.depth[0, 0])
    assert mean_layer([None, None]) is None


def psnr(a, b, where):
    return -10 * np.log10(np.mean((a - b)[where] ** 2))


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("coc_px", [0.0, 12.0])
def test_rotating_and_sliding_card_agrees_with_hundreds_of_shutter_samples(tmp_path, coc_px):
    from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
    from nlens_video.scene.scene import Scene

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

    coc = np.full((3, len(places(0.1))), coc_px)
    motion = measure_motion([places(moment) for moment in shutter.edges(0.1)], coc)
    assert motion is not None and motion.span_px > 20

    def exposed(ways):
        with PyrenderObjectRenderer(scene) as renderer:
            moments = shutter.middles(0.1, len(ways))
            mean = mean_layer(renderer.render(moment, camera) for moment in moments)
        layer = motion_blurred(through_lens(mean), ways.mean(axis=0), FRAME)
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


@pytest.mark.slow
@pytest.mark.needs_gl
def test_command_blurs_a_moving_object_unless_motion_blur_is_off(tmp_path):
    plate = shots.write_video(tmp_path / "in.mp4", frames=4, audio=False)
    glb = spinning_glb(tmp_path / "card.glb")
    fit = shots.fit_json(tmp_path / "fit.json")
    outputs = {}
    for name, words in (
        ("auto", []),
        ("closed", ["--shutter", "0"]),
        ("without", ["--effects", "auto,-motion-blur"]),
        ("named", ["--effects", "defocus,shadow,exposure,motion-blur", "--shutter", "180"]),
    ):
        out = tmp_path / f"{name}_%04d.png"
        timings = tmp_path / f"{name}.json"
        common = [str(plate), str(glb), str(out), "--fit", str(fit), "--timings", str(timings)]
        assert main([*common, "-q", *words]) == 0
        outputs[name] = cv2.imread(str(out) % 2)
        nodes = json.loads(timings.read_text())["frames"][2]["nodes"]
        assert ("render-motion" in nodes) is (name in ("auto", "named"))
    assert np.array_equal(outputs["closed"], outputs["without"])
    assert np.array_equal(outputs["auto"], outputs["named"])
    assert np.abs(outputs["auto"].astype(int) - outputs["closed"]).max() > 30


def widths(glb, moments, **options):
    """Columns that the object of a file covers at some moments, with all of the frame exposed."""
    fit = LensFit(slope=0.0, intercept=0.0, width=shots.WIDTH, height=shots.HEIGHT)
    grey = np.full((shots.HEIGHT, shots.WIDTH, 3), 120, np.uint8)
    common = {"preset": "realtime", "fps": 25, "fit": fit, "effects": "motion-blur"}
    found = []
    with Compositor(glb, shutter_angle=360, **common, **options) as compositor:
        for moment in moments:
            changed = np.abs(compositor.process(grey, moment).astype(int) - grey).max(axis=2) > 8
            columns = np.flatnonzero(changed.any(axis=0))
            found.append(np.ptp(columns) + 1 if columns.size else 0)
    return found


def sliding_glb(path, keys, times=(0.0, 1.0), kind="LINEAR", behind=False):
    builder = GlbBuilder()
    cube = builder.mesh(0.2 * shots.CUBE, shots.CUBE_FACES)
    slides = builder.node(mesh=cube)
    turn = [float(np.sin(-shots.TILT / 2)), 0, 0, float(np.cos(shots.TILT / 2))]
    builder.node(
        camera=builder.camera(shots.YFOV), translation=[0, shots.EYE_HEIGHT, 0], rotation=turn
    )
    if behind:
        builder.node(mesh=cube, translation=[0.0, 0.0, 3.0])
    way = [[x, 0.0, -2.0] for x in keys]
    builder.animation((slides, "translation", list(times), way, kind))
    return builder.write(path)


def test_thing_behind_the_camera_leaves_others_their_motion_blur(tmp_path):
    ends = [-2.0, 2.0]
    alone = widths(sliding_glb(tmp_path / "alone.glb", ends), [0.5])
    assert widths(sliding_glb(tmp_path / "two.glb", ends, behind=True), [0.5]) == alone
    resting = widths(sliding_glb(tmp_path / "rests.glb", [0.0, 0.0]), [0.5])
    assert alone[0] > resting[0] + 15


@pytest.mark.parametrize(("kind", "loop"), [("LINEAR", True), ("STEP", False)])
def test_object_that_leaves_its_place_at_once_is_not_smeared_over_the_way(tmp_path, kind, loop):
    glb = sliding_glb(tmp_path / "jumps.glb", [-0.6, 0.6], kind=kind)
    resting = widths(sliding_glb(tmp_path / "rests.glb", [0.0, 0.0]), [0.5])[0]
    for width in widths(glb, [0.5, 0.99, 1.0, 1.01, 1.5], loop=loop):
        assert resting - 8 < width < resting + 30


def test_vertices_close_to_the_camera_far_beyond_the_frame_do_not_count():
    camera = Camera.from_yfov(np.eye(4), 0.6, 100, 50)
    seen = [
        np.array([[40.0 + step, 20.0, 2.0], [-9000.0 * (1 + step), 7.0, 0.01], [5.0, 5.0, np.nan]])
        for step in range(3)
    ]
    assert [places.tolist() for places in followed(seen, camera)] == [
        [[40.0 + step, 20.0, 2.0]] for step in range(3)
    ]
    beyond = [places[1:2] for places in seen]
    np.testing.assert_array_equal(followed(beyond, camera), beyond)
    assert followed([places[2:] for places in seen], camera) == []
