"""Reductions over three channels, against those of NumPy."""

import numpy as np

from nlens_video.kernels.channels import (
    all_channels,
    any_channel,
    channel_max,
    channel_sum,
    divided_channels,
    scaled_channels,
    scaled_pixels,
)

VALUES = np.random.default_rng(0).normal(size=(7, 5, 3)).astype(np.float32)


def test_maximum_sum_and_flags_are_those_of_numpy_bit_for_bit():
    wide = np.random.default_rng(1).normal(size=(7, 10, 6)).astype(np.float32)
    for values in (VALUES, VALUES.reshape(-1, 3), wide[:, ::2, 1:4]):
        assert np.array_equal(channel_max(values), values.max(axis=-1))
        assert np.array_equal(channel_sum(values), values.sum(axis=-1))
        assert np.array_equal(all_channels(values > -0.5), (values > -0.5).all(axis=-1))


def test_what_has_any_channel_is_that_of_numpy():
    rgba = np.random.default_rng(4).integers(0, 2, (9, 8, 4)).astype(np.float32)
    rgba[:3] = 0.0
    rgba[0, 0, 3] = np.nan
    assert np.array_equal(any_channel(rgba), (rgba != 0).any(axis=2))
    assert np.array_equal(any_channel(rgba[..., :3]), rgba[..., :3].any(axis=2))


def test_an_unknown_channel_makes_the_maximum_unknown():
    values = VALUES.copy()
    values[2, 3, 2] = np.nan
    assert np.array_equal(channel_max(values), values.max(axis=2), equal_nan=True)


def test_channels_are_scaled_and_divided_by_their_own_factors():
    factors = np.array([0.5, 3.0, 7.0], np.float32)
    assert np.array_equal(scaled_channels(VALUES, factors), VALUES * factors)
    assert np.array_equal(divided_channels(VALUES[:, 1:4], factors), VALUES[:, 1:4] / factors)


def test_pixels_are_scaled_by_their_own_factors():
    factors = np.random.default_rng(2).random((7, 5), np.float32)
    rgba = np.random.default_rng(3).random((7, 9, 4), np.float32)[:, 2:7]
    for values in (VALUES, rgba):
        assert np.array_equal(scaled_pixels(values, factors), values * factors[..., None])
