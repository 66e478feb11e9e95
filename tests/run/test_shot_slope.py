"""Frames that do not tell the slope of their lens take that of the frames before them."""

import numpy as np
import pytest
from msgspec.structs import replace
from support.planes import of_map

from nlens_video.core.layers import CocMap
from nlens_video.graph.base.values import FoundLens
from nlens_video.run.shot_slope import ShotSlope
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import FitLens

SLOPE = 40.0
EXPECTED_PX = 2.5  # error of readings that do not change with depth


def found(intercept, *, alike=0.0, seed=0):
    """The fit of a ground under a lens; `alike` hides how its blur changes with depth."""
    disparity = np.repeat(np.linspace(0.2, 0.7, 90)[:, None], 120, axis=1)
    mask = np.zeros(disparity.shape, bool)
    mask[40:60, 40:80] = True
    ground = GroundProjection(mask=mask, disparity_of=of_map(disparity), ground_y=0.0)
    true = np.abs(SLOPE * disparity + intercept)
    read = (1 - alike) * true + alike * np.median(true)
    noise = 0.1 * np.random.default_rng(seed).standard_normal(read.shape)
    sigma = np.full(read.shape, 0.5 if not alike else EXPECTED_PX, np.float32)
    coc = CocMap(coc_px=np.float32(np.maximum(read + noise, 0)), sigma_px=sigma)
    regression = FitLens()(coc, ground)
    return FoundLens(fit=replace(regression.fit, object_disparity=0.45), regression=regression)


def test_frame_that_tells_its_slope_keeps_its_own():
    clear = found(-18.0)
    assert clear.fit.sign == "resolved"
    assert ShotSlope().lend(clear) is clear.fit


@pytest.mark.parametrize("intercept", [-8.0, -30.0], ids=["behind", "before"])
def test_frame_that_reads_alike_at_all_depths_takes_slope_and_side_of_the_frames_before(intercept):
    slope = ShotSlope()
    slope.lend(found(-18.0))
    slope.lend(found(0.75 * intercept - 4.5, seed=2))  # on the way
    flat = found(intercept, alike=0.75, seed=1)
    assert not flat.fit.depends_on_depth or flat.fit.sign != "resolved"
    lent = slope.lend(flat)
    assert lent.slope == pytest.approx(SLOPE, rel=0.1)
    assert lent.slope * 0.45 + lent.intercept == pytest.approx(
        SLOPE * 0.45 + intercept, abs=EXPECTED_PX
    )
    assert lent.object_disparity == 0.45
    assert float(lent.coc_stderr_px(0.45)) > 0.0


def test_first_frame_that_tells_nothing_is_left_as_it_is():
    flat = found(-30.0, alike=0.75)
    assert ShotSlope().lend(flat) is flat.fit
