"""Gather over a cell of the aperture against its reference, and its invariants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.core.layers import Box
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.kernels.scatter.scatter_ref import gather_subaperture_ref
from nlens_video.kernels.scatter.subaperture_gather import (
    LARGEST_RADIUS_PX,
    gather_subaperture,
    subaperture_reach,
)


def card(height=40, width=50, *, coc=4.0):
    """A smooth opaque layer of one CoC."""
    y, x = np.mgrid[0:height, 0:width]
    light = np.stack([0.5 + 0.4 * np.sin(x / 5), 0.5 + 0.4 * np.cos(y / 4), x / width, 1 + 0 * x])
    rgba = np.ascontiguousarray(np.moveaxis(light, 0, 2), dtype=np.float32)
    return rgba, np.full((height, width), coc, np.float32)


def blurred(rgba, coc, target=None, **changes):
    whole = Box(0, 0, rgba.shape[1], rgba.shape[0])
    return gather_subaperture(rgba, rgba[..., 3] > 0, coc, target or whole, **changes)


@pytest.mark.slow
@settings(max_examples=15)
@given(
    st.integers(0, 2**31), st.integers(1, 12), st.integers(1, 12), st.floats(0.0, 9.0),
    st.floats(0.0, 1.0), st.floats(0.6, 1.6),
)  # fmt: skip
def test_gather_kernel_agrees_with_the_reference(
    seed, height, width, largest, filled, pixel_aspect
):
    rng = np.random.default_rng(seed)
    light = rng.normal(size=(height, width, 4)).astype(np.float32)
    covered = rng.random((height, width)) < filled
    coc = rng.uniform(-largest, largest, (height, width)).astype(np.float32)
    coc[~covered] = np.nan
    target = Box(-3, -2, width + 2, height + 3)
    fast = gather_subaperture(light, covered, coc, target, pixel_aspect=pixel_aspect)
    slow = gather_subaperture_ref(light, covered, coc, target, pixel_aspect=pixel_aspect)
    np.testing.assert_allclose(fast, slow, atol=2e-5)


@pytest.mark.parametrize(
    "width, largest, pixel_aspect",
    [(140, 3.0, 1.0), (40, 16.0, 0.25), (40, 16.0, 24 / 11), (40, 16.0, 80 / 33), (40, 16.0, 4.0)],
)
def test_gather_kernel_agrees_with_the_reference_on_wide_rows_and_pixels_far_from_square(
    width, largest, pixel_aspect
):
    rng = np.random.default_rng(1)
    light = rng.random((9, width, 4)).astype(np.float32)
    covered = rng.random((9, width)) < 0.7
    coc = rng.uniform(-largest, largest, (9, width)).astype(np.float32)
    fast, slow = (
        gather(light, covered, coc, Box(0, 3, width, 6), pixel_aspect=pixel_aspect)
        for gather in (gather_subaperture, gather_subaperture_ref)
    )
    np.testing.assert_allclose(fast, slow, atol=2e-5)


@pytest.mark.parametrize("coc", [-16.0, -5.0, 1.5, 3.0, 8.0, 16.0])
def test_gather_of_a_constant_coc_equals_scatter(coc):
    rgba, cocs = card(coc=coc)
    margin = subaperture_reach(abs(coc))
    wide = np.pad(rgba, ((margin, margin), (margin, margin), (0, 0)))
    other = scatter(wide, np.pad(cocs, margin))
    target = Box(0, 0, 50, 40).expanded(margin)
    assert np.abs(blurred(rgba, cocs, target) - other).max() < 0.035
    assert np.sqrt(np.mean((blurred(rgba, cocs, target) - other) ** 2)) < 0.006


def test_gather_keeps_pixels_in_focus():
    rgba, coc = card(coc=0.0)
    assert np.array_equal(blurred(rgba, coc), rgba)


def test_gathered_alpha_is_one_inside_and_zero_out_of_reach():
    rgba, coc = card()
    coc[:] = np.random.default_rng(0).uniform(-8.0, 8.0, coc.shape)
    reach = subaperture_reach(8.0)
    alpha = blurred(rgba, coc, Box(0, 0, 50, 40).expanded(reach + 3))[..., 3]
    inside = alpha[2 * reach + 3 : -2 * reach - 3, 2 * reach + 3 : -2 * reach - 3]
    np.testing.assert_allclose(inside, 1.0, atol=1e-5)
    assert not alpha[:3].any() and not alpha[:, -3:].any() and alpha.max() <= 1.0 + 1e-5


def test_sharp_edge_before_a_blurred_background_receives_none_of_its_light():
    rgba, coc = card(coc=-6.0)
    rgba[..., :3] = [1.0, 0.0, 0.0]
    rgba[:, 25:, :3], coc[:, 25:] = [0.0, 1.0, 0.0], 0.0
    seen = blurred(rgba, coc)
    assert not seen[:, 25:, 0].any()
    np.testing.assert_allclose(seen[:, 25:, 1], 1.0, atol=1e-6)


def test_blurred_edge_before_a_sharp_background_is_half_transparent():
    rgba, coc = card(coc=6.0)
    rgba[..., :3] = [1.0, 0.0, 0.0]
    rgba[:, 25:, :3], coc[:, 25:] = [0.0, 1.0, 0.0], 0.0
    seen = blurred(rgba, coc)[20]
    assert seen[24, 0] + seen[25, 0] == pytest.approx(1.0, abs=0.02)
    assert 0.5 < seen[24, 0] < 0.7 and seen[29, 0] == 0.0
    np.testing.assert_allclose(seen[10:40, 0] + seen[10:40, 1], 1.0, atol=1e-5)


def test_gather_does_not_depend_on_the_requested_box():
    rgba, coc = card()
    whole = blurred(rgba, coc, Box(-5, -5, 55, 45))
    part = blurred(rgba, coc, Box(7, -2, 31, 20))
    np.testing.assert_allclose(part, whole[3:25, 12:36], atol=1e-6)


def test_gather_refuses_too_large_discs_and_mismatched_shapes():
    rgba, coc = card()
    with pytest.raises(ValueError, match="at most"):
        blurred(rgba, coc + np.float32(2.0 * LARGEST_RADIUS_PX))
    with pytest.raises(ValueError, match="differ"):
        blurred(rgba, coc[:-1])
