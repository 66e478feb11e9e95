"""Exposure kernels in C++: every level gives the same bits."""

import numpy as np
from support.native_levels import assert_same_bits


def test_change_of_light_is_the_same_at_every_level():
    rng = np.random.default_rng(1)
    light = rng.uniform(0.005, 0.9, (2, 24, 40, 3)).astype(np.float32)
    light[1] = light[0] * rng.uniform(1.1, 1.3, (24, 40, 3)).astype(np.float32)

    def run(module):
        stops, change = np.empty_like(light), np.empty(3)
        for picture, out in zip(light, stops, strict=True):
            module.take_stops(picture, (0.01, 0.8), out)
        assert module.take_change(stops[0], stops[1], 0.25, 0.2, change)
        return [stops, change]

    assert_same_bits(run)


def test_pictures_without_a_known_pixel_tell_no_change():
    def run(module):
        nothing, change = np.full((4, 5, 3), np.nan, np.float32), np.zeros(3)
        assert not module.take_change(nothing, nothing, 0.0, 1.0, change)
        return [change]

    assert_same_bits(run)
