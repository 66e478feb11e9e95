"""Light of patches in C++: every level gives the same bits, close to the reference."""

import numpy as np
import pytest
from support.native_levels import assert_same_bits

from nlens_video.effects.shadow.bounce import gather_patches_reference


@pytest.mark.parametrize(("points", "patches"), [(1, 1), (7, 3), (600, 20), (300, 0)])
def test_gathered_light_is_that_of_the_reference_at_every_level(points, patches):
    rng = np.random.default_rng(points)
    ground = rng.uniform(-3.0, 3.0, (points, 3)) * (1.0, 0.0, 1.0)
    normals = rng.normal(size=(patches, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    places = rng.uniform(-1.0, 1.0, (patches, 3)) + (0.0, 0.8, 0.0)  # some below the ground
    rest = rng.uniform(0.0, 1.0, (patches, 4))
    rows = np.column_stack([places, normals, rest]).astype(np.float32)
    ground = ground.astype(np.float32)
    expected = np.full((points, 3), 0.25, np.float32)
    gather_patches_reference(ground, rows, expected)

    def run(module):
        found = np.full((points, 3), 0.25, np.float32)
        module.gather_patches(ground, rows, found)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
        return [found]

    assert_same_bits(run)


def test_patch_that_touches_the_ground_gives_finite_light():
    point = np.zeros((1, 3), np.float32)
    row = np.array([[0, 0, 0, 0, -1, 0, 0.5, 1, 1, 1]], np.float32)

    def run(module):
        found = np.zeros((1, 3), np.float32)
        module.gather_patches(point, row, found)
        assert np.array_equal(found, [[0.0, 0.0, 0.0]])
        return [found]

    assert_same_bits(run)
