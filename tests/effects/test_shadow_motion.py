"""Motion blur of shadows: the mean over the shutter time, and the number of samples it takes."""

import numpy as np
import pytest
from support.overhead import HEIGHT, WIDTH, looking_down

from nlens_video.core.layers import Box
from nlens_video.effects.motion_blur import sampled_count
from nlens_video.effects.shadow.cast import CastShadow, shadow_places
from nlens_video.effects.shadow.casters import Casters, Moment
from nlens_video.effects.shadow.coverage import edges_of
from nlens_video.scene.illumination import Illumination, Lamp, sun

FRAME = Box(0, 0, WIDTH, HEIGHT)
CARD = np.array([[-0.5, 1.0, -0.5], [0.5, 1.0, -0.5], [0.5, 1.0, 0.5], [-0.5, 1.0, 0.5]])
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
DOWN = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)  # a sun at 45 degrees, from the left
LAMP = Lamp(sun(np.ones(3) / -DOWN[1], DOWN), 1e-6)
LIGHT = Illumination((LAMP,), np.zeros((9, 3)))


def moment(across=0.0, up=0.0, aside=0.0):
    card = CARD + (across, up, 0.0)
    return Moment(Casters(card, FACES, edges_of(FACES)), looking_down(aside=aside))


def loss(moments, **given):
    shadow = CastShadow(**given)(moments, LIGHT, 0.0, None)
    whole = np.zeros((HEIGHT, WIDTH), np.float32)
    inside = shadow.box.intersection(FRAME)
    whole[inside.slices_in(FRAME)] = shadow.loss[inside.slices_in(shadow.box)][..., 0]
    return whole


def test_edge_of_a_sliding_shadow_is_as_wide_as_its_displacement():
    # 0.4 units are 8 px; the card at rest shades columns 90 to 110
    steps = (np.arange(9) + 0.5) / 9 - 0.5
    row = loss([moment(0.4 * step) for step in steps], lamp_points=72)[60]
    ramp = np.interp(np.arange(84, 116) + 0.5, [86, 94, 106, 114], [0, 1, 1, 0])
    assert row[84:116] == pytest.approx(ramp, abs=0.1)
    assert row.sum() == pytest.approx(20.0, rel=0.02)


def test_rising_object_blurs_its_shadow_along_the_light_and_not_across():
    rows = loss([moment(up=0.4 * step) for step in (-1 / 3, 0.0, 1 / 3)], lamp_points=60)
    assert 0.2 < rows[60, 91] < 0.8 and 0.2 < rows[60, 109] < 0.8
    assert rows[49, 100] == 0.0 and rows[51, 100] > 0.99


def test_shadow_follows_a_moving_camera():
    row = loss([moment(aside=0.4 * step) for step in (-1 / 3, 0.0, 1 / 3)], lamp_points=60)[60]
    assert 0.2 < row[90] < 0.8 and 0.2 < row[109] < 0.8 and row[100] > 0.99


def test_identical_shutter_samples_give_the_bits_of_a_single_one():
    assert np.array_equal(loss([moment()] * 5, lamp_points=13), loss([moment()], lamp_points=13))


def test_shutter_sample_below_the_ground_casts_no_shadow():
    half = loss([moment(), moment(up=-5.0), moment()], lamp_points=30)
    assert half[60, 100] == pytest.approx(2 / 3, abs=1e-3)


def test_projected_shadow_positions_determine_the_number_of_shutter_samples():
    places = shadow_places([moment(step) for step in (-0.2, 0.0, 0.2)], [LAMP], 0.0)
    assert places.shape == (3, 8, 2)
    # straight below the card, and its height aside of it
    assert places[1][:4] == pytest.approx(np.array([[70, 50], [90, 50], [90, 70], [70, 70]]))
    assert places[1][4:] == pytest.approx(places[1][:4] + (20, 0), abs=1e-3)
    assert places[2] - places[0] == pytest.approx(np.broadcast_to((8.0, 0.0), (8, 2)))
    assert sampled_count([2.0 * one for one in places], 0.0) == 5  # 16 px, every four
    assert sampled_count([2.0 * one for one in places], 12.0) == 3  # blur hides half of itself
    assert sampled_count([0.1 * one for one in places], 0.0) == 1  # less than a pixel
