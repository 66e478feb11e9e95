"""The limit of what is rendered beyond the frame, against the reach of the scatter itself."""

import numpy as np
import pytest

from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.kernels.scatter.scatter import blur_reach


@pytest.mark.parametrize("pixel_aspect", [0.5, 1.0, 64 / 45, 2.0])
@pytest.mark.parametrize("coc_px", [512.0, 1000.0])
def test_no_disc_reaches_farther_than_the_furthest(pixel_aspect, coc_px):
    disc, alpha = np.full((1, 1), coc_px, np.float32), np.ones((1, 1), np.float32)
    assert blur_reach(disc, alpha, pixel_aspect) == furthest_reach(pixel_aspect)
