"""Slopes of a registered picture, against those of NumPy."""

import numpy as np
import pytest

from nlens_video.check.motion import _gradients


@pytest.mark.parametrize("shape", [(2, 2), (5, 3), (40, 91)])
def test_slopes_to_the_right_and_down_are_those_of_numpy_bit_for_bit(shape):
    values = np.random.default_rng(0).uniform(0.0, 255.0, shape).astype(np.float32)
    across, below = _gradients(values)
    assert np.array_equal(across, np.gradient(values, axis=1))
    assert np.array_equal(below, np.gradient(values, axis=0))
