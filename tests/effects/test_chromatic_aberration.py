"""Lateral chromatic aberration of the object against shapes drawn with displaced channels."""

import numpy as np
import pytest

from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.core.optics import Aberration
from nlens_video.effects.camera.chromatic_aberration import displace_channels
from nlens_video.video.pixels.picture import SRGB, ArrayPicture

FRAME = Box(0, 0, 240, 160)
LENS = Aberration(red=(1.2, 0.8), blue=(-0.7, -0.3))
COLOUR = np.float32([0.5, 0.3, 0.2])


def disc(displacement=(0.0, 0.0), centre=(185.0, 45.0), radius=22.3):
    """Coverage of a disc (H, W), its light moved outwards by linear * r + cubic * r**3 px."""
    fine = 8
    y, x = (np.mgrid[: FRAME.height * fine, : FRAME.width * fine] + 0.5) / fine
    across, down = x - FRAME.width / 2, y - FRAME.height / 2
    half = np.hypot(FRAME.width, FRAME.height) / 2
    r = np.hypot(across, down) / half
    linear, cubic = displacement
    scale = 1 - (linear + cubic * r**2) / half
    seen = np.hypot(
        across * scale + FRAME.width / 2 - centre[0], down * scale + FRAME.height / 2 - centre[1]
    )
    cover = np.clip((radius - seen) * 1.0 + 0.5, 0, 1)
    return cover.reshape(FRAME.height, fine, FRAME.width, fine).mean(axis=(1, 3))


def layer_of(cover, box=FRAME):
    rgba = np.concatenate([cover[..., None] * COLOUR, cover[..., None]], axis=2)
    return BlurredLayer(box=box, rgba=rgba[box.slices_in(FRAME)].astype(np.float32))


def plate():
    rng = np.random.default_rng(2)
    return rng.integers(40, 220, (FRAME.height, FRAME.width, 3), np.uint8)


def test_each_channel_equals_the_shape_drawn_with_its_displacement():
    picture = ArrayPicture(plate(), "rgb")
    before = picture.linear(FRAME)
    out = displace_channels(layer_of(disc()), LENS, picture, FRAME)
    at = out.box.slices_in(FRAME)
    result = out.rgba[..., :3] + (1 - out.rgba[..., 3:]) * before[at]
    for channel, displacement in enumerate((LENS.red, (0.0, 0.0), LENS.blue)):
        cover = disc(displacement)[at]
        expected = cover * COLOUR[channel] + (1 - cover) * before[at][..., channel]
        # cubic interpolation of an edge one pixel wide errs by a few hundredths of its step
        assert np.abs(result[..., channel] - expected).max() < 0.04
        assert np.abs(result[..., channel] - expected).mean() < 2e-4


def test_composite_has_colour_fringes_only_at_edges():
    picture, bare = ArrayPicture(plate(), "rgb"), ArrayPicture(plate(), "rgb")
    layer = layer_of(disc(), Box(155, 15, 215, 75))
    out = displace_channels(layer, LENS, picture, FRAME)
    picture.composite_over(out.box, out.rgba)
    bare.composite_over(layer.box, layer.rgba)
    changed = np.abs(picture.array.astype(int) - bare.array).max(axis=2)
    cover = disc()
    y, x = np.mgrid[: FRAME.height, : FRAME.width] + 0.5
    away = np.abs(np.hypot(x - 185, y - 45) - 22.3)
    assert changed[away > 4].max() <= 1
    assert changed[away < 1].mean() > 8
    assert np.array_equal(picture.array[..., 1], bare.array[..., 1])
    assert cover.max() == 1


def test_object_cut_by_the_frame_has_no_fringe_at_the_border():
    cover = np.zeros((FRAME.height, FRAME.width))
    cover[40:120, 160:] = 1.0
    picture = ArrayPicture(np.full((FRAME.height, FRAME.width, 3), 200, np.uint8), "rgb")
    lens = Aberration(red=(-2.0, -1.0), blue=(-2.0, -1.0))
    out = displace_channels(layer_of(cover, Box(160, 40, 240, 120)), lens, picture, FRAME)
    inside = out.rgba[60 - out.box.y0 : 100 - out.box.y0, -30:]
    assert np.allclose(inside[..., :3], COLOUR, atol=1e-3)


def test_layer_out_of_view_is_returned_unchanged():
    empty = BlurredLayer(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))
    assert displace_channels(empty, LENS, ArrayPicture(plate(), "rgb", SRGB), FRAME) is empty


@pytest.mark.parametrize("sign", [-1, 1])
def test_strength_is_the_larger_channel_displacement_at_the_corner(sign):
    lens = Aberration(red=(sign * 0.5, sign * 0.25), blue=(0.1, 0.1))
    assert lens.at_corner_px == 0.75
