"""Foreground occlusion against the layers that the plate is made of, and hand-worked values."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    CocMap,
    DepthMap,
    ObjectLayer,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.occlusion import (
    CoverageFromCoc,
    CoverageFromDepth,
    foreground_light,
    foreground_matte,
    object_disparity,
)
from nlens_video.effects.shadow.apply import ApplyShadow, Shadow
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.stages.composite import Foreground, behind, composite, composite_behind
from nlens_video.stages.l_reblur import ReblurLayer
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT = 96, 64
FRAME = Box(0, 0, WIDTH, HEIGHT)
SHARE = hnp.arrays(np.float32, (3, 4), elements=st.floats(0, 1, width=32))
LIGHT = hnp.arrays(np.float32, (3, 4, 3), elements=st.floats(0, 4, width=32))


def ramp(width=24.0, middle=WIDTH / 2):
    """Coverage of the left half of the frame, blurred by a box of a width."""
    at = np.arange(WIDTH) + 0.5
    share = np.clip(0.5 - (at - middle) / width, 0.0, 1.0)
    return np.tile(share.astype(np.float32), (HEIGHT, 1))


def linear_picture(light):
    return ArrayPicture(light.astype(np.float32).copy(), "rgb", LINEAR)


def mixed(m, front, back):
    return m[..., None] * front + (1.0 - m[..., None]) * back


@settings(max_examples=60)
@given(SHARE, SHARE, LIGHT, LIGHT, LIGHT)
def test_layer_behind_a_foreground_equals_the_three_layer_composite(m, alpha, front, back, paint):
    layer = np.concatenate([alpha[..., None] * paint, alpha[..., None]], axis=2)
    plate = mixed(m, front, back).astype(np.float32)
    hidden = behind(layer, plate, m, m[..., None] * front)
    seen = hidden[..., :3] + (1.0 - hidden[..., 3:]) * plate
    truth = mixed(m, front, layer[..., :3] + (1.0 - layer[..., 3:]) * back)
    assert seen == pytest.approx(truth, abs=1e-5)


def test_foreground_colour_in_a_soft_edge_is_separated_from_the_background():
    m = ramp()
    front, back = np.array([0.9, 0.5, 0.1]), np.array([0.1, 0.2, 0.8])
    light = foreground_light(mixed(m, front, back).astype(np.float32), m, (0, 0))
    assert light == pytest.approx(m[..., None] * front, abs=1e-5)


def test_foreground_colour_of_a_thin_semitransparent_object_is_estimated():
    at = np.arange(WIDTH) + 0.5
    m = np.tile(0.4 * np.exp(-(((at - 48) / 6) ** 2)), (HEIGHT, 1)).astype(np.float32)
    m[m < 0.004] = 0.0
    front, back = np.array([0.1, 0.1, 0.1]), np.array([0.6, 0.7, 0.9])
    light = foreground_light(mixed(m, front, back).astype(np.float32), m, (0, 0))
    assert light == pytest.approx(m[..., None] * front, abs=0.01)


def test_soft_foreground_edge_keeps_no_halo_of_the_old_background():
    m = ramp()
    front, back, paint = np.full(3, 0.1), np.full(3, 0.9), np.full(3, 0.1)
    picture = linear_picture(mixed(m, front, back))
    cover = foreground_matte(picture, FRAME, m)
    layer = np.ones((HEIGHT, WIDTH, 4), np.float32) * np.float32([*paint, 1.0])
    blurred = BlurredLayer(box=FRAME, rgba=layer)
    composite(
        picture, blurred, Foreground(before_object=cover, before_ground=None, before_shadow=None)
    )
    assert picture.array == pytest.approx(np.full((HEIGHT, WIDTH, 3), 0.1), abs=1e-3)
    # what hiding by the matte alone leaves: a quarter of the background at the middle of the edge
    naive = mixed(m, mixed(m, front, back), paint)
    assert naive.max() > 0.28


def test_shadow_and_object_behind_a_foreground_equal_the_layered_composite():
    m, loss = ramp(), 0.6
    front, back, paint, alpha = np.full(3, 0.5), np.full(3, 0.8), np.full(3, 0.2), 0.7
    picture = linear_picture(mixed(m, front, back))
    cover = foreground_matte(picture, FRAME, m)
    shadow = Shadow(
        box=FRAME, loss=np.full((HEIGHT, WIDTH, 3), loss, np.float32),
        coc_px=np.zeros((HEIGHT, WIDTH), np.float32),
    )  # fmt: skip
    ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach))(picture, shadow, FRAME, cover)
    assert picture.array == pytest.approx(mixed(m, front, (1 - loss) * back), abs=2e-3)
    layer = np.ones((HEIGHT, WIDTH, 4), np.float32) * np.float32([*(alpha * paint), alpha])
    composite_behind(picture, FRAME, layer, cover)
    truth = mixed(m, front, alpha * paint + (1 - alpha) * (1 - loss) * back)
    assert picture.array == pytest.approx(truth, abs=3e-3)


def test_matte_of_one_keeps_the_plate_and_matte_of_zero_changes_nothing():
    rng = np.random.default_rng(2)
    plate = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    layer = rng.random((HEIGHT, WIDTH, 4), np.float32)
    m = ramp(width=20.0)
    hidden, plain = plate.copy(), plate.copy()
    composite_behind(ArrayPicture(plain), FRAME, layer, None)
    picture = ArrayPicture(hidden)
    composite_behind(picture, FRAME, layer, foreground_matte(picture, FRAME, m))
    assert np.array_equal(hidden[m == 1.0], plate[m == 1.0])
    assert np.array_equal(hidden[m == 0.0], plain[m == 0.0])
    assert (hidden != plain)[(m > 0.3) & (m < 0.7)].mean() > 0.5


def test_foreground_matte_does_not_depend_on_the_requested_region():
    picture = linear_picture(np.random.default_rng(3).random((HEIGHT, WIDTH, 3)) + 0.2)
    m = ramp(width=10.0)
    whole = foreground_matte(picture, FRAME, m)
    part = Box(30, 10, 66, 60)
    assert foreground_matte(picture, Box(70, 0, 90, 20), m) is None
    cut = foreground_matte(picture, part, m)
    at = part.slices_in(FRAME)
    assert np.array_equal(cut.coverage, whole.coverage[at])
    assert cut.light == pytest.approx(whole.light[at], abs=0.02)


def flat_object(depth, box):
    rgba = np.ones((box.height, box.width, 4), np.float32)
    return ObjectLayer(box=box, rgba=rgba, depth=np.full(rgba.shape[:2], depth, np.float32))


def half_plane(near, far):
    depth = np.full((HEIGHT, WIDTH), far, np.float32)
    depth[:, : WIDTH // 2] = near
    return DepthMap(depth)


def disc_share(x, radius):
    """Share of a disc that lies beyond a line at a signed distance x of its centre."""
    t = np.clip(x / radius, -1.0, 1.0)
    return 0.5 - (np.arcsin(t) + t * np.sqrt(1.0 - t * t)) / math.pi


@pytest.mark.parametrize("near", [1.0, 1.5])
def test_matte_from_depth_is_as_soft_as_the_occluders_coc(near):
    fit = LensFit(slope=40.0, intercept=-20.0, width=WIDTH, height=HEIGHT)  # +20 px at 1, +6.7
    surface = object_disparity(flat_object(3.0, Box(20, 10, 80, 50)), FRAME)
    cover = CoverageFromDepth(scatter=scatter)(half_plane(near, 8.0), surface, FRAME, fit)
    radius = 0.5 * (40.0 / near - 20.0)
    across = np.arange(WIDTH) + 0.5 - WIDTH / 2
    assert cover[HEIGHT // 2] == pytest.approx(disc_share(across, radius), abs=0.03)
    assert cover[:, 0] == pytest.approx(1.0) and cover[0, :20] == pytest.approx(1.0)  # at the rim


@pytest.mark.parametrize(("depth", "hides"), [(2.9, True), (2.97, False), (3.0, False), (9, False)])
def test_occluder_must_be_nearer_by_two_percent(depth, hides):
    surface = object_disparity(flat_object(3.0, Box(20, 10, 80, 50)), FRAME)
    real = DepthMap(np.full((HEIGHT, WIDTH), depth, np.float32))
    cover = CoverageFromDepth(scatter=scatter)(real, surface, FRAME, None)
    assert (cover == 1.0).all() if hides else not cover.any()


def test_unknown_depth_and_pixels_above_the_horizon_occlude_nothing():
    surface = np.where(np.arange(HEIGHT)[:, None] < 20, -0.1, 0.5) * np.ones(WIDTH)
    unknown = DepthMap(np.full((HEIGHT, WIDTH), np.inf, np.float32))
    nearer = DepthMap(np.full((HEIGHT, WIDTH), 1.0, np.float32))
    by_depth = CoverageFromDepth(scatter=scatter)
    assert not by_depth(unknown, surface.astype(np.float32), FRAME, None).any()
    assert not by_depth(nearer, surface.astype(np.float32), FRAME, None)[:18].any()


@pytest.mark.parametrize(
    ("coc", "surface_coc", "nearer"),
    [
        # The lens: CoC -20 at infinity. Margins here: 2 px (a tenth of it).
        (0.0, -10.0, True),  # in focus before an object that lies behind the focus
        (7.0, -10.0, True),  # on either side of the focus it is nearer
        (9.0, -10.0, False),  # it might be as far as the object
        (14.0, -10.0, False),  # farther, if it lies behind the focus
        (25.0, -10.0, True),  # so large a CoC there is only before the focus
        (3.0, 0.0, False),  # the object in focus: before it or behind it
        (23.0, 0.0, True),
        (23.0, 15.0, True),
        (23.0, 22.0, False),  # before the focus, but not surely nearer than the object
        (19.0, 15.0, False),
    ],
)
def test_coc_implies_occlusion_only_if_both_signs_of_the_coc_are_nearer(coc, surface_coc, nearer):
    fit = LensFit(slope=40.0, intercept=-20.0, width=2, height=2)
    plate = CocMap(
        coc_px=np.full((2, 2), coc, np.float32), sigma_px=np.full((2, 2), 0.1, np.float32)
    )
    disparity = np.full((2, 2), (surface_coc + 20.0) / 40.0, np.float32)
    assert CoverageFromCoc().nearer(plate, disparity, fit).all() == nearer


def test_uncertain_coc_occludes_nothing():
    fit = LensFit(slope=40.0, intercept=-20.0, width=2, height=2)
    disparity = np.full((2, 2), 0.25, np.float32)
    coc = np.zeros((2, 2), np.float32)
    sure, unsure = (
        CocMap(coc_px=coc, sigma_px=np.full((2, 2), sigma, np.float32)) for sigma in (1.0, 8.0)
    )
    assert CoverageFromCoc().nearer(sure, disparity, fit).all()
    assert not CoverageFromCoc().nearer(unsure, disparity, fit).any()


def test_matte_from_coc_is_refined_to_the_edge_in_the_picture():
    fit = LensFit(slope=40.0, intercept=-20.0, width=WIDTH, height=HEIGHT)
    picture = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    picture[:, WIDTH // 2 :] = 0.7
    coc = np.full((HEIGHT, WIDTH), 15.0, np.float32)
    coc[:, : WIDTH // 2 + 4] = 1.0  # the sharp edge makes the estimate sharp beyond it too
    plate = CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.5))
    surface = np.full((HEIGHT, WIDTH), 0.2, np.float32)  # at -12 px
    cover = CoverageFromCoc()(plate, surface, FRAME, fit, picture)
    assert cover[:, : WIDTH // 2 - 1] == pytest.approx(1.0, abs=0.02)
    assert cover[:, WIDTH // 2 + 1 :].mean() < 0.25 * 4 / (WIDTH // 2)
