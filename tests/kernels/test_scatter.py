"""The layered scatter: the fast version against its reference, and the invariants of both."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.lens_truth import Slab, lens, pinhole, psnr_over_plate

from nlens_video.core.layers import Box
from nlens_video.kernels.scatter.scatter import (
    DRAFT,
    FINE,
    blur_reach,
    scatter,
)
from nlens_video.kernels.scatter.scatter_ref import scatter_ref


def blob(height=40, width=44, *, margin=12, seed=0):
    """A coloured, opaque rectangle with a transparent margin."""
    rng = np.random.default_rng(seed)
    rgba = np.zeros((height, width, 4), np.float32)
    inner = rgba[margin:-margin, margin:-margin]
    inner[..., :3] = rng.random((*inner.shape[:2], 3))
    inner[..., 3] = 1.0
    return rgba


def test_scatter_with_coc_zero_is_the_identity_bit_for_bit():
    rgba = blob()
    rgba[14, 14] = (0.1, 0.2, 0.3, 0.37)
    np.testing.assert_array_equal(scatter(rgba, np.zeros(rgba.shape[:2], np.float32)), rgba)


@pytest.mark.parametrize("coc", [1.3, 3.0, 6.9, 7.7, 14.0])
def test_scatter_keeps_the_energy_of_an_isolated_blob(coc):
    rgba = blob()
    out = scatter(rgba, np.full(rgba.shape[:2], coc, np.float32))
    np.testing.assert_allclose(out.sum((0, 1)), rgba.sum((0, 1)), rtol=1e-3)


def test_alpha_stays_one_inside_a_ramp_through_focus():
    rgba = np.ones((60, 60, 4), np.float32)
    coc = np.add.outer(np.arange(60.0), np.zeros(60)).astype(np.float32) - 30.0
    np.testing.assert_array_equal(scatter(rgba, coc)[..., 3], 1.0)


@settings(max_examples=25)
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


def test_scatter_refuses_values_that_are_not_finite():
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


def ramp(shape, start, stop):
    """A CoC that runs from top to bottom."""
    return np.repeat(
        np.linspace(start, stop, shape[0], dtype=np.float32)[:, None], shape[1], axis=1
    )


@pytest.mark.parametrize("aspect", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("largest", [9.0, 20.0])
def test_fast_and_reference_agree_on_a_ramp_of_large_discs(largest, aspect):
    # Spans round the stepped ends of a disc's rows: a share of its rim, smaller the larger it is.
    rgba = blob(56, 50, margin=16)
    coc = ramp(rgba.shape[:2], -largest / 3, largest)
    fast = scatter(rgba, coc, pixel_aspect=aspect)
    slow = scatter_ref(rgba, coc, pixel_aspect=aspect)
    np.testing.assert_allclose(fast, slow, atol=0.02)
    assert np.sqrt(np.mean((fast - slow) ** 2)) < 2e-3


def test_fast_and_reference_agree_on_separate_parts():
    rgba = np.zeros((44, 72, 4), np.float32)
    rgba[8:16, 6:14] = (0.2, 0.4, 0.6, 1.0)
    rgba[24:34, 50:60] = (0.3, 0.1, 0.2, 0.5)
    coc = np.zeros((44, 72), np.float32)
    coc[:20], coc[20:] = 17.0, -4.0
    fast, slow = scatter(rgba, coc), scatter_ref(rgba, coc)
    assert (fast[..., 3] > 0)[slow[..., 3] > 1e-3].all()
    np.testing.assert_allclose(fast, slow, atol=0.02)


def test_scatter_of_a_mirrored_ramp_is_the_mirrored_scatter():
    # Its discs are as skew as they can be, and their spans the furthest from the pixel.
    coc = np.repeat(90.0 - np.arange(100, dtype=np.float32)[None], 60, axis=0)
    rgba = np.zeros((60, 100, 4), np.float32)
    rgba[25:35, :30] = 1.0
    plain, mirrored = scatter(rgba, coc), scatter(rgba[:, ::-1], coc[:, ::-1])[:, ::-1]
    assert plain[..., 3].max() > 0.05
    np.testing.assert_allclose(mirrored, plain, atol=1e-6)


def test_scatter_does_not_depend_on_the_sign_of_the_coc():
    rgba = blob()
    coc = ramp(rgba.shape[:2], 1.0, 11.0)
    np.testing.assert_array_equal(scatter(rgba, coc), scatter(rgba, -coc))


def test_scatter_is_bit_identical_on_any_number_of_threads():
    rgba = blob(61, 47)
    coc = ramp(rgba.shape[:2], -9.0, 14.0)
    one = scatter(rgba, coc, threads=1)
    for threads in (2, 3):
        np.testing.assert_array_equal(scatter(rgba, coc, threads=threads), one)


def test_scatter_of_a_shifted_layer_is_the_shifted_scatter():
    rgba = blob(60, 60, margin=20)
    coc = ramp((60, 60), 0.0, 12.0)
    moved = scatter(np.roll(rgba, (3, 5), (0, 1)), np.roll(coc, (3, 5), (0, 1)))
    np.testing.assert_allclose(moved, np.roll(scatter(rgba, coc), (3, 5), (0, 1)), atol=1e-6)


@settings(max_examples=10)
@given(gain=st.floats(1e-3, 1e4), coc=st.floats(0.0, 12.0))
def test_scatter_is_linear_in_light_and_keeps_highlights(gain, coc):
    rgba = blob()
    plane = np.full(rgba.shape[:2], coc, np.float32)
    bright = rgba.copy()
    bright[..., :3] *= np.float32(gain)
    scaled = scatter(rgba, plane)[..., :3] * np.float32(gain)
    np.testing.assert_allclose(scatter(bright, plane)[..., :3], scaled, rtol=1e-4, atol=1e-6 * gain)


def test_scatter_is_monotone_in_light():
    rgba = blob()
    coc = ramp(rgba.shape[:2], -8.0, 8.0)
    brighter = rgba.copy()
    brighter[20, 20, :3] += 5.0
    assert (scatter(brighter, coc) - scatter(rgba, coc)).min() > -1e-6


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (7, 5)])
@pytest.mark.parametrize("coc", [0.0, 0.7, 5.0, 60.0])
def test_opaque_layer_of_any_shape_keeps_alpha_and_colour(shape, coc):
    out = scatter(np.ones((*shape, 4), np.float32), np.full(shape, coc, np.float32))
    np.testing.assert_allclose(out, 1.0, rtol=1e-6)


@pytest.mark.parametrize("coc", [200.0, 3e3])
def test_very_large_coc_gives_finite_small_alpha(coc):
    rgba = blob(32, 34)
    out = scatter(rgba, np.full(rgba.shape[:2], coc, np.float32))
    assert np.isfinite(out).all()
    assert 0.0 < out[..., 3].max() < 0.05


def test_empty_layer_scatters_to_zero_and_its_coc_is_not_read():
    rgba = np.zeros((5, 6, 4), np.float32)
    assert not scatter(rgba, np.full((5, 6), np.nan, np.float32)).any()


def test_scatter_writes_nothing_out_of_reach():
    rgba = np.zeros((80, 80, 4), np.float32)
    rgba[40, 40] = 1.0
    out = scatter(rgba, np.full((80, 80), 10.0, np.float32))
    rows, columns = np.nonzero(out.any(axis=2))
    assert rows.min() >= 35 and rows.max() <= 45 and columns.min() >= 35 and columns.max() <= 45


def test_blur_changes_smoothly_while_the_coc_grows():
    rgba = blob(36, 36, margin=14)
    steps = [scatter(rgba, np.full((36, 36), c, np.float32)) for c in np.arange(0.0, 10.0, 0.02)]
    change = np.abs(np.diff(np.stack(steps), axis=0)).max(axis=(1, 2, 3))
    assert change.max() < 0.02
    bend = np.abs(np.diff(np.stack(steps), 2, axis=0)).max(axis=(1, 2, 3))
    assert bend.max() < 0.01


def test_pixel_aspect_scales_the_disc_along_columns():
    rgba = np.zeros((41, 41, 4), np.float32)
    rgba[20, 20] = 1.0
    out = scatter(rgba, np.full((41, 41), 16.0, np.float32), pixel_aspect=0.5)[..., 3]
    seen = np.argwhere(out > 0.0)
    assert np.ptp(seen[:, 1]) == 16
    assert np.ptp(seen[:, 0]) == 8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slab", "least_db"),
    [
        (Slab(corners=(16, 16, 116, 86), coc_px=-3.2, slope=(0.2, 0.0)), 49.0),
        (Slab(corners=(16, 16.3, 116.4, 86), coc_px=-12.4, slope=(0.05, 0.35)), 46.0),
        (Slab(corners=(16.2, 16, 116, 86.6), coc_px=13.0), 53.0),
        (Slab(corners=(16.2, 16, 116, 86.6), coc_px=2.0), 42.0),
    ],
    ids=["tilted, 0 to 20 px", "tilted through focus", "13 px", "2 px"],
)
def test_scatter_of_a_slab_agrees_with_a_sampled_lens(slab, least_db):
    # Checks of full contrast, finer than a renderer's filtered textures: the hard case near focus.
    sharp, coc = pinhole([slab], (102, 132))
    truth = lens([slab], (102, 132), views=300)
    assert psnr_over_plate(scatter(sharp, coc), truth) > least_db


@pytest.mark.slow
def test_large_discs_on_coarse_pixels_agree_with_the_reference():
    rgba = blob(150, 160, margin=60, seed=3)
    rgba[75, 80, :3] = 50.0  # a highlight
    for coc in (36.0, 75.0):
        plane = np.full(rgba.shape[:2], coc, np.float32)
        fast, slow = scatter(rgba, plane), scatter_ref(rgba, plane)
        assert psnr_over_plate(fast, slow) > 50.0


def test_transition_to_coarser_pixels_has_no_seam():
    rgba = np.ones((90, 90, 4), np.float32)
    rgba[..., :3] = 0.5
    out = scatter(rgba, ramp((90, 90), 20.0, 100.0))
    np.testing.assert_allclose(out[..., :3], 0.5, atol=2e-6)
    np.testing.assert_array_equal(out[..., 3], 1.0)


@pytest.mark.parametrize("detail", [FINE, DRAFT], ids=["fine", "draft"])
def test_scatter_does_not_depend_on_the_crop_of_the_layer(detail):
    rgba, coc = blob(90, 84, margin=36), ramp((90, 84), 3.0, 30.0)
    whole = scatter(rgba, coc, frame=Box(0, 0, 84, 90), detail=detail)
    wide = np.pad(rgba, ((5, 3), (7, 2), (0, 0)))
    shifted = scatter(wide, np.pad(coc, ((5, 3), (7, 2))), frame=Box(7, 5, 91, 95), detail=detail)
    np.testing.assert_allclose(shifted[5:-3, 7:-2], whole, atol=1e-5)


def largest_bend(frames):
    """The largest mean second difference from frame to frame: what pops shows there."""
    return float(np.abs(np.diff(np.stack(frames), 2, axis=0)).mean(axis=(1, 2, 3)).max())


@pytest.mark.slow
@pytest.mark.parametrize(("detail", "times"), [(FINE, 1.2), (DRAFT, 1.5)], ids=["fine", "draft"])
def test_object_sliding_by_tenths_of_a_pixel_does_not_flicker(detail, times):
    # An antialiased edge bends by itself as it crosses pixels: the definition says how much.
    slabs = [
        Slab(corners=(20 + s, 20.3, 52 + s, 50), coc_px=2.0 - 0.35 * s, slope=(0.35, 0.0))
        for s in np.arange(0.0, 1.2, 0.1)
    ]
    frames = [pinhole([slab], (70, 74)) for slab in slabs]
    seen = largest_bend([scatter(*frame, detail=detail) for frame in frames])
    assert seen < times * largest_bend([scatter_ref(*frame) for frame in frames])


def centroid(picture):
    """Column and row of the mean place of light (h, w)."""
    light = picture.astype(np.float64)
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]]
    return np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()


@pytest.mark.parametrize("coc", [40.0, 100.0, 300.0])
@pytest.mark.parametrize("detail", [FINE, DRAFT], ids=["fine", "draft"])
def test_disc_of_a_highlight_moves_as_far_as_the_highlight(coc, detail):
    one = np.ones((1, 1), np.float32)
    reach = blur_reach(coc * one, one, detail=detail)
    side = 2 * reach + 16
    for column, row in ((0, 0), (1, 3), (6, 2), (7, 7), (13, 11)):
        rgba = np.zeros((side, side, 4), np.float32)
        rgba[reach + row, reach + column] = 1.0
        seen = scatter(rgba, np.full((side, side), coc, np.float32), detail=detail)
        expected = reach + np.array([column, row])
        np.testing.assert_allclose(centroid(seen[..., 3]), expected, atol=0.02)


def test_edge_width_is_the_edges_own_coc():
    coverage = []
    for slope in (0.0, 0.1, 0.3, 0.5):
        columns = np.arange(120, dtype=np.float32)
        rgba = np.zeros((41, 120, 4), np.float32)
        rgba[:, :60] = 1.0
        coc = np.tile(12.0 + slope * (59.5 - columns), (41, 1)).astype(np.float32)
        coverage.append(scatter(rgba, coc)[20, :, 3])
    off = [float(np.abs(sloping - coverage[0]).max()) for sloping in coverage[1:]]
    assert off[0] < 0.004 and off[1] < 0.01 and off[2] < 0.017


@pytest.mark.slow
@pytest.mark.parametrize(("detail", "times"), [(FINE, 1.2), (DRAFT, 1.5)], ids=["fine", "draft"])
def test_object_moving_through_focus_does_not_flicker(detail, times):
    rgba = blob(56, 56, margin=20)
    planes = [np.full((56, 56), c, np.float32) for c in np.arange(-9.0, 9.0, 0.4)]
    seen = largest_bend([scatter(rgba, plane, detail=detail) for plane in planes])
    assert seen < times * largest_bend([scatter_ref(rgba, plane) for plane in planes])


@pytest.mark.slow
@pytest.mark.parametrize(("slope", "start"), [((0.2, 0.0), -3.2), ((0.05, 0.35), -12.4)])
def test_draft_scatter_of_a_slab_is_above_36_db(slope, start):
    slab = Slab(corners=(16, 16.3, 116.4, 86), coc_px=start, slope=slope)
    sharp, coc = pinhole([slab], (102, 132))
    truth = lens([slab], (102, 132), views=300)
    assert psnr_over_plate(scatter(sharp, coc, detail=DRAFT), truth) > 36.0


@pytest.mark.parametrize("detail", [FINE, DRAFT], ids=["fine", "draft"])
def test_scatter_of_requested_pixels_equals_the_whole(detail):
    rng = np.random.default_rng(3)
    rgba = blob(90, 110, margin=34)
    coc = rng.uniform(-60.0, 60.0, (3, 3)).repeat(30, axis=0).repeat(37, axis=1)[:, :110]
    coc = np.ascontiguousarray(coc, np.float32)
    wanted = np.zeros(coc.shape, np.bool_)
    wanted[20:41, 30:50] = wanted[35:60, 70:95] = True
    whole = scatter(rgba, coc, detail=detail)
    part = scatter(rgba, coc, detail=detail, wanted=wanted)
    np.testing.assert_allclose(part[wanted], whole[wanted], atol=2e-6)
    assert not part[:20].any() and not part[:, :30].any() and not part[60:].any()
    assert not scatter(rgba, coc, wanted=np.zeros_like(wanted)).any()
