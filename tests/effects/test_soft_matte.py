"""The matte of moving targets from their surroundings alone, against that of a whole region."""

import cv2
import numpy as np
import pytest

from nlens_video.effects.foreground.background import sqrt_light
from nlens_video.effects.foreground.matte import (
    _EDGE_SIGMA,
    _FOREGROUND_SIGMA,
    _MIN_ROOT,
    _PRIOR_WEIGHT,
    _largest_hole,
    _refine_mask,
    _trimap,
    soft_matte,
)
from nlens_video.effects.occlusion import inpainted

SHAPE = (150, 260)


def reference(light, background, noise, near, edge_px, scale):
    """`soft_matte` of all pixels of the region."""
    hole = _largest_hole(near.shape, scale)
    solid = _refine_mask(light, background, noise, near, scale, edge_px, hole)
    core, band = _trimap(solid, edge_px)
    foreground = inpainted(light, core, (0, 0))
    roots, below = sqrt_light(light), sqrt_light(background)
    difference = np.abs(roots - below).max(axis=2)
    contrast = np.abs(sqrt_light(foreground) - below).max(axis=2)
    inner = solid & (core | (difference > np.float32(0.5) * contrast))
    prior = cv2.GaussianBlur(inner.astype(np.float32), (0, 0), max(0.6, _EDGE_SIGMA * edge_px))
    whole, part = foreground - background, light - background
    variance = np.square(2.0 * np.maximum(roots.mean(axis=2), _MIN_ROOT) * noise)
    texture = np.square(foreground).mean(axis=2)
    variance += np.square(np.float32(_FOREGROUND_SIGMA)) * texture
    along = (whole * part).sum(axis=2) / variance + np.float32(_PRIOR_WEIGHT) * prior
    share = along / ((whole * whole).sum(axis=2) / variance + _PRIOR_WEIGHT)
    share = np.where(core, np.float32(1.0), np.where(band, share, np.float32(0.0)))
    share = (np.clip(share, 0.0, 1.0) - np.float32(0.03)) / np.float32(0.94)
    return cv2.medianBlur(np.clip(share, 0.0, 1.0).astype(np.float32), 5)


def plate(boxes, blur):
    """A textured wall, its plate with coloured cards before it, and where these are."""
    rng = np.random.default_rng(len(boxes))
    coarse = rng.uniform(0.1, 0.5, (15, 26, 3)).astype(np.float32)
    wall = cv2.resize(coarse, SHAPE[::-1], interpolation=cv2.INTER_CUBIC).clip(0.05, 0.8)
    light, near = wall.copy(), np.zeros(SHAPE, np.float32)
    for x0, y0, x1, y1 in boxes:
        card = np.zeros(SHAPE, np.float32)
        card[y0:y1, x0:x1] = 1.0
        card = cv2.GaussianBlur(card, (0, 0), blur)
        near = np.maximum(near, card)
        colour = rng.uniform(0.0, 0.9, 3).astype(np.float32)
        light = card[..., None] * colour + (1 - card[..., None]) * light
    grain = rng.normal(0.0, 1 / 255, light.shape).astype(np.float32)
    return np.square(np.sqrt(light) + grain), wall, near > 0.3


@pytest.mark.parametrize("blur", [0.8, 4.0])
@pytest.mark.parametrize(
    "boxes",
    [
        [(120, 60, 140, 90)],
        [(0, 100, 12, 150)],  # in a corner
        [(40, 0, 60, 150)],  # from border to border
        [(250, 20, 260, 80), (200, 70, 230, 140)],
        [(100, 40, 106, 80), (112, 40, 118, 80), (100, 40, 118, 46), (100, 74, 118, 80)],  # a hole
    ],
)
@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_the_matte_from_the_surroundings_of_targets_is_that_of_the_whole_region(boxes, blur, scale):
    light, wall, near = plate(boxes, blur)
    noise = np.full(SHAPE, 1 / 255, np.float32)
    expected = reference(light, wall, noise, near, 3 * blur, scale)
    got = soft_matte(light, wall, noise, near, 3 * blur, scale)
    assert expected.max() == 1.0
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-6)


def test_nothing_near_is_no_matte():
    light, wall, near = plate([(120, 60, 140, 90)], 1.0)
    noise = np.full(SHAPE, 1 / 255, np.float32)
    assert not soft_matte(light, wall, noise, np.zeros_like(near), 3.0, 1.0).any()
