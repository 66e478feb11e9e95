"""Grain kernels in C++: every level gives the same bits."""

import numpy as np
from support.native_levels import assert_same_bits


def test_white_noise_is_the_same_at_every_level():
    def run(module):
        out = np.empty((21, 37), np.float32)
        module.white_noise(out, (-5, 3), 2**32 - 2, 20, 0.007)
        return [out]

    assert_same_bits(run)


def test_sum_of_tiles_is_the_same_at_every_level():
    tile = np.random.default_rng(2).normal(size=(8, 8, 3)).astype(np.float32)
    corners = np.array([[-13, 5], [2, -70], [700, 7]])
    shares = np.array([0.5, 0.25, 0.125], np.float32)

    def run(module):
        out = np.full((11, 29, 3), np.nan, np.float32)
        module.add_tiles(out, tile, corners, shares)
        return [out]

    assert_same_bits(run)


def test_grain_on_a_layer_is_the_same_at_every_level():
    rng = np.random.default_rng(0)
    alpha = rng.choice([0.0, 0.3, 1.0], (30, 41, 1))
    rgba = np.concatenate([alpha * rng.uniform(0, 1.3, (30, 41, 3)), alpha], 2).astype(np.float32)
    plate, noise = rng.random((30, 41, 3), np.float32), rng.normal(size=(30, 41, 3))
    deviation = rng.uniform(0.01, 0.1, (3, 256)).astype(np.float32)
    codes, lights = (np.linspace(0.0, 1.0, 4097, dtype=np.float32) ** power for power in (0.9, 2.2))

    def run(module):
        out = rgba.copy()
        module.regrain(out, plate, noise.astype(np.float32), deviation, codes, lights)
        return [out]

    assert_same_bits(run)


def test_grain_of_a_darkened_plate_is_the_same_at_every_level():
    rng = np.random.default_rng(1)
    rgba = rng.choice([0.0, 0.13, 0.9], (30, 41, 1)) * rng.uniform(0, 1, (30, 41, 4))
    plate, noise = rng.random((30, 41, 3), np.float32), rng.normal(size=(30, 41, 3))
    deviation = rng.uniform(0.01, 0.1, (3, 256)).astype(np.float32)

    def run(module):
        out = rgba.astype(np.float32)
        module.restore_grain(out, plate, noise.astype(np.float32), deviation, 0.1, 0.2)
        return [out]

    assert_same_bits(run)


def test_light_that_is_no_number_stays_so_and_takes_nothing_else_along():
    rgba = np.full((1, 3, 4), 0.5, np.float32)
    rgba[0, 1, :3] = np.nan
    plate, noise = np.zeros((2, 1, 3, 3), np.float32)
    deviation, table = np.zeros((3, 256), np.float32), np.linspace(0, 1, 4097, dtype=np.float32)

    def run(module):
        out = rgba.copy()
        module.regrain(out, plate, noise, deviation, table, table)
        assert np.isnan(out[0, 1, :3]).all() and np.isfinite(out[0, ::2]).all()
        return [out]

    assert_same_bits(run)
