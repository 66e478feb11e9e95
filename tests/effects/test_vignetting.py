"""Loss of the object's light towards the corners, by hand-worked numbers."""

import numpy as np
import pytest

from nlens_video.core.box import square_radius
from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.core.optics import Vignetting
from nlens_video.effects.camera.vignetting import measure, vignette
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture

FRAME = Box(0, 0, 400, 300)


def opaque(box):
    return BlurredLayer(box=box, rgba=np.ones((box.height, box.width, 4), np.float32))


def test_radius_is_0_at_the_centre_and_1_at_the_corners():
    square = square_radius(FRAME, FRAME)
    assert square[149:151, 199:201] == pytest.approx(0, abs=2e-5)
    assert square[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx(1, abs=0.006)
    assert square[150, -1] == pytest.approx(0.64, abs=0.005)


def test_corner_loses_the_given_stops_and_the_centre_none():
    out = vignette(opaque(FRAME), Vignetting.of(2.0), FRAME).rgba
    assert out[0, 0, :3] == pytest.approx(0.25, rel=0.02)
    assert out[150, 200, :3] == pytest.approx(1.0, abs=1e-4)
    # half way: 0.5 * (0.25 + 0.0625) * 2 stops
    assert out[75, 100, 0] == pytest.approx(2 ** -(0.25 + 0.0625), rel=0.01)


def test_vignetting_keeps_alpha():
    assert (vignette(opaque(FRAME), Vignetting.of(3.0), FRAME).rgba[..., 3] == 1).all()


def test_vignetting_depends_on_frame_position_and_not_on_the_box():
    small = Box(300, 200, 380, 290)
    whole = vignette(opaque(FRAME), Vignetting(square=0.4, fourth=0.9), FRAME).rgba
    part = vignette(opaque(small), Vignetting(square=0.4, fourth=0.9), FRAME).rgba
    assert np.allclose(part, whole[small.slices_in(FRAME)], atol=1e-6)


def test_vignetting_does_not_modify_its_input():
    layer = opaque(FRAME)
    vignette(layer, Vignetting.of(1.0), FRAME)
    assert (layer.rgba == 1).all()


@pytest.mark.parametrize("scale", [0.2, 8.0])
def test_vignetting_of_light_itself_is_measured_however_bright_it_is(scale):
    texture = np.exp2(0.2 * np.random.default_rng(5).standard_normal((300, 400)))
    seen = scale * texture * 2.0 ** -square_radius(FRAME, FRAME)
    light = np.repeat(seen[..., None], 3, axis=2).astype(np.float32)
    found = measure([ArrayPicture(light, "rgb", LINEAR)])
    assert found.value == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("size", [(3840, 64), (960, 16), (200, 3), (200, 1), (3, 200), (1, 1)])
def test_plates_that_are_very_wide_or_of_few_rows_have_no_vignetting_but_are_measured(size):
    width, height = size
    noise = np.random.default_rng(2).normal(0.0, 4.0, (height, width, 3))
    picture = ArrayPicture((128 + noise).astype(np.uint8))
    found = measure([picture])
    assert found.model is None and found.value == 0.0
