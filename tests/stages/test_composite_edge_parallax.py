"""Edge parallax: a half-occluded lens at a blurred edge, against a sampled aperture."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.definitions import edge_parallax_by_pixels

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    ObjectLayer,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.aperture_covariance import edge_parallax_layer
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.scene.camera import Camera
from nlens_video.stages.composite import apply_edge_parallax, edge_surroundings
from nlens_video.stages.l_aperture_samples import bare_points
from nlens_video.stages.p_projection import ground_visibility
from nlens_video.video.pixels.picture import ArrayPicture

SIZE = 120, 90
FRAME = Box(0, 0, *SIZE)


def edge_parallax(blurred, picture, defocused, fit, camera, ground_y):
    around = edge_surroundings(blurred.box, defocused, fit, camera, ground_y)
    return apply_edge_parallax(blurred, picture, around)


def stripes(columns, rows):
    """A plate in focus, at any place; its details are larger than a disc, which leaves them."""
    light = 0.4 + 0.25 * np.sin(0.25 * columns + 0.1 * rows) + 0.1 * np.sin(0.3 * rows)
    return np.stack([light, 0.8 * light, 0.5 + 0.3 * np.cos(0.2 * columns)], axis=2)


def side(columns, rows):
    """Coverage by an object with a slanted side, antialiased."""
    return np.clip(0.9 * (columns - 55.0) + 0.3 * (rows - 45.0) + 0.5, 0.0, 1.0)


def seen(object_coc, plate_coc, points=500):
    """Plate, layer and truth: the mean over points of the lens, each its own plate and object."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    plate, truth = np.zeros((*columns.shape, 3)), np.zeros((*columns.shape, 3))
    cover = np.zeros(columns.shape)
    for u, v in bare_points(points).places:
        there = stripes(columns - 0.5 * plate_coc * u, rows - 0.5 * plate_coc * v)
        hidden = side(columns - 0.5 * object_coc * u, rows - 0.5 * object_coc * v)
        plate += there / points
        cover += hidden / points
        truth += (1.0 - hidden[..., None]) * there / points
    rgba = np.zeros((*columns.shape, 4), np.float32)
    rgba[..., 3] = cover  # black, so that nothing but the plate counts
    return plate.astype(np.float32), rgba, truth


def even(value):
    return np.full((SIZE[1], SIZE[0]), value, np.float32)


def laid(rgba, plate):
    return rgba[..., :3] + (1.0 - rgba[..., 3:]) * plate


@pytest.mark.parametrize(
    ("object_coc", "plate_coc"), [(12.0, 6.0), (12.0, -6.0), (-8.0, -12.0), (16.0, 14.0)]
)
def test_plate_beside_an_edge_is_seen_by_the_unoccluded_part_of_the_lens(object_coc, plate_coc):
    plate, rgba, truth = seen(object_coc, plate_coc)
    wide = np.pad(plate, ((16, 16), (16, 16), (0, 0)), mode="edge")
    found = edge_parallax_layer(
        rgba, wide, even(object_coc), even(plate_coc), even(1.0), corner=(16, 16)
    )
    inner = np.s_[16:-16, 16:-16]
    before = np.sqrt(((laid(rgba, plate) - truth)[inner] ** 2).mean())
    after = np.sqrt(((laid(found, plate) - truth)[inner] ** 2).mean())
    assert after < 0.5 * before
    np.testing.assert_array_equal(found[..., 3], rgba[..., 3])


class LinearPlate:
    """A plate of float light."""

    width, height = SIZE

    def __init__(self, light):
        self.light = light

    def linear(self, box):
        return self.light[box.slices_in(FRAME)]


@pytest.mark.parametrize(("object_coc", "plate_coc"), [(12.0, 6.0), (12.0, -6.0), (-8.0, -12.0)])
def test_plate_past_an_edge_is_seen_by_the_objects_own_coc_and_the_grounds(object_coc, plate_coc):
    plate, rgba, truth = seen(object_coc, plate_coc)
    sharp = ObjectLayer(box=FRAME, rgba=rgba, depth=even(1.0))
    defocused = DefocusedLayer(layer=sharp, coc_px=even(object_coc))
    fit = replace(FIT, slope=0.0, intercept=plate_coc)  # ground of one CoC
    camera = looking_down(pitch=0.5 * math.pi)
    blurred = BlurredLayer(box=FRAME, rgba=rgba)
    found = edge_parallax(blurred, LinearPlate(plate), defocused, fit, camera, 0.0).rgba
    inner = np.s_[16:-16, 16:-16]
    before = np.sqrt(((laid(rgba, plate) - truth)[inner] ** 2).mean())
    after = np.sqrt(((laid(found, plate) - truth)[inner] ** 2).mean())
    assert after < 0.5 * before


@settings(max_examples=15)
@given(st.integers(0, 9999), st.floats(0.6, 1.6))
def test_edge_parallax_kernel_agrees_with_the_reference(seed, aspect):
    rng = np.random.default_rng(seed)
    rgba = rng.random((17, 23, 4), dtype=np.float32)
    rgba[..., 3] = np.clip(1.4 * rgba[..., 3] - 0.2, 0.0, 1.0)
    plate = rng.random((17 + 10, 23 + 10, 3), dtype=np.float32)
    cocs = rng.uniform(-14.0, 14.0, (2, 17, 23)).astype(np.float32)
    trust = np.clip(rng.uniform(-0.3, 1.0, (17, 23)), 0.0, 1.0).astype(np.float32)
    runs = [
        edge_parallax_layer(
            rgba, plate, *cocs, trust, corner=(5, 5), pixel_aspect=aspect, threads=n
        )
        for n in (1, 3)
    ]
    np.testing.assert_array_equal(*runs)
    expected = edge_parallax_by_pixels(rgba, plate, cocs, trust, 5, aspect)
    np.testing.assert_allclose(runs[0], expected, atol=2e-5)


FIT = LensFit(
    slope=30.0, intercept=-12.0, width=SIZE[0], height=SIZE[1],
    ground_seen=((0.05, 1.0), (0.9, 1.0)),
)  # fmt: skip


def looking_down(pitch=0.35):
    pose = np.eye(4)
    cos, sin = math.cos(pitch), math.sin(pitch)
    pose[:3, :3] = [[1, 0, 0], [0, cos, sin], [0, -sin, cos]]
    pose[:3, 3] = 0.0, 1.0, 0.0
    return Camera(
        world_from_camera=pose, fx=100.0, fy=100.0, cx=60.0, cy=45.0, width=SIZE[0], height=SIZE[1]
    )


def visible_ground(disparity, wall_beyond=0.0):
    """What a plate says of the ground; a wall of another blur hides what is farther off."""
    expected = np.abs(FIT.coc_px(disparity.astype(np.float32))).astype(np.float64)
    said = np.where(disparity > wall_beyond, expected, expected + 9.0)
    return ground_visibility(disparity, said, np.full_like(said, 1.0), expected)


def test_ground_is_visible_as_far_as_the_plate_has_its_coc():
    disparity = np.random.default_rng(2).uniform(0.05, 0.9, 4000)
    assert [share for _, share in visible_ground(disparity)] == [1.0] * 8
    fit = replace(FIT, ground_seen=visible_ground(disparity, wall_beyond=0.4))
    share = fit.ground_share(np.float32([0.0, 0.1, 0.2, 0.6, 0.8]))
    assert share.tolist() == [0.0, 0.0, 0.0, 1.0, 1.0]
    assert not replace(FIT, ground_seen=()).ground_share(np.float32([0.1, 0.5])).any()


def test_ground_at_one_distance_gives_a_single_visibility_sample():
    assert len(visible_ground(np.full(100, 0.5))) == 1


def test_ground_visibility_is_saved_with_the_fit():
    fit = replace(FIT, ground_seen=visible_ground(np.linspace(0.05, 0.9, 400), wall_beyond=0.3))
    again = LensFit.from_json(fit.to_json())
    assert again == fit
    assert fit.for_width(240, 180).ground_seen == fit.ground_seen


@pytest.mark.parametrize(
    "pairs", ["[[0.1]]", '"far"', "[[0.2, 1.0], [0.1, 1.0]]", "[[0.1, 1.5]]", "[[0.1, NaN]]", "{}"]
)
def test_saved_fit_with_invalid_ground_visibility_is_refused(pairs):
    text = f'{{"slope": 1, "intercept": 0, "width": 9, "height": 9, "ground_seen": {pairs}}}'
    with pytest.raises(LensFitError, match="ground_seen"):
        LensFit.from_json(text)


def layer(coc=10.0):
    rgba = np.zeros((SIZE[1], SIZE[0], 4), np.float32)
    rgba[50:80, 40:70] = (0.2, 0.1, 0.05, 1.0)
    sharp = ObjectLayer(box=FRAME, rgba=rgba, depth=even(1.0))
    defocused = DefocusedLayer(layer=sharp, coc_px=even(coc))
    return defocused, BlurredLayer(box=FRAME, rgba=scatter(rgba, even(coc)))


def test_edge_parallax_changes_only_half_covered_pixels_over_visible_ground():
    camera = looking_down()
    defocused, blurred = layer()
    rng = np.random.default_rng(1)
    picture = ArrayPicture(rng.integers(0, 255, (SIZE[1], SIZE[0], 3), dtype=np.uint8), "rgb")
    found = edge_parallax(blurred, picture, defocused, FIT, camera, 0.0)
    partly = (blurred.rgba[..., 3] > 0.0) & (blurred.rgba[..., 3] < 1.0)
    changed = (found.rgba != blurred.rgba).any(axis=2)
    assert changed.sum() > 0.5 * partly.sum() and not changed[~partly].any()
    for unknown in ((), ((0.05, 0.0), (0.9, 0.0))):
        fit = replace(FIT, ground_seen=unknown)
        assert edge_parallax(blurred, picture, defocused, fit, camera, 0.0) is blurred


def test_edge_parallax_changes_nothing_above_the_horizon():
    camera = looking_down(pitch=-1.0)
    assert camera.plane_disparity(0.0).max() < 0.0
    defocused, blurred = layer()
    picture = ArrayPicture(np.full((SIZE[1], SIZE[0], 3), 90, np.uint8), "rgb")
    assert edge_parallax(blurred, picture, defocused, FIT, camera, 0.0) is blurred


def test_frame_border_does_not_occlude_the_lens():
    camera = looking_down()
    defocused, blurred = layer()
    picture = ArrayPicture(np.full((SIZE[1], SIZE[0], 3), 90, np.uint8), "rgb")
    low = BlurredLayer(box=Box(30, 40, 80, 90), rgba=blurred.rgba[40:90, 30:80])
    found = edge_parallax(low, picture, defocused, FIT, camera, 0.0)
    np.testing.assert_allclose(found.rgba, low.rgba, atol=1e-6)  # an even plate stays even


def test_edge_parallax_does_not_flicker_while_the_object_slides():
    plate, _, _ = seen(12.0, 6.0, points=40)
    wide = np.pad(plate, ((16, 16), (16, 16), (0, 0)), mode="edge")
    columns, rows = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    frames = []
    for shift in np.arange(0.0, 1.2, 0.1):
        rgba = np.zeros((SIZE[1], SIZE[0], 4), np.float32)
        rgba[..., 3] = side(columns - shift, rows)
        blurred = scatter(rgba, even(12.0))
        found = edge_parallax_layer(
            blurred, wide, even(12.0), even(6.0), even(1.0), corner=(16, 16)
        )
        frames.append(laid(found, plate))
    bend = np.abs(np.diff(np.stack(frames), n=2, axis=0))[:, 16:-16, 16:-16]
    assert bend.max() < 0.02


def test_plate_goes_on_beyond_its_border_as_there():
    rng = np.random.default_rng(3)
    rgba = rng.random((20, 30, 4), np.float32)
    cocs = rng.uniform(-12.0, 12.0, (2, 20, 30)).astype(np.float32)
    trust, plate = np.ones((20, 30), np.float32), rng.random((23, 33, 3), np.float32)
    padded = np.pad(plate, ((16, 13), (14, 15), (0, 0)), mode="edge")
    found = edge_parallax_layer(rgba, plate, *cocs, trust, corner=(0, 2))
    expected = edge_parallax_layer(rgba, padded, *cocs, trust, corner=(16, 16))
    assert np.array_equal(found, expected)
    assert not np.array_equal(found, rgba)
