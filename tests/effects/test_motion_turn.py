"""Motion blur of what turns fast: an even arc in place of a fan of samples."""

import cv2
import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_FACES, GlbBuilder

from nlens_video import Compositor
from nlens_video.core.color import transfer
from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.motion_blur import affordable_moments, measure_motion
from nlens_video.effects.motion_turn import exponential, shared_turn, turned

FRAME = Box(0, 0, 200, 160)
CENTRE = np.array([100.0, 80.0])
RNG = np.random.default_rng(5)
POINTS = CENTRE + RNG.uniform(-60, 60, (30, 2))


def rotated(points, degrees, centre=CENTRE):
    turn = np.radians(degrees)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return (points - centre) @ matrix.T + centre


def moved(points, generator, share):
    matrix = exponential(share * generator)
    return points @ matrix[:2, :2].T + matrix[:2, 2]


@pytest.mark.parametrize("degrees", [5.0, 100.0, 340.0])
def test_turn_of_all_vertices_is_found_and_shared_out_to_the_samples(degrees):
    places = [rotated(POINTS, share * degrees) for share in (-0.5, 0.0, 0.5)]
    found = shared_turn(places, 17)
    np.testing.assert_allclose(moved(POINTS, found, 1.0), rotated(POINTS, degrees / 17), atol=1e-6)


def test_growth_lean_and_slide_of_all_vertices_are_found_together():
    generator = np.array([[0.3, 0.2, -30.0], [-0.1, -0.4, 12.0], [0.0, 0.0, 0.0]])
    places = [moved(POINTS, generator, share) for share in (-0.5, 0.0, 0.5)]
    np.testing.assert_allclose(shared_turn(places, 5), generator / 5, atol=1e-8)


def test_no_turn_is_found_where_parts_move_differently_or_tell_none():
    places = [rotated(POINTS, share * 90.0) for share in (-0.5, 0.0, 0.5)]
    for one in places:
        one[:5] = POINTS[:5]  # a body at rest
    assert shared_turn(places, 17) is None
    line = np.column_stack([np.arange(5.0), np.arange(5.0)])
    assert shared_turn([line, line + 3.0, line + 6.0], 17) is None
    mirrored = POINTS * [-1.0, 1.0] + [200.0, 0.0]
    assert shared_turn([mirrored, POINTS, mirrored], 17) is None
    assert shared_turn([POINTS[:1]] * 3, 17) is None


def bar():
    """A bar left of the centre."""
    box = Box(30, 60, 90, 70)
    rgba = np.zeros((box.height + 2, box.width + 2, 4), np.float32)
    rgba[1:-1, 1:-1] = (0.7, 0.5, 0.2, 1.0)
    return BlurredLayer(box=box.expanded(1), rgba=rgba)


def whole(layer, frame=FRAME):
    out = np.zeros((frame.height, frame.width, 4), np.float32)
    out[layer.box.slices_in(frame)] = layer.rgba
    return out


def test_turned_layer_is_the_mean_of_hundreds_of_turned_pictures():
    generator = shared_turn([rotated(POINTS, share * 40) for share in (-0.5, 0, 0.5)], 1)
    result = whole(turned(bar(), generator, FRAME, FRAME))
    sharp = whole(bar())
    truth = np.zeros_like(sharp)
    for share in (np.arange(400) + 0.5) / 400 - 0.5:
        matrix = cv2.getRotationMatrix2D((CENTRE[0] - 0.5, CENTRE[1] - 0.5), -40 * share, 1.0)
        truth += cv2.warpAffine(sharp, matrix, (FRAME.width, FRAME.height)) / 400
    assert np.abs(result - truth).max() < 0.015
    assert result.sum() == pytest.approx(sharp.sum(), rel=2e-3)


def test_turned_object_cut_by_the_frame_stays_opaque_at_the_border():
    layer = BlurredLayer(box=Box(0, 40, 60, 120), rgba=np.ones((80, 60, 4), np.float32))
    generator = shared_turn([rotated(POINTS, share * 6) for share in (-0.5, 0, 0.5)], 1)
    out = whole(turned(layer, generator, FRAME, FRAME))
    assert out[60:100, 0] == pytest.approx(1.0, abs=1e-5)
    inside = BlurredLayer(box=Box(1, 40, 60, 120), rgba=np.ones((80, 59, 4), np.float32))
    assert whole(turned(inside, generator, FRAME, FRAME))[60:100, 0].max() < 0.9


def test_more_samples_are_taken_of_small_objects_whose_parts_move_differently():
    places = [rotated(POINTS, share * 90.0) for share in (-0.5, 0.0, 0.5)]
    coc = np.zeros((3, len(POINTS)))
    alone = measure_motion(places, coc, 17, 100)
    assert alone.turn is not None and len(alone.ways) == 17
    for one in places:
        one[:5] = POINTS[:5]
    apart = measure_motion(places, coc, 17, 100)
    assert apart.turn is None and 35 < len(apart.ways) <= 100
    assert len(measure_motion(places, coc, 17).ways) == 17
    assert len(measure_motion(places, coc, 1, 100).ways) == 1


def test_samples_of_an_object_cost_no_more_than_those_of_a_full_hd_frame():
    frame = Box(0, 0, 3840, 2160)
    corners = np.array([[-50.0, 0.0], [3840.0, 3000.0]])
    assert affordable_moments(17, [corners], frame) == 17
    assert affordable_moments(17, [0.25 * corners], frame) == pytest.approx(49, abs=1)
    assert affordable_moments(17, [corners / 100.0], frame) == 17 * 4
    assert affordable_moments(17, [corners + 1e5], frame) == 17 * 4


def blade_glb(path, width, height, half, degrees):
    """A blade that turns about the middle of the frame by so much from frame to frame."""
    builder = GlbBuilder()
    unlit = {"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}
    material = builder.add("materials", unlit)
    corners = (QUAD * [*half, 0.0] / height).astype(np.float32)
    node = builder.node(
        mesh=builder.mesh(corners, QUAD_FACES, material=material), translation=[0.0, 0.0, -1.0]
    )
    times = np.linspace(0.0, 0.16, 41)
    angle = 0.5 * np.radians(degrees) * 25.0 * times
    turns = np.stack([0 * angle, 0 * angle, np.sin(angle), np.cos(angle)], axis=1)
    builder.animation((node, "rotation", times, turns, "LINEAR"))
    builder.node(camera=builder.camera(2.0 * np.arctan(0.5), aspect=width / height))
    return builder.write(path)


def test_fast_blade_leaves_an_even_arc_in_place_of_ghosts(tmp_path):
    width, height, length, degrees = 320, 180, 84.0, 140.0
    glb = blade_glb(tmp_path / "blade.glb", width, height, (length, 1.5), degrees)
    fit = LensFit(slope=0.0, intercept=0.0, width=width, height=height)
    common = {"fps": 25, "fit": fit, "effects": "defocus,motion-blur", "shutter_angle": 180}
    with Compositor(glb, preset="standard", **common) as compositor:
        out = compositor.process(np.zeros((height, width, 3), np.uint8), 0.08)
    radius = 0.9 * length
    along = np.radians(degrees) * (2.0 + np.linspace(-0.22, 0.22, 600))
    x = width / 2 + radius * np.cos(along) - 0.5
    y = height / 2 - radius * np.sin(along) - 0.5
    seen = cv2.remap(
        out[..., 0].astype(np.float32), x.astype(np.float32)[None], y.astype(np.float32)[None],
        cv2.INTER_LINEAR,
    )  # fmt: skip
    light = transfer("iec61966-2-1").to_linear(seen / 255.0)
    truth = 3.0 / (radius * np.radians(degrees) / 2.0)
    assert light.min() > 0.85 * truth and light.max() < 1.15 * truth
