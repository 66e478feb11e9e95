import cv2
import numpy as np
import pytest

from nlens_video.core.layers import Box, DefocusedLayer, ObjectLayer
from nlens_video.evaluate.bench.methods import layered_gaussian, naive, one_gaussian

FRAME = Box(0, 0, 90, 70)
PLACE = Box(30, 20, 60, 50)


def square(coc_px, alpha=1.0):
    """A textured square and its CoC (30, 30) or one number."""
    rng = np.random.default_rng(3)
    rgba = rng.random((30, 30, 4), np.float32) * np.float32(alpha)
    rgba[..., 3] = alpha
    coc = np.broadcast_to(np.float32(coc_px), (30, 30)).copy()
    layer = ObjectLayer(box=PLACE, rgba=rgba, depth=np.ones((30, 30), np.float32))
    return DefocusedLayer(layer=layer, coc_px=coc)


def whole(blurred):
    out = np.zeros((FRAME.height, FRAME.width, 4), np.float32)
    out[blurred.box.slices_in(FRAME)] = blurred.rgba
    return out


def sharp(defocused):
    return whole(naive(defocused, FRAME))


def test_unblurred_baseline_returns_the_layer():
    defocused = square(20.0)
    assert np.array_equal(sharp(defocused)[20:50, 30:60], defocused.layer.rgba)
    assert sharp(defocused).sum() == pytest.approx(defocused.layer.rgba.sum())


@pytest.mark.parametrize("rival", [one_gaussian, layered_gaussian])
@pytest.mark.parametrize("coc", [8.0, -8.0])
def test_constant_coc_gives_a_gaussian_with_sigma_of_a_quarter(rival, coc):
    defocused = square(coc)
    expected = cv2.GaussianBlur(sharp(defocused), (13, 13), 2.0)
    np.testing.assert_allclose(whole(rival(defocused, FRAME)), expected, atol=1e-5)


def test_single_gaussian_baseline_uses_the_mean_coc_of_covered_pixels():
    coc = np.full((30, 30), 4.0, np.float32)
    coc[:15] = 12.0
    expected = cv2.GaussianBlur(sharp(square(0.0)), (13, 13), 2.0)
    np.testing.assert_allclose(whole(one_gaussian(square(coc), FRAME)), expected, atol=1e-5)


def test_layered_gaussian_baseline_follows_the_coc_of_each_pixel():
    coc = np.zeros((30, 30), np.float32)
    coc[:, 15:] = 12.0
    found = whole(layered_gaussian(square(coc), FRAME))
    np.testing.assert_allclose(found[30:40, 35:45], sharp(square(coc))[30:40, 35:45], atol=1e-5)
    blurred = cv2.GaussianBlur(sharp(square(0.0)), (19, 19), 3.0)
    np.testing.assert_allclose(found[30:40, 47:58], blurred[30:40, 47:58], atol=1e-5)


def test_layered_gaussian_baseline_interpolates_between_levels():
    found = whole(layered_gaussian(square(6.0), FRAME))[..., 3]
    narrow, wide = (whole(layered_gaussian(square(c), FRAME))[..., 3] for c in (4.0, 8.0))
    np.testing.assert_allclose(found, 0.5 * (narrow + wide), atol=1e-5)


@pytest.mark.parametrize("rival", [naive, one_gaussian, layered_gaussian])
def test_baseline_blur_is_cropped_to_the_frame(rival):
    cut = rival(square(8.0), Box(0, 0, 45, 35))
    assert (cut.box.x1, cut.box.y1) == (45, 35)
    far = rival(square(8.0), Box(200, 200, 210, 210))
    assert far.box.empty and far.rgba.shape == (0, 0, 4)


@pytest.mark.parametrize("rival", [one_gaussian, layered_gaussian])
def test_baseline_of_an_empty_layer_is_empty(rival):
    assert not whole(rival(square(8.0, alpha=0.0), FRAME)).any()
