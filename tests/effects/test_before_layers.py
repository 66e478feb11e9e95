"""What moves before the object and its shadow, pixel by pixel, against the plain formulas."""

import numpy as np
import pytest

from nlens_video.core.layers import Box
from nlens_video.effects.occlusion import moving_mattes
from nlens_video.effects.occlusion_cues import MovingMatte
from nlens_video.effects.shadow.apply import BlurredShadow, behind_foreground
from nlens_video.stages.composite import ForegroundMatte, behind
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture

RNG = np.random.default_rng(5)
FRAME = Box(0, 0, 23, 17)
PLATE = RNG.uniform(-0.01, 1.5, (*FRAME.shape, 3)).astype(np.float32)
COVERAGE = np.clip(RNG.uniform(-0.5, 1.5, FRAME.shape), 0.0, 1.0).astype(np.float32)
LIGHT = (COVERAGE[..., None] * RNG.uniform(0.0, 1.0, PLATE.shape)).astype(np.float32)


def test_a_layer_behind_a_foreground_is_that_of_the_formula():
    rgba = RNG.uniform(0.0, 1.0, (17, 30, 4)).astype(np.float32)[:, 5:28]
    m, alpha = COVERAGE[..., None], rgba[..., 3:]
    rgb = (1 - m) * rgba[..., :3] + alpha * (LIGHT - m * PLATE)
    expected = np.concatenate([rgb, (1 - m) * alpha], axis=2)
    expected[COVERAGE <= 0.0] = rgba[COVERAGE <= 0.0]
    expected[COVERAGE >= 1.0] = 0.0
    assert np.array_equal(behind(rgba, PLATE, COVERAGE, LIGHT), expected)


def test_mattes_of_what_moves_are_those_of_the_formula():
    before = RNG.uniform(0.0, 1.0, FRAME.shape).astype(np.float32)
    background = RNG.uniform(0.0, 1.0, PLATE.shape).astype(np.float32)
    picture = ArrayPicture(PLATE.copy(), "rgb", LINEAR)
    light = picture.linear(FRAME)
    own = light - (1 - COVERAGE[..., None]) * background
    own = np.clip(own, 0.0, np.maximum(light, 0.0))
    own[COVERAGE <= 0.0] = 0.0
    moving = MovingMatte(box=FRAME, coverage=COVERAGE, before=before, background=background)
    found = moving_mattes(picture, moving)
    assert np.array_equal(found.before_ground.light, own)
    assert np.array_equal(found.before_object.light, own * before[..., None])


@pytest.mark.parametrize("box", [FRAME, Box(4, 2, 15, 17), Box(0, 0, 3, 3)])
def test_a_shadow_is_lost_in_proportion_to_the_light_of_what_stands_before_it(box):
    size = box.shape
    loss = RNG.uniform(0.0, 1.0, (*FRAME.shape, 4)).astype(np.float32)
    picture = ArrayPicture(PLATE.copy(), "rgb", LINEAR)
    plate, light, cover = picture.linear(FRAME), np.zeros_like(PLATE), np.zeros(FRAME.shape)
    at = box.slices_in(FRAME)
    light[at], cover[at] = LIGHT[: size[0], : size[1]], COVERAGE[: size[0], : size[1]]
    share = np.where(plate > 0.0, (plate - light) / plate, 1.0)
    share[cover >= 1.0] = 0.0
    left = loss[..., :3] * np.clip(share, 0.0, 1.0)
    mean = left.mean(axis=2, keepdims=True)
    matte = ForegroundMatte(box=box, coverage=cover[at].astype(np.float32), light=light[at])
    found = behind_foreground(BlurredShadow(box=FRAME, loss=loss), picture, matte).rgba
    np.testing.assert_allclose(found[..., :3], mean - left, atol=1e-6)
    np.testing.assert_allclose(found[..., 3:], mean, atol=1e-6)
