import numpy as np
import pytest
from support.definitions import covariance_by_points

from nlens_video.kernels.aperture_covariance import aperture_covariance
from nlens_video.stages.l_aperture_samples import even_points

EVERYWHERE = np.ones((24, 32), np.bool_)


@pytest.mark.parametrize(("near_coc", "back_coc"), [(9.0, -4.0), (0.5, 14.0), (12.0, 12.0)])
@pytest.mark.parametrize("aspect", [1.0, 1.4])
def test_covariance_kernel_agrees_with_the_reference(near_coc, back_coc, aspect):
    rng = np.random.default_rng(3)
    cover = np.float32(rng.random((24, 32)) > 0.5)
    light = rng.random((24, 32, 4), dtype=np.float32)
    near = (cover, np.full((24, 32), near_coc, np.float32))
    back = (light, np.full((24, 32), back_coc, np.float32))
    points = even_points(7)
    found = aperture_covariance(near, back, EVERYWHERE, points, pixel_aspect=aspect)
    assert found == pytest.approx(covariance_by_points(near, back, points, aspect), abs=1e-5)


def test_covariance_is_zero_for_uniform_light_and_unrequested_pixels():
    rng = np.random.default_rng(3)
    near = (np.float32(rng.random((24, 32)) > 0.5), np.full((24, 32), 9.0, np.float32))
    even = (np.full((24, 32, 4), 0.7, np.float32), np.full((24, 32), 5.0, np.float32))
    assert np.abs(aperture_covariance(near, even, EVERYWHERE, even_points(12))).max() < 1e-6
    uneven = (rng.random((24, 32, 4), dtype=np.float32), even[1])
    some = EVERYWHERE.copy()
    some[:, 10:] = False
    found = aperture_covariance(near, uneven, some, even_points(12))
    assert found[:, :10].any() and not found[:, 10:].any()


def test_aperture_samples_are_centred_and_have_the_variance_of_a_disc():
    points = even_points(64)
    assert points.mean(axis=0) == pytest.approx([0, 0], abs=1e-6)
    assert np.hypot(*points.T).max() < 1.05
    assert (points**2).mean(axis=0) == pytest.approx([0.25, 0.25], abs=0.01)  # of an even disc


def test_covariance_is_bit_identical_on_any_number_of_threads():
    rng = np.random.default_rng(4)
    near = (np.float32(rng.random((24, 32)) > 0.5), np.full((24, 32), 9.0, np.float32))
    back = (rng.random((24, 32, 4), dtype=np.float32), np.full((24, 32), 4.0, np.float32))
    runs = [aperture_covariance(near, back, EVERYWHERE, even_points(12), threads=n) for n in (1, 3)]
    assert np.array_equal(*runs)
