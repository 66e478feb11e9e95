"""Exposure changes of the plate over a shot, applied to the object."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from nlens_video.core.color import transfer
from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.core.optics import Shutter
from nlens_video.effects.exposure import Exposure, MeasureExposure, match_exposure
from nlens_video.effects.planner import EXPOSURE, ShotFacts, decide
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import SRGB, ArrayPicture

SIZE = (360, 640)


def scene(seed=0, wide=1):
    rng = np.random.default_rng(seed)
    light = np.full((SIZE[0], SIZE[1] * wide, 3), 0.2, np.float32)
    for octave in range(2, 7):
        side = (light.shape[1] >> octave, light.shape[0] >> octave)
        noise = rng.standard_normal((side[1], side[0], 3)).astype(np.float32)
        light *= np.exp2(0.3 * cv2.resize(noise, (light.shape[1], light.shape[0])))
    return light


def shot(light, noise=0.0, rng=None):
    if noise:
        light = light + noise * rng.standard_normal(light.shape)
    light = np.clip(light, 0, 1)
    coded = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return ArrayPicture(np.uint8(np.rint(255 * coded)), "rgb")


def run(pictures):
    measure = MeasureExposure()
    return [measure(picture).gains for picture in pictures]


@settings(max_examples=10)
@given(st.tuples(*3 * [st.floats(-0.8, 0.6)]).filter(lambda s: max(map(abs, s)) > 0.1))
def test_gains_follow_a_change_of_exposure(stops):
    gains = np.exp2(np.array(stops))
    first, second = run([shot(scene()), shot(scene() * gains)])
    assert first == (1.0, 1.0, 1.0)
    assert second == pytest.approx(gains, rel=0.015)


@pytest.mark.parametrize("scale", [1.0, 8.0, 100.0])
def test_exposure_of_light_itself_is_followed_however_bright_it_is(scale):
    plates = [np.float32(scale * gain) * scene() for gain in (1.0, 1.2, 1.5)]
    gains = run([ArrayPicture(plate, "rgb", LINEAR) for plate in plates])
    assert gains[1] == pytest.approx((1.2,) * 3, rel=0.01)
    assert gains[2] == pytest.approx((1.5,) * 3, rel=0.01)


def test_exposure_of_hdr_is_followed_beyond_diffuse_white():
    hlg = replace(SRGB, transfer="arib-std-b67")
    codes = [
        np.uint16(65535 * transfer("arib-std-b67").to_coded(gain * (1.0 + scene())))
        for gain in (1.0, 1.5)
    ]
    _, gains = run([ArrayPicture(code, "rgb", hlg) for code in codes])
    assert gains == pytest.approx((1.5,) * 3, rel=0.01)


def test_noise_does_not_change_the_gains():
    rng = np.random.default_rng(1)
    assert set(run([shot(scene(), 0.03, rng) for _ in range(12)])) == {(1.0, 1.0, 1.0)}


def test_large_object_entering_the_plate_does_not_change_the_gains():
    pictures = []
    for number in range(16):
        light = scene().copy()
        light[:, : 55 * number] = (0.03, 0.02, 0.05)
        pictures.append(shot(light))
    assert set(run(pictures)) == {(1.0, 1.0, 1.0)}


@pytest.mark.parametrize("step", [5, 23, 60])
def test_panning_to_another_subject_does_not_change_the_gains(step):
    light = scene(3, wide=3)
    pictures = [shot(light[:, step * n : step * n + SIZE[1]]) for n in range(20)]
    assert max(max(gains) for gains in run(pictures)) == 1.0


def test_exposure_drift_is_followed_during_a_pan():
    light = scene(3, wide=3)
    pictures = [
        shot(light[:, 20 * n : 20 * n + SIZE[1]] * np.float32(2 ** (-0.05 * n))) for n in range(20)
    ]
    assert run(pictures)[-1] == pytest.approx(3 * [2**-0.95], rel=0.03)


def test_cut_keeps_the_last_gains():
    bright = shot(scene() * np.float32(1.3))
    gains = run([shot(scene()), bright, shot(scene(9)[::-1]), shot(scene(9)[::-1])])
    assert gains[2] == gains[3] == gains[1]


@pytest.mark.parametrize("light", [np.zeros((*SIZE, 3)), np.full((*SIZE, 3), 2.0)])
def test_black_or_clipped_picture_gives_no_gains(light):
    assert set(run([shot(light), shot(scene()), shot(light)])) == {(1.0, 1.0, 1.0)}


@pytest.mark.parametrize(
    "tint", [(1, 0.02, 0.03), (0.02, 0.02, 1), (1, 0.5, 0.03)], ids=["red", "blue", "amber"]
)
def test_coloured_light_is_followed(tint):
    light = scene() * np.float32(tint)
    gains = run([shot(light * np.float32(gain)) for gain in (1.0, 0.7, 0.5, 0.35, 0.25)])
    assert np.array(gains)[:, np.argmax(tint)] == pytest.approx([1, 0.7, 0.5, 0.35, 0.25], rel=0.02)
    assert np.array(gains)[-1] == pytest.approx(np.full(3, 0.25), rel=0.15)


def test_light_on_a_part_of_a_dark_stage_is_followed():
    light = scene()
    light[:, SIZE[1] // 6 :] = 0.0
    gains = run([shot(light * np.float32(gain)) for gain in (1.0, 0.5, 0.25)])
    assert np.array(gains)[:, 1] == pytest.approx([1.0, 0.5, 0.25], rel=0.02)


def test_night_is_followed_and_its_flicker_is_no_fade():
    levels = 0.03 * np.array([1.0, 1.06, 0.95, 1.3, 1.0, 0.5])
    gains = run([shot(scene() * np.float32(level)) for level in levels])
    # the first frame that is not brighter than the one before it is the reference
    assert np.array(gains)[2:, 1] == pytest.approx(levels[2:] / levels[1], rel=0.03)


def test_black_frames_are_black_and_the_light_after_them_is_as_before():
    bright, black = shot(scene()), shot(np.zeros((*SIZE, 3)))
    fade = [shot(scene() * np.float32(gain)) for gain in (0.5, 0.1, 0.02)]
    gains = np.array(run([bright, *fade, black, black, fade[1], bright]))[:, 1]
    assert gains[:4] == pytest.approx([1.0, 0.5, 0.1, 0.02], rel=0.05)
    assert max(gains[4:6]) < 1e-3
    assert gains[6:] == pytest.approx([0.1, 1.0], rel=0.05)


def test_another_view_after_black_keeps_the_objects_light_to_the_plates():
    black = shot(np.zeros((*SIZE, 3)))
    gains = run([shot(scene()), black, black, *[shot(scene(9)[::-1] * np.float32(0.6))] * 3])
    assert gains[3] == gains[4] == gains[5] == pytest.approx(3 * [0.6], rel=0.2)


def test_gains_change_gradually():
    stops = np.linspace(0, 0.12, 40)
    gains = [run([shot(scene()), shot(scene() * np.float32(2**s))])[1][1] for s in stops]
    assert gains[0] == 1.0 and max(np.diff(gains)) < 0.012
    assert gains[-1] == pytest.approx(2**0.12, rel=0.01)


def test_gains_scale_the_object_and_keep_its_alpha():
    layer = BlurredLayer(box=Box(0, 0, 2, 2), rgba=np.full((2, 2, 4), 0.5, np.float32))
    out = match_exposure(layer, Exposure(gains=(1.5, 1.0, 0.5)))
    assert out.rgba[0, 0] == pytest.approx([0.75, 0.5, 0.25, 0.5])
    assert match_exposure(layer, Exposure(gains=(1.0, 1.0, 1.0))) is layer


def test_exposure_change_is_converted_to_code_levels_at_mid_grey():
    a_stop = Exposure(gains=(1.0, 2.0, 1.0))
    assert a_stop.levels == pytest.approx(118 * (2 ** (1 / 2.2) - 1), abs=0.01)


def test_still_picture_needs_no_exposure_tracking():
    (still,) = (one for one in decide("auto") if one.effect == EXPOSURE)
    moving = ShotFacts(shutter=Shutter(frame_s=0.04))
    (video,) = (one for one in decide("auto", moving) if one.effect == EXPOSURE)
    assert not still.wanted and video.wanted
