"""The layered scatter: its reference, its fast version, and what both promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.kernels.extend import blur_reach
from nlens_video.kernels.scatter import scatter
from nlens_video.kernels.scatter_ref import scatter_ref


def blob(height=40, width=44, *, margin=12, seed=0):
    """A coloured, opaque rectangle with a transparent margin."""
    rng = np.random.default_rng(seed)
    rgba = np.zeros((height, width, 4), np.float32)
    inner = rgba[margin:-margin, margin:-margin]
    inner[..., :3] = rng.random((*inner.shape[:2], 3))
    inner[..., 3] = 1.0
    return rgba


def test_coc_zero_is_the_identity_bit_for_bit():
    rgba = blob()
    rgba[14, 14] = (0.1, 0.2, 0.3, 0.37)
    np.testing.assert_array_equal(scatter(rgba, np.zeros(rgba.shape[:2], np.float32)), rgba)


@pytest.mark.parametrize("coc", [1.3, 3.0, 6.9, 7.7, 14.0])
def test_energy_of_an_isolated_blob_is_kept_at_constant_coc(coc):
    rgba = blob()
    out = scatter(rgba, np.full(rgba.shape[:2], coc, np.float32))
    np.testing.assert_allclose(out.sum((0, 1)), rgba.sum((0, 1)), rtol=1e-3)


def test_alpha_stays_one_inside_on_a_45_degree_ramp_through_focus():
    rgba = np.ones((60, 60, 4), np.float32)
    coc = np.add.outer(np.arange(60.0), np.zeros(60)).astype(np.float32) - 30.0
    np.testing.assert_array_equal(scatter(rgba, coc)[..., 3], 1.0)


@settings(max_examples=25, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 17), st.integers(1, 17)),
    largest=st.floats(0.0, 6.0),
    seed=st.integers(0, 999),
)
def test_fast_and_reference_agree_on_random_layers(shape, largest, seed):
    rng = np.random.default_rng(seed)
    rgba = rng.random((*shape, 4), dtype=np.float32)
    rgba[rng.random(shape) < 0.4] = 0.0
    coc = rng.uniform(-largest, largest, shape).astype(np.float32)
    np.testing.assert_allclose(scatter(rgba, coc), scatter_ref(rgba, coc), atol=2e-3)


def test_values_that_are_not_finite_are_refused():
    rgba = blob()
    rgba[20, 20, 0] = np.nan
    with pytest.raises(ValueError, match="finite"):
        scatter(rgba, np.zeros(rgba.shape[:2], np.float32))


def test_blur_reach_is_where_the_blur_ends():
    rgba = blob()
    coc = np.full(rgba.shape[:2], 9.0, np.float32)
    assert blur_reach(coc, rgba[..., 3]) == 4
    rows = np.flatnonzero(scatter(rgba, coc)[..., 3].any(axis=1))
    assert (rows[0], rows[-1]) == (12 - 4, 27 + 4)
