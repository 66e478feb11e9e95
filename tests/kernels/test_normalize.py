"""Normalisation of the scatter's running sums."""

import numpy as np

from nlens_video.kernels.scatter.normalize import normalise


def test_rounding_residue_of_running_sums_is_not_normalised_into_light():
    # red, green, blue, alpha, weight as they were left beyond a disc's last row
    sums = np.array([[[-5e-8, 3e-8, 1e-8, 1.1e-7, 1.4e-7], [0.2, 0.1, 0.1, 0.4, 0.8]]], np.float32)
    out = np.full((1, 2, 4), 7.0, np.float32)
    normalise(sums, (np.array([-1.0]), np.array([9.0])), (0, 0), out, (0, 1))
    assert (out[0, 0] == 0).all()
    np.testing.assert_allclose(out[0, 1], [0.25, 0.125, 0.125, 0.5], rtol=1e-6)


def test_faint_alpha_of_the_object_is_kept():
    sums = np.array([[[2e-6, 2e-6, 2e-6, 4e-6, 0.9]]], np.float32)
    out = np.zeros((1, 1, 4), np.float32)
    normalise(sums, (np.array([-1.0]), np.array([9.0])), (0, 0), out, (0, 1))
    assert out[0, 0, 3] > 0
