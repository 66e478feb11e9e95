"""Softness of the plate: measured on known blur, and applied to an object that is too sharp."""

import cv2
import numpy as np
import pytest
from support.effects.synthetic_frames import HEIGHT, WIDTH, noise, pictures, scene

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    ObjectLayer,
)
from nlens_video.effects.camera.softness import (
    DRAWN_PX,
    SharpnessFloor,
    measure,
    missing_sigma,
    soften,
)

FRAME = Box(0, 0, WIDTH, HEIGHT)


def card(box, coc_px=0.0):
    rgba = np.ones((box.height, box.width, 4), np.float32)
    layer = ObjectLayer(box=box, rgba=rgba, depth=np.ones(rgba.shape[:2], np.float32))
    return DefocusedLayer(layer=layer, coc_px=np.full(rgba.shape[:2], coc_px, np.float32))


@pytest.mark.parametrize("seed", range(6))
def test_sharp_plate_needs_no_softening(seed):
    assert not measure(pictures(scene(seed, slope=0.8 + 0.2 * seed), 1)).called_for


@pytest.mark.parametrize("seed", range(4))
def test_sharp_foreground_before_a_defocused_background_needs_no_softening(seed):
    base = scene(seed)
    soft = cv2.GaussianBlur(base, (0, 0), 3.0)
    base[:, : WIDTH * 3 // 4] = soft[:, : WIDTH * 3 // 4]
    assert not measure(pictures(base, 1)).called_for


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [1.3, 1.6])
@pytest.mark.parametrize("grain", [0.0, 2.0])
def test_softness_of_a_plate_is_measured(sigma, grain):
    found = []
    for seed in range(6):
        dirt = noise(seed, 4, grain / 255) if grain else None
        found.append(measure(pictures(scene(seed, soft_px=sigma), 4, dirt)))
    assert sum(one.called_for for one in found) >= 5
    values = [one.value for one in found if one.called_for]
    assert np.median(values) == pytest.approx(sigma, rel=0.15)


def test_object_is_softened_by_the_blur_that_its_sharpest_part_lacks():
    floor = SharpnessFloor(sigma_px=1.5)
    assert missing_sigma(floor, None) == pytest.approx(np.sqrt(1.5**2 - DRAWN_PX**2))
    half = missing_sigma(floor, card(Box(5, 5, 20, 20), 4.0))
    assert half == pytest.approx(np.sqrt(1.5**2 - DRAWN_PX**2 - 1.0))
    assert missing_sigma(floor, card(Box(5, 5, 20, 20), 9.0)) == 0.0


def test_softened_edge_has_the_requested_sigma():
    layer = card(Box(100, 60, 300, 200)).layer
    out = soften(BlurredLayer(box=layer.box, rgba=layer.rgba), 1.5, FRAME)
    profile = np.diff(out.rgba[out.rgba.shape[0] // 2, :20, 3])
    at = np.arange(len(profile))
    mean = (at * profile).sum() / profile.sum()
    assert np.sqrt(((at - mean) ** 2 * profile).sum() / profile.sum()) == pytest.approx(1.5, 0.05)
    assert out.rgba[..., 3].sum() == pytest.approx(layer.rgba[..., 3].sum(), rel=1e-3)


def test_softened_object_cut_by_the_frame_stays_opaque_at_the_border():
    rgba = np.ones((40, 50, 4), np.float32)
    out = soften(BlurredLayer(box=Box(0, 0, 50, 40), rgba=rgba), 1.2, FRAME)
    assert out.rgba[:30, 0] == pytest.approx(1.0, abs=1e-5)


def test_layer_that_is_soft_enough_is_returned_unchanged():
    layer = BlurredLayer(box=Box(5, 5, 9, 9), rgba=np.ones((4, 4, 4), np.float32))
    assert soften(layer, 0.1, FRAME) is layer
