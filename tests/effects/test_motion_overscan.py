"""Motion blur at the frame's border: a frame must be the middle of a wider one."""

from functools import partial

import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_FACES, GlbBuilder

from nlens_video import Compositor
from nlens_video.core.layers import Box, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Aperture
from nlens_video.effects.motion_blur import line_kernel
from nlens_video.effects.motion_overscan import farthest_px, lens_beyond, overscan, strips
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.stages.l_reblur import ReblurLayer, object_coc

WIDTH, HEIGHT, BESIDE, FOCAL, DEPTH = 160, 90, 200, 200.0, 2.0
FRAME = Box(0, 0, WIDTH, HEIGHT)


def card_glb(path, width, half, way, at=0.0, turn=0.0, pivot=0.0):
    """A card that moves along `way` columns over a frame's time, or turns about a pivot.

    Its middle at 0.1 s is at column `at` of the middle `WIDTH` columns.
    """
    builder = GlbBuilder()
    unlit = {"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}
    material = builder.add("materials", unlit)
    size = np.array([half[0], half[1], 0.0]) * DEPTH / FOCAL
    arm = np.array([pivot * DEPTH / FOCAL, 0.0, 0.0])
    card = (QUAD * size + arm).astype(np.float32)
    node = builder.node(mesh=builder.mesh(card, QUAD_FACES, material=material))
    times = np.linspace(0.0, 0.2, 41)
    frames = (times - 0.1) * 25.0
    columns = at - WIDTH / 2 - pivot + way * frames
    slide = np.stack([columns * DEPTH / FOCAL, 0.0 * times, 0.0 * times - DEPTH], axis=1)
    angle = 0.5 * np.radians(turn) * frames
    turns = np.stack([0 * angle, 0 * angle, np.sin(angle), np.cos(angle)], axis=1)
    builder.animation((node, "translation", times, slide, "LINEAR"))
    builder.animation((node, "rotation", times, turns, "LINEAR"))
    builder.node(camera=builder.camera(2.0 * np.arctan(HEIGHT / 2 / FOCAL), aspect=width / HEIGHT))
    return builder.write(path)


def composited(tmp_path, width, preset, coc_px, columns=None, **card):
    """Columns, by default the middle `WIDTH`, of a frame of a width at 0.1 s, over black."""
    glb = card_glb(tmp_path / f"{width}.glb", width, **card)
    fit = LensFit(slope=0.0, intercept=coc_px, width=width, height=HEIGHT)
    black = np.zeros((HEIGHT, width, 3), np.uint8)
    common = {"fps": 25, "fit": fit, "effects": "defocus,motion-blur", "shutter_angle": 180}
    with Compositor(glb, preset=preset, **common) as compositor:
        beside = (width - WIDTH) // 2
        return compositor.process(black, 0.1)[:, columns or slice(beside, beside + WIDTH)].astype(
            int
        )


@pytest.mark.parametrize("preset", ["realtime", "standard"])
@pytest.mark.parametrize("coc_px", [0.0, 12.0])
@pytest.mark.parametrize("half", [(10.0, 10.0), (60.0, 60.0)])
def test_card_that_slides_in_over_the_border_leaves_its_whole_streak(
    tmp_path, preset, coc_px, half
):
    card = {"preset": preset, "coc_px": coc_px, "half": half, "way": 120.0}
    seen, truth = (composited(tmp_path, w, **card) for w in (WIDTH, WIDTH + 2 * BESIDE))
    assert truth[:, 20].max() > 60
    assert np.abs(seen - truth).max() <= 1


def test_card_that_is_beyond_the_border_half_way_is_seen_where_it_comes_in(tmp_path):
    card = {"preset": "standard", "coc_px": 0.0, "half": (4.0, 20.0), "way": -100.0, "at": -12.0}
    seen, truth = (composited(tmp_path, w, **card) for w in (WIDTH, WIDTH + 2 * BESIDE))
    assert truth[:, :20].max() > 40
    assert np.abs(seen - truth).max() <= 1


@pytest.mark.parametrize("coc_px", [0.0, 6.0])
def test_arm_that_turns_in_over_the_border_is_seen(tmp_path, coc_px):
    card = {"half": (3.0, 10.0), "way": 60.0, "at": -8.0, "turn": 80.0, "pivot": -30.0}
    card |= {"preset": "standard", "coc_px": coc_px}
    seen, truth = (composited(tmp_path, w, **card) for w in (WIDTH, WIDTH + 2 * BESIDE))
    assert truth[:, :20].max() > 40
    assert np.abs(seen - truth).max() <= 1


def test_object_far_beyond_the_frame_half_way_is_seen_where_it_comes_in(tmp_path):
    card = {"half": (20.0, 20.0), "way": 1500.0, "at": -300.0 - 240.0}
    wide = {"preset": "standard", "coc_px": 0.0, "width": 4 * WIDTH}
    seen = composited(tmp_path, **wide, **card, columns=slice(0, 60))
    assert seen[HEIGHT // 2].min() > 30


def at(*columns):
    return [np.array([[column, 40.0], [column + 20.0, 50.0]]) for column in columns]


@pytest.mark.parametrize(
    ("columns", "half", "box"),
    [
        ([50.0], [30.0, 9.0], FRAME),  # inside
        ([-40.0], [30.0, 9.0], Box(-30, 0, WIDTH, HEIGHT)),
        ([-51.0], [30.0, 0.0], Box(0, 0, 0, 0)),  # too far out
        ([-10.0, 150.0], [30.0, 0.0], Box(-30, 0, WIDTH + 30, HEIGHT)),
        ([-10.0], [1.0, 0.0], FRAME),  # the border stands for so little
        ([-900.0, 150.0], [1e7, 1e7], Box(-WIDTH, 0, 2 * WIDTH, HEIGHT)),
    ],
)
def test_overscan_is_as_wide_as_half_the_way_on_sides_where_the_object_stands(columns, half, box):
    assert overscan(at(*columns), np.array(half), 0.0, FRAME) == box
    assert farthest_px(box, FRAME) == max(0, -box.x0)


def test_overscan_holds_what_the_lens_spreads_over_the_border():
    assert overscan(at(3.0), np.array([30.0, 0.0]), 5.0, FRAME).x0 == -30
    assert overscan(at(-53.0), np.array([30.0, 0.0]), 5.0, FRAME).x0 == -30


def test_strips_cover_what_a_box_has_beyond_the_frame_once():
    box = Box(-7, -3, WIDTH + 2, HEIGHT)
    count = np.zeros(box.shape, int)
    for strip in strips(box, FRAME):
        count[strip.slices_in(box)] += 1
    assert (count[FRAME.slices_in(box)] == 0).all()
    assert count.sum() == box.width * box.height - WIDTH * HEIGHT and count.max() == 1


def test_cats_eye_beyond_the_frame_is_that_of_the_frame():
    scattered = partial(scatter, aperture=Aperture(cat_eye=0.8))
    lens = ReblurLayer(scatter=scattered, reach=blur_reach)
    rgba, depth = np.ones((40, 30, 4), np.float32), np.ones((40, 30), np.float32)
    layer = ObjectLayer(box=Box(-18, 20, 12, 60), rgba=rgba, depth=depth)
    fit = LensFit(slope=0.0, intercept=-14.0, width=WIDTH, height=HEIGHT)
    defocused, box = object_coc(layer, fit), Box(-50, 0, WIDTH, HEIGHT)
    own, wide = lens(defocused, FRAME), lens_beyond(lens, FRAME, box)(defocused, box)
    common = own.box.intersection(wide.box)
    assert common == own.box and wide.box.x0 < -18
    np.testing.assert_array_equal(wide.rgba[common.slices_in(wide.box)], own.rgba)


def test_line_filter_of_any_motion_is_bounded_by_the_frame():
    kernel = line_kernel(np.array([1e7, 3e6]), (WIDTH, HEIGHT))
    assert kernel.shape == (2 * HEIGHT + 1, 2 * WIDTH + 1)
    assert kernel.sum() == pytest.approx(2 * WIDTH / 1e7, rel=0.01)
    short = np.array([31.0, 7.0])
    np.testing.assert_array_equal(line_kernel(short, (WIDTH, HEIGHT)), line_kernel(short))


def test_arm_that_turns_faster_than_it_is_sampled_is_whole_at_the_border(tmp_path):
    card = {"half": (60.0, 4.0), "way": 0.0, "at": 10.0, "turn": 170.0}
    card |= {"preset": "standard", "coc_px": 0.0}
    seen, truth = (composited(tmp_path, w, **card) for w in (WIDTH, WIDTH + 2 * BESIDE))
    assert truth[:, :20].max() > 40
    assert np.abs(seen - truth).max() <= 2
