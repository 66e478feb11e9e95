"""Maps of the light around, filtered for smooth surfaces, against sums over the sphere."""

import math

import numpy as np
import pytest

from nlens_video.scene.environment import reduce_environment
from nlens_video.scene.plate_environment import sphere
from nlens_video.scene.surround import LEVELS, ROUGHEST, Surround, mirrored_light

COLUMNS = 128


def directions_of(count, seed=0):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def smooth_light(directions):
    """Radiance (..., 3) that changes slowly with direction."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack([1.0 + 0.8 * x, 1.0 + 0.5 * y * z, 1.0 - 0.6 * z], axis=-1)


@pytest.fixture(scope="module")
def smooth():
    return Surround(smooth_light(sphere(COLUMNS)[0]).astype(np.float32))


def test_mirror_shows_the_light_of_its_direction(smooth):
    for direction in (*directions_of(200), *np.eye(3), *-np.eye(3)):
        found = mirrored_light(smooth.levels, direction, 0.0)
        np.testing.assert_allclose(found, smooth_light(direction), atol=6e-3)


@pytest.mark.parametrize("level", range(1, LEVELS))
def test_rough_mirrors_average_the_lobe_of_microfacets(level):
    toward, solid = sphere(COLUMNS)
    lights = directions_of(12, seed=9)  # a dozen lights some 20 degrees wide
    radiance = np.exp(20.0 * (toward @ lights.T - 1.0)) @ np.eye(3)[np.arange(12) % 3]
    alpha = (ROUGHEST * level / (LEVELS - 1)) ** 2
    levels = Surround(radiance.astype(np.float32)).levels
    spread = radiance.std()
    for direction in directions_of(20, seed=level):
        cosine = np.maximum(toward @ direction, 0.0)
        half = np.sqrt(0.5 + 0.5 * cosine)
        lobe = alpha**2 / (math.pi * (half**2 * (alpha**2 - 1.0) + 1.0) ** 2)
        weight = (lobe * cosine * solid)[..., None]
        expected = (weight * radiance).sum((0, 1)) / weight.sum()
        found = mirrored_light(levels, direction, ROUGHEST * level / (LEVELS - 1))
        np.testing.assert_allclose(found, expected, atol=0.1 * spread)


def test_edges_of_the_folded_square_join(smooth):
    for azimuth in np.linspace(0.0, 2.0 * math.pi, 40):
        pair = []
        for below in (0.95, 0.9501):
            flat = math.sqrt(1.0 - below**2)
            direction = [flat * math.cos(azimuth), -below, flat * math.sin(azimuth)]
            pair.append(mirrored_light(smooth.levels, np.array(direction), 0.2))
        np.testing.assert_allclose(*pair, atol=2e-3)


def test_even_light_is_mirrored_as_it_is():
    levels = Surround(np.full((64, 128, 3), 0.7, np.float32)).levels
    np.testing.assert_allclose(levels[..., :3], 0.7, rtol=1e-5)


def test_maps_are_float32_whatever_kind_of_number_their_gain_is():
    levels = Surround(np.ones((64, 128, 3), np.float32), gain=np.float64(3.0)).levels
    assert levels.dtype == np.float32
    np.testing.assert_allclose(levels[..., :3], 3.0, rtol=1e-5)


def test_scaled_light_is_filtered_once():
    light = Surround(smooth_light(sphere(COLUMNS)[0]).astype(np.float32), 0.3, 0.7)
    scaled = light.scaled(1.5).scaled(2.0)
    expected = Surround(light.radiance, 0.3, 2.0 * (1.5 * 0.7)).levels
    np.testing.assert_array_equal(scaled.levels, expected)
    assert scaled.unscaled is light


def test_turn_and_gain_are_those_of_the_map():
    radiance = smooth_light(sphere(COLUMNS)[0]).astype(np.float32)
    found = reduce_environment(radiance, rotation_deg=90.0).scaled(2.0).surround
    # counter-clockwise seen from above: what was at +X is now at -Z
    ahead = mirrored_light(found.levels, np.array([0.0, 0.0, -1.0]), 0.0)
    np.testing.assert_allclose(ahead, 2.0 * smooth_light(np.array([1.0, 0.0, 0.0])), atol=0.02)
    harmonics = reduce_environment(radiance, rotation_deg=90.0).scaled(2.0)
    toward = harmonics.irradiance_around(np.array([0.0, 0.0, -1.0]))
    away = harmonics.irradiance_around(np.array([0.0, 0.0, 1.0]))
    assert toward[0] > 1.5 * away[0]


def test_lamps_of_a_map_are_not_mirrored_twice():
    radiance = np.full((64, 128, 3), 0.5, np.float32)
    radiance[10:12, 30:32] = 400.0
    light = reduce_environment(radiance)
    assert light.lamps
    assert light.surround.levels[..., :3].max() < 40.0
