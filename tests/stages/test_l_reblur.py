import numpy as np
import pytest

from nlens_video.core.layers import Box, DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.stages.l_reblur import ReblurLayer, crop_to_frame, object_coc

FRAME = Box(0, 0, 96, 64)


INSIDE = Box(20, 16, 60, 48)


def layer(box=INSIDE, depth=2.0):
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    rgba[4:-4, 4:-4] = (0.4, 0.2, 0.1, 1.0)
    z = np.where(rgba[..., 3] > 0, np.float32(depth), np.float32(np.inf))
    return ObjectLayer(box=box, rgba=rgba, depth=z)


def lens(coc_px, depth=2.0):
    """A lens that gives `coc_px` at `depth` and 0 at infinity."""
    return LensFit(slope=coc_px * depth, intercept=0.0, width=96, height=64)


def reblur():
    return ReblurLayer(scatter=scatter, reach=blur_reach)


def test_object_coc_is_the_fit_at_each_pixels_disparity():
    fit = LensFit(slope=30.0, intercept=-10.0, width=96, height=64)
    got = object_coc(layer(depth=1.5), fit)
    assert got.coc_px[10, 10] == pytest.approx(30 / 1.5 - 10)
    assert got.coc_px[0, 0] == 0.0


def test_edge_pixels_without_depth_take_the_coc_of_neighbours():
    sharp = layer()
    sharp.rgba[3, 4:-4] = (0.1, 0.05, 0.02, 0.25)
    got = object_coc(sharp, lens(6.0))
    assert got.coc_px[3, 10] == pytest.approx(6.0)


def test_object_in_focus_is_returned_bit_for_bit():
    sharp = layer()
    blurred = reblur()(object_coc(sharp, lens(0.2)), FRAME)
    assert blurred.box == sharp.box
    assert np.array_equal(blurred.rgba, sharp.rgba)


def test_blurred_object_extends_past_its_silhouette_and_keeps_energy():
    sharp = layer()
    blurred = reblur()(object_coc(sharp, lens(9.0)), FRAME)
    assert blurred.box.width > sharp.box.width
    assert blurred.rgba.sum(axis=(0, 1)) == pytest.approx(sharp.rgba.sum(axis=(0, 1)), rel=2e-3)
    assert 0 <= blurred.rgba[..., 3].min() and blurred.rgba[..., 3].max() <= 1


def test_reblurred_layer_is_cropped_to_the_frame():
    sharp = layer(box=Box(-30, 40, 10, 72))
    blurred = reblur()(object_coc(sharp, lens(12.0)), FRAME)
    assert blurred.box.intersection(FRAME) == blurred.box
    assert blurred.rgba[..., 3].max() > 0.9


def test_blur_of_an_object_beside_the_frame_reaches_into_it():
    sharp = layer(box=Box(94, 16, 134, 48))  # its first covered column is 98: two px outside
    blurred = reblur()(object_coc(sharp, lens(16.0)), FRAME)
    assert blurred.rgba[..., 3].max() > 0.1


def test_object_out_of_reach_gives_an_empty_layer():
    assert crop_to_frame(layer(box=Box(200, 0, 240, 32)), FRAME).box.empty


def test_object_without_depth_is_at_infinity():
    sharp = layer(depth=np.inf)
    got = object_coc(sharp, LensFit(slope=5.0, intercept=-4.0, width=96, height=64))
    assert isinstance(got, DefocusedLayer)
    assert got.coc_px[10, 10] == pytest.approx(-4.0)
