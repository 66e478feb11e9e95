"""Bloom: halos around the object's highlights."""

import re

import cv2
import numpy as np
import pytest
from support.effects.filmed_shots import Camera, filmed, lamps

from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.core.optics import Bloom
from nlens_video.effects.camera.bloom import (
    add_bloom,
    measure,
)
from nlens_video.effects.camera.halo import halo_by_spectrum, halo_of, quick_halo
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture

FRAME = Box(0, 0, 300, 200)
LENS = Bloom(share=0.2, length_px=8.0)


PLACE = Box(100, 60, 160, 120)


def lamp(light, box=PLACE):
    rgba = np.full((box.height, box.width, 4), 0.4, np.float32)
    rgba[..., 3] = 1.0
    rgba[25:35, 25:35, :3] = light
    return BlurredLayer(box=box, rgba=rgba)


@pytest.mark.parametrize("length", [3.0, 8.0, 21.0, 40.0])
def test_fast_halo_agrees_with_the_direct_convolution(length):
    rng = np.random.default_rng(3)
    light = np.zeros((400, 500, 3), np.float32)
    light[150:190, 200:260] = rng.random((40, 60, 3))
    light[250, 300] = 1.0
    plain, quick = halo_of(light, length), quick_halo(light, length)
    assert np.abs(quick - plain).max() < 0.03 * plain.max()
    assert quick.sum() == pytest.approx(plain.sum(), rel=0.01)


@pytest.mark.parametrize("size", [(60, 90), (61, 37), (1, 5)])
@pytest.mark.parametrize("length", [3.0, 21.0])
def test_halo_by_spectrum_equals_the_direct_convolution_up_to_the_border(length, size):
    light = np.random.default_rng(3).random(size).astype(np.float32)
    assert halo_by_spectrum(light, length) == pytest.approx(halo_of(light, length), abs=1e-6)


def test_halo_keeps_energy_and_decays_exponentially():
    point = np.zeros((201, 201), np.float32)
    point[100, 100] = 1.0
    halo = halo_of(point, 6.0)
    assert halo.sum() == pytest.approx(1.0, abs=1e-4)
    assert halo[100, 112] / halo[100, 106] == pytest.approx(np.exp(-1), rel=1e-3)


def test_layer_without_highlights_is_returned_unchanged():
    layer = lamp(1.0)
    assert add_bloom(layer, LENS, FRAME) is layer


def test_halo_surrounds_the_highlight_without_alpha():
    out = add_bloom(lamp(5.0), LENS, FRAME)
    ring = out.rgba[90 - out.box.y0, 90 - out.box.x0]
    assert ring[3] == 0.0 and 0.0 < ring[0] < 0.1
    near = out.rgba[90 - out.box.y0, 138 - out.box.x0, 0]
    assert near > 0.4 + 5 * ring[0]


def test_highlight_weight_rises_from_white_to_twice_white():
    halos = [
        add_bloom(lamp(light), LENS, FRAME).rgba[..., 0].sum() - lamp(light).rgba[..., 0].sum()
        for light in (1.25, 1.5, 2.0, 9.0)
    ]
    assert halos[1] == pytest.approx(2 * halos[0], rel=1e-3)
    assert halos[2] == pytest.approx(4 * halos[0], rel=1e-3)
    assert halos[3] == pytest.approx(halos[2], rel=1e-3)


def test_halo_has_the_colour_of_the_highlight():
    out = add_bloom(lamp((3.0, 1.5, 0.5)), LENS, FRAME)
    red, green, blue, _ = out.rgba[90 - out.box.y0, 80 - out.box.x0]
    assert green == pytest.approx(red / 2, rel=1e-3) and blue == 0.0


@pytest.mark.parametrize("length", [8.0, 20.0])
def test_halo_does_not_depend_on_the_objects_box(length):
    lens, frame = Bloom(share=0.2, length_px=length), Box(0, 0, 700, 600)

    def halo(before, after):
        box = Box(300 - before, 260 - before, 360 + after, 320 + after)
        rgba = np.zeros((box.height, box.width, 4), np.float32)
        rgba[20 + before : 40 + before, 20 + before : 40 + before] = (3.0, 3.0, 3.0, 1.0)
        out = add_bloom(BlurredLayer(box=box, rgba=rgba), lens, frame)
        whole = np.zeros((600, 700, 3), np.float32)
        whole[out.box.slices_in(frame)] = out.rgba[..., :3]
        return whole[200:380, 240:420]

    plain = halo(0, 0)
    for pad in range(1, 6):
        np.testing.assert_allclose(halo(pad, 0), plain, atol=1e-5)
        np.testing.assert_allclose(halo(0, pad), plain, atol=1e-5)


def test_halo_stays_inside_the_frame():
    out = add_bloom(lamp(5.0, Box(240, 140, 300, 200)), LENS, FRAME)
    assert out.box.intersection(FRAME) == out.box


def plate_of_light(radiance, share, length_px):
    """A scene-linear picture (360, 640, 3) of lamps, whose halos hold that share of their light."""
    rng = np.random.default_rng(2)
    rows, columns = np.mgrid[:360, :640]
    around = 0.05 + 0.02 * cv2.GaussianBlur(rng.normal(size=(360, 640)), (0, 0), 3)
    source = np.zeros((360, 640), np.float32)
    for x, y, radius in ((80, 60, 9), (200, 90, 7), (480, 70, 10), (560, 200, 8), (120, 260, 9)):
        source[np.hypot(columns - x, rows - y) < radius] = radiance
    halo = share * halo_by_spectrum(source, length_px)
    light = np.where(source > 0.0, (1.0 - share) * source, around) + halo
    return np.repeat(light[..., None], 3, axis=2).astype(np.float32)


@pytest.mark.parametrize(("radiance", "share"), [(3.0, 0.12), (20.0, 0.03)])
def test_halo_in_a_plate_of_light_is_a_share_of_the_highlights_own_light(radiance, share):
    picture = ArrayPicture(plate_of_light(radiance, share, 10.0), "rgb", LINEAR)
    bloom = measure([picture]).model
    assert bloom.share == pytest.approx(share, rel=0.15)
    for light in (2.0, radiance):
        rgba = np.zeros((120, 120, 4), np.float32)
        rgba[40:80, 40:80] = (light, light, light, 1.0)
        out = add_bloom(BlurredLayer(box=Box(100, 60, 220, 180), rgba=rgba), bloom, FRAME)
        seen = out.rgba[Box(100, 60, 220, 180).slices_in(out.box)][..., 0]
        expected = share * halo_of(rgba[..., 0], 10.0)
        assert seen[60, 86] == pytest.approx(expected[60, 86], rel=0.15)
        assert 0.9 * light < seen[60, 60] <= light


def test_highlights_count_as_no_brighter_than_where_the_plate_clips():
    hlg = Bloom(share=0.2, length_px=8.0, clip=3.8)
    halos = [add_bloom(lamp(light), hlg, FRAME).rgba[25, 25, 0] for light in (1.9, 3.8, 20.0)]
    assert halos[1] == pytest.approx(halos[2], rel=1e-5) and halos[1] > 2.0 * halos[0] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("radiance", "wanted"), [(8.0, True), (80.0, False)])
def test_halo_of_a_source_far_beyond_white_is_not_put_round_the_objects_highlights(
    radiance, wanted
):
    pictures = filmed(lambda: lamps(4, radiance=radiance), Camera(bloom=(0.06, 12)), 1)
    found = measure(pictures)
    assert found.called_for == wanted
    assert ("as around the sun" in found.evidence) != wanted


@pytest.mark.slow
def test_soft_borders_of_lamps_that_are_out_of_focus_are_no_halo():
    """A halo fits them well, but no better than the scene around them varies by itself."""
    pictures = filmed(lambda: lamps(109, count=2, blur=9.2), Camera(noise=0.008, crf=24), 3)
    found = measure(pictures)
    assert not found.called_for
    (contrast,) = re.findall(r"(\S+) times as strong as what else is there", found.evidence)
    assert float(contrast) < 1.0  # and nothing but that speaks against it
