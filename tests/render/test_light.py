"""Exposure change of small pictures against its reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.effects import light_change


@settings(max_examples=200)
@given(
    seed=st.integers(0, 100_000), count=st.integers(1, 300),
    among=st.sampled_from(["normal", "few", "signs", "huge"]),
)  # fmt: skip
def test_median_of_the_change_agrees_with_numpy(seed, count, among):
    rng = np.random.default_rng(seed)
    values = {
        "normal": lambda: rng.normal(size=count),
        "few": lambda: rng.choice([-1.0, 0.5, 2.0], count),
        "signs": lambda: rng.choice([0.0, -0.0, 1e-45, -1e-45], count),
        "huge": lambda: rng.choice([-1e38, 1e38, 1.0], count),
    }[among]().astype(np.float32)
    now, found = np.repeat(values[None, :, None], 3, axis=2), np.empty(3)
    assert light_change.take_change(np.zeros_like(now), now, 0.0, np.inf, found)
    assert (found == np.sort(values)[count // 2]).all()


def pictures(seed, noise, lost):
    rng = np.random.default_rng(seed)
    before = rng.uniform(0.005, 0.9, (12, 20, 3)).astype(np.float32)
    now = (
        before * 2 ** rng.normal(0.0, 0.3, 3) * 2 ** rng.normal(0.0, noise, before.shape)
    ).astype(np.float32)
    now[rng.random((12, 20)) < lost] = 0.0
    return before, now


def stops_of(light):
    out = np.empty_like(light)
    light_change.take_stops(light, out)
    return out


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000), noise=st.sampled_from([0.0, 0.02, 0.3, 1.0]),
    lost=st.sampled_from([0.0, 0.3, 0.9]),
)  # fmt: skip
def test_exposure_change_kernel_agrees_with_the_reference(seed, noise, lost):
    before, now = (stops_of(light) for light in pictures(seed, noise, lost))
    found = np.empty(3)
    told = light_change.take_change(before, now, 0.25, 0.2, found)
    expected = light_change.change_reference(before, now, 0.25, 0.2)
    assert told == (expected is not None)
    if expected is not None:
        np.testing.assert_array_equal(found, expected)


def test_stops_kernel_agrees_with_the_reference():
    before, now = pictures(3, 0.5, 0.2)
    for light in (before, now):
        np.testing.assert_allclose(stops_of(light), light_change.stops_reference(light), atol=1e-6)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, -1.0])
def test_light_that_is_not_finite_is_marked_unknown(wrong):
    light = np.full((2, 2, 3), 0.5, np.float32)
    light[0, 1, 2] = wrong
    assert np.isnan(stops_of(light)[0, 1]).all()
    assert np.isfinite(stops_of(light)[1]).all()
