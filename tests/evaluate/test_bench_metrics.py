import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from nlens_video.evaluate.metrics import psnr, ssim


def pair(seed, shape=(23, 17, 3), off=40):
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 256, shape)
    return np.clip(truth + rng.integers(-off, off + 1, shape), 0, 255).astype(
        np.uint8
    ), truth.astype(np.uint8)


def test_psnr_of_two_pixels_agrees_with_a_hand_calculation():
    seen, truth = np.array([[[10, 0, 0], [0, 0, 5]]], np.uint8), np.zeros((1, 2, 3), np.uint8)
    assert psnr(seen, truth) == pytest.approx(10 * math.log10(255**2 / (125 / 6)))
    assert psnr(truth, seen) == psnr(seen, truth)  # no wrap of 8 bits


def test_psnr_of_equal_pictures_is_infinite():
    picture = pair(0)[0]
    assert psnr(picture, picture) == math.inf
    assert ssim(picture, picture) == pytest.approx(1.0)


def test_ssim_of_flat_pictures_agrees_with_a_hand_calculation():
    dark, bright = np.full((7, 7, 3), 100, np.uint8), np.full((7, 7, 3), 120, np.uint8)
    c1 = (0.01 * 255) ** 2  # no variance: only the means differ
    assert ssim(dark, bright) == pytest.approx((2 * 100 * 120 + c1) / (100**2 + 120**2 + c1))


@given(st.integers(0, 10_000), st.integers(0, 120))
def test_psnr_and_ssim_agree_with_scikit_image(seed, off):
    seen, truth = pair(seed, off=off)
    ours = ssim(seen, truth)
    assert ours == pytest.approx(
        structural_similarity(truth, seen, channel_axis=2, data_range=255), abs=1e-9
    )
    if (seen != truth).any():
        assert psnr(seen, truth) == pytest.approx(
            peak_signal_noise_ratio(truth, seen, data_range=255)
        )


def test_ssim_of_a_picture_smaller_than_the_window_is_refused():
    small = np.zeros((6, 40, 3), np.uint8)
    with pytest.raises(ValueError, match="7 each way"):
        ssim(small, small)
