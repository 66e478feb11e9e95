import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from nlens_video.kernels.coc_discontinuities import (
    BESIDE_PX,
    FULL_STEP_PX,
    SPARE_PX,
    STEP_PX,
    CocDiscontinuities,
    HiddenSurface,
    extend_nearest,
    find_discontinuities,
)
from nlens_video.kernels.depth_layers import cut_share, split_at_steps

OPAQUE = np.float32([0.4, 0.2, 0.1, 1.0])


def two_cards(near=12.0, far=2.0):
    """A near square before the left part of a far one, nothing on the right."""
    rgba, coc = np.zeros((40, 60, 4), np.float32), np.zeros((40, 60), np.float32)
    rgba[:, :45], coc[:, :45] = OPAQUE, far
    rgba[10:30, 10:30], coc[10:30, 10:30] = 2 * OPAQUE * (0.5, 0.5, 0.5, 0.5), near
    rgba[10:30, 10:30, 0] = 0.9
    return rgba, coc


def test_slope_is_not_a_depth_discontinuity():
    rgba = np.ones((30, 30, 4), np.float32)
    coc = np.fromfunction(lambda y, x: 1.2 * x - 20, (30, 30)).astype(np.float32)
    assert find_discontinuities(rgba, coc) is None


def test_silhouette_before_nothing_is_not_a_depth_discontinuity():
    rgba, coc = two_cards(near=2.0)
    assert find_discontinuities(rgba, coc) is None


def test_discontinuity_reaches_as_far_as_the_larger_disc_and_splits_halfway():
    rgba, coc = two_cards(near=10.0, far=4.0)
    steps = find_discontinuities(rgba, coc)
    assert np.all(steps.split_px == 7.0)
    along = steps.inside_px[20]  # the near card's edges lie between columns 9, 10 and 29, 30
    assert along[9] == along[10] == pytest.approx(5.0 + SPARE_PX)
    assert along[20] == 0.0 and along[4] > 0.0 and along[0] == 0.0
    assert along[36] > 0.0 and along[40] == 0.0


def hidden_from_column(rgba, first):
    """What a near card hides that covers columns 10 to 29 of `two_cards`, from a column on."""
    seen = np.zeros_like(rgba)
    seen[10:30, first:30] = OPAQUE
    coc = np.where(seen[..., 3] > 0.0, np.float32(2.0), np.float32(0.0))
    return HiddenSurface(rgba=seen, coc_px=coc, front_rgba=rgba)


def test_steep_coc_change_that_hides_nothing_is_not_a_discontinuity():
    rgba, coc = two_cards(near=12.0, far=2.0)
    assert find_discontinuities(rgba, coc, hidden_from_column(rgba, 30)) is None


def test_discontinuity_fades_with_the_distance_of_the_hidden_surface():
    rgba, coc = two_cards(near=12.0, far=2.0)
    reaches = []
    for first in range(10, 22):
        steps = find_discontinuities(rgba, coc, hidden_from_column(rgba, first))
        reaches.append(float(steps.inside_px[20, 10]))
    whole = int(BESIDE_PX) + 1
    assert reaches[:whole] == [reaches[0]] * whole and reaches[0] == 6.0 + SPARE_PX
    assert np.diff(reaches).max() <= 0.0 and np.diff(reaches).min() > -0.4 * reaches[0]
    assert reaches[2 * whole :] == [0.0] * len(reaches[2 * whole :])


def test_reach_of_a_discontinuity_grows_continuously_with_its_size():
    reaches = []
    for step in np.linspace(STEP_PX - 0.1, FULL_STEP_PX + 0.5, 30):
        steps = find_discontinuities(*two_cards(near=2.0 + step, far=2.0))
        reaches.append(0.0 if steps is None else float(steps.inside_px.max()))
    assert reaches[0] == 0.0 and reaches[-1] > 5.0
    assert np.diff(reaches).min() >= 0.0 and np.diff(reaches).max() < 0.5


def test_back_layer_is_extended_under_the_near_layer():
    rgba, coc = two_cards()
    layers = split_at_steps(rgba, coc, find_discontinuities(rgba, coc))
    near = coc == 12.0
    assert layers.near_rgba[near] == pytest.approx(rgba[near], abs=1e-6)
    assert not layers.near_rgba[~near].any()
    assert np.array_equal(layers.back_rgba[~near], rgba[~near])
    assert layers.back_rgba[near] == pytest.approx(np.tile(OPAQUE, (400, 1)), abs=1e-5)
    assert layers.back_coc_px[near] == pytest.approx(np.full(400, 2.0), abs=1e-4)


def test_back_layer_is_not_extended_under_a_silhouette_before_nothing():
    rgba, coc = two_cards()
    rgba[:, :45][coc[:, :45] == 2.0] = 0.0  # only the near card is left …
    rgba[:, :5], coc[:, :5] = OPAQUE, 2.0
    rgba[:, 5:10], coc[:, 5:10] = OPAQUE, 2.0  # … and a strip behind its left side
    layers = split_at_steps(rgba, coc, find_discontinuities(rgba, coc))
    under = layers.back_rgba[20, 10:30, 3]
    assert under[0] > 0.7 and under[-1] < 0.2 and np.all(np.diff(under) < 0.05)


@pytest.mark.parametrize("red", [0.9, -0.2])  # negative in colours of a wide gamut
def test_antialiased_edges_of_the_near_layer_hold_only_its_own_light(red):
    rgba, coc = two_cards()
    near_light, far_light = np.float32([red, 0.1, 0.1, 1.0]), OPAQUE
    rgba[10:30, 10:30] = near_light
    rgba[10:30, 29] = 0.25 * near_light + 0.75 * far_light  # a quarter of its last column
    layers = split_at_steps(rgba, coc, find_discontinuities(rgba, coc))
    assert layers.near_rgba[12:28, 29] == pytest.approx(
        np.tile(0.25 * near_light, (16, 1)), abs=1e-4
    )
    whole = layers.near_rgba + (1 - layers.near_rgba[..., 3:]) * layers.back_rgba
    assert whole == pytest.approx(rgba, abs=1e-5)


def test_extension_of_the_back_layer_does_not_depend_on_the_crop():
    rng = np.random.default_rng(2)
    rgba, coc = two_cards()
    rgba[:, :45, :3] *= rng.random((40, 45, 1), dtype=np.float32)
    whole = split_at_steps(rgba, coc, find_discontinuities(rgba, coc), corner=(64, 128))
    part = split_at_steps(
        np.ascontiguousarray(rgba[3:, 5:]), coc[3:, 5:],
        find_discontinuities(rgba[3:, 5:], coc[3:, 5:]),
        corner=(67, 133),
    )  # fmt: skip
    rim = (slice(10, 30), slice(10, 30))
    inner = (slice(7, 27), slice(5, 25))
    assert part.back_rgba[inner] == pytest.approx(whole.back_rgba[rim], abs=0.01)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 23), width=st.integers(1, 23))
def test_unknown_pixels_take_the_value_of_the_nearest_known_pixel(seed, height, width):
    rng = np.random.default_rng(seed)
    values = rng.random((height, width), dtype=np.float32)
    known = rng.random((height, width)) < 0.3
    known[rng.integers(height), rng.integers(width)] = True
    found = extend_nearest(values, known)
    places = np.argwhere(known)
    for y, x in np.argwhere(~known):
        distance = np.hypot(*(places - (y, x)).T)
        close = places[distance <= 1.03 * distance.min()]  # the transform is off by 2 %
        assert found[y, x] in values[close[:, 0], close[:, 1]]
    assert np.array_equal(found[known], values[known])


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), height=st.integers(2, 40), width=st.integers(2, 40))
def test_splitting_any_layer_gives_finite_values_within_its_range(seed, height, width):
    rng = np.random.default_rng(seed)
    alpha = rng.choice(np.float32([0.0, 0.3, 1.0]), (height, width, 1))
    rgba = alpha * np.float32(rng.random((height, width, 4)))
    rgba[..., 3:] = alpha
    coc = np.float32(rng.choice([-9.0, 0.0, 5.0, 5.5, 20.0], (height, width)))
    steps = find_discontinuities(rgba, coc)
    if steps is None:
        return
    layers = split_at_steps(rgba, coc, steps)
    for part in (layers.near_rgba, layers.back_rgba):
        assert np.isfinite(part).all() and part.min() >= 0.0 and part.max() <= 1.0 + 1e-6
    assert np.abs(layers.back_coc_px).max() <= 20.001


def hiding(coc_px, disc_px=60.0):
    """A surface of one CoC, cut at column 120 by splits beyond and below it, above another one."""
    rgba, coc = np.ones((240, 240, 4), np.float32), np.full((240, 240), disc_px, np.float32)
    split = np.where(np.arange(240) < 120, coc + np.float32(10.0), coc - np.float32(10.0))
    steps = CocDiscontinuities(inside_px=coc, split_px=split)
    behind = HiddenSurface(rgba=rgba, coc_px=np.full_like(coc, coc_px), front_rgba=rgba)
    return rgba, coc, steps, behind


def test_cut_through_a_surface_that_hides_another_counts_as_far_as_its_disc_reaches():
    share = cut_share(*hiding(2.0))[120]
    assert share[90:151].min() == 1.0  # a disc's radius each way
    assert 0.0 < share[70] < 1.0 and 0.0 < share[170] < 1.0
    assert share[:25].max() < 0.01 and share[215:].max() < 0.01


def test_cut_counts_by_its_length_and_by_the_step_to_what_it_hides():
    rgba, coc, steps, behind = hiding(2.0)
    there = behind.rgba.copy()
    there[:120] = there[121:] = 0.0
    few = cut_share(rgba, coc, steps, replace(behind, rgba=there))
    assert 0.0 < few.max() < 0.3
    most = [cut_share(*hiding(60.0 - step)).max() for step in (2.1, 2.3, 4.0)]
    assert 0.0 < most[0] < most[1] < most[2] == 1.0


def test_cut_under_small_discs_is_none():
    assert cut_share(*hiding(2.0, disc_px=28.0)) is None


def test_cut_above_a_surface_of_the_same_blur_is_none():
    assert cut_share(*hiding(59.0)) is None
