"""Spectra of patches of the ground."""

import cv2
import numpy as np
import pytest
from support.textured_ground import camera

from nlens_video.stages.texture.spectra import SIDE_PX, fall_of_the_finest, ground_spectra


def noise(shape=(400, 640), deviation=0.02):
    return np.float32(0.5 + deviation * np.random.default_rng(0).standard_normal(shape))


def test_power_of_white_noise_is_its_variance_at_all_frequencies():
    bins, patches = ground_spectra(noise(), camera(), 0.0)
    power = np.exp(patches.log_power).mean(axis=0)
    assert power == pytest.approx((255 * 0.02) ** 2, rel=0.1)
    assert bins.magnitude.min() > 1.0 / SIDE_PX and bins.magnitude.max() < 0.5


def test_statistics_of_the_logarithm_are_those_of_noise():
    bins, patches = ground_spectra(noise(), camera(), 0.0)
    many = bins.cells >= 4
    bias = np.log((255 * 0.02) ** 2) - patches.log_power.mean(axis=0)
    # the window makes neighbouring cells alike: by up to its width there are fewer than counted
    assert (bias[many] > 0.5 * bins.log_bias[many]).all()
    assert (bias[many] < 5.0 * bins.log_bias[many]).all()
    variance = patches.log_power.var(axis=0)[many]
    assert (variance > 0.5 * bins.log_variance[many]).all()
    assert (variance < 5.0 * bins.log_variance[many]).all()


def test_finest_detail_falls_off_where_noise_is_smoothed():
    bins, white = ground_spectra(noise(), camera(), 0.0)
    _, smoothed = ground_spectra(cv2.GaussianBlur(noise(), (0, 0), 0.6), camera(), 0.0)
    assert abs(fall_of_the_finest(bins, white.log_power)) < 0.1
    assert fall_of_the_finest(bins, smoothed.log_power) < -0.5


def test_wave_is_found_at_its_frequency_and_direction():
    rows, columns = np.mgrid[0:400, 0:640]
    along, down = 0.11, 0.06
    wave = np.float32(0.5 + 0.1 * np.sin(2 * np.pi * (along * columns + down * rows)))
    bins, patches = ground_spectra(wave, camera(), 0.0)
    found = bins.vector[np.argmax(patches.log_power.mean(axis=0))]
    assert found == pytest.approx([along, down], abs=0.03)


def test_brightness_and_its_slope_are_no_texture():
    rows, columns = np.mgrid[0:400, 0:640]
    ramp = np.float32(0.2 + 0.0005 * columns + 0.0007 * rows)
    _, patches = ground_spectra(ramp, camera(), 0.0)
    assert np.exp(patches.log_power).max() < 1e-3


def test_patches_lie_below_the_horizon():
    level = camera(pitch_degrees=2.0)
    _, patches = ground_spectra(noise(), level, 0.0)
    assert 0 < len(patches.disparity) < 0.6 * (640 // 24) * (400 // 24)
    assert (patches.disparity > 0.0).all()


def test_stretch_is_the_change_of_the_pixel_by_that_of_the_place():
    seen_by = camera()
    _, patches = ground_spectra(noise(), seen_by, 0.0)
    middle = np.array([[SIDE_PX / 2, SIDE_PX / 2]])
    place, _ = seen_by.ground_seen_at(middle, 0.0)
    for axis, column in ((0, 0), (2, 1)):
        step = np.zeros(3)
        step[axis] = 1e-4
        before, after = (seen_by.pixels(seen_by.to_camera(place + s * step))[0] for s in (-1, 1))
        assert patches.stretch[0][:, column] == pytest.approx((after - before) / 2e-4, rel=1e-3)


@pytest.mark.parametrize("shape", [(1, 1), (SIDE_PX - 1, 640), (400, SIDE_PX - 1)])
def test_picture_smaller_than_a_patch_has_none(shape):
    seen_by = camera(width=shape[1], height=shape[0])
    bins, patches = ground_spectra(noise(shape), seen_by, 0.0)
    assert len(patches.disparity) == 0
    assert patches.log_power.shape == (0, len(bins.cells))
