"""A plate that tells its lens, and a `--lens` with which no fit of it stands."""

import numpy as np
import pytest
from support.planes import HEIGHT, WIDTH, ground

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import NO_PRIOR, Expected, LensPrior
from nlens_video.core.layers import CocMap
from nlens_video.graph.nodes.known_lens_fit import fit_with_known
from nlens_video.stages.r_regression import FitLens

SLOPE, FOCUS = 40.0, 0.5
SIZE = WIDTH, HEIGHT
WRONG_SLOPE, WRONG_FOCUS = Expected(5.0, 0.15), Expected(0.1, 0.005)


def found(given, completed):
    plane = ground()
    coc = np.abs(SLOPE * (plane.disparity - FOCUS)).astype(np.float32)
    read = CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.2))
    return fit_with_known(
        lambda known: FitLens()(read, plane, known=known), given, completed, SIZE, 0
    )


def test_whole_lens_of_the_user_is_kept_with_a_note():
    wrong = LensPrior(slope=WRONG_SLOPE, focus=WRONG_FOCUS)
    lens = found(wrong, wrong)
    assert (lens.regression, lens.fit.slope) == (None, 5.0)
    assert "tells nothing" not in lens.fit.method
    assert "standard errors from what the plate tells without it (slope 40" in lens.warning


def test_lens_that_is_known_in_part_is_an_error_that_names_the_option():
    wrong = LensPrior(focus=Expected(1e-3, 1e-5))
    with pytest.raises(LensFitError, match=r"--lens does not .* slope 40.* or leave it out"):
        found(wrong, wrong)


def test_lens_of_the_metadata_is_left_out_with_a_note():
    lens = found(NO_PRIOR, LensPrior(slope=WRONG_SLOPE, focus=WRONG_FOCUS))
    assert lens.fit.slope == pytest.approx(SLOPE, rel=0.02)
    assert "metadata's lens does not go with the plate" in lens.warning
