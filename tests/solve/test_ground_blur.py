"""What the CoC of a ground plane tells of the camera."""

import math

import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of

from nlens_video.core.layers import CocMap
from nlens_video.solve.still.ground_blur import fit_ground_blur
from nlens_video.solve.still.prior import CameraPrior

FOV_DEG, INFINITY_PX, FOCUS = 40.0, 24.0, -0.1


def ground(pitch_deg=-20.0, roll_deg=0.0, noise_px=0.5, infinity_px=INFINITY_PX, clutter=0.0):
    """CoC of a ground that fills the frame, in focus a tenth of the width below its middle."""
    rng = np.random.default_rng(4)
    width, height = SIZE
    x = (np.arange(width) + 0.5) / width - 0.5
    y = (0.5 * height - np.arange(height)[:, None] - 0.5) / width
    roll = math.radians(roll_deg)
    above = math.tan(math.radians(-pitch_deg)) * focal_of(FOV_DEG) / width / math.cos(roll)
    level = y + math.tan(roll) * x
    coc = abs(infinity_px * (level - FOCUS) / (above - FOCUS))
    things = rng.random((height // 32, width // 32)) < clutter
    coc = np.where(np.kron(things, np.ones((32, 32))) > 0, 6.0, coc)
    coc = abs(coc + rng.normal(0.0, noise_px, coc.shape))
    return CocMap(coc_px=coc.astype(np.float32), sigma_px=np.full(coc.shape, 0.8, np.float32))


@pytest.mark.parametrize("roll_deg", [-4.0, 0.0, 3.0])
def test_roll_is_that_of_the_level_lines(roll_deg):
    found = fit_ground_blur(ground(roll_deg=roll_deg))
    assert math.degrees(found.roll) == pytest.approx(roll_deg, abs=0.3)
    assert found.roll_error < math.radians(2.0)


def test_line_in_focus_and_slope_are_found_among_things():
    found = fit_ground_blur(ground(clutter=0.25))
    above = math.tan(math.radians(20.0)) * focal_of(FOV_DEG) / SIZE[0]
    assert found.focus == pytest.approx(FOCUS, abs=0.01)
    assert found.slope == pytest.approx(INFINITY_PX / SIZE[0] / (above - FOCUS), rel=0.05)


def test_horizon_is_likely_where_the_coc_is_that_of_lenses_at_infinity():
    found = fit_ground_blur(ground(infinity_px=22.0))
    pitches = np.arange(-60.0, -4.0, 2.0)
    focal = math.log(focal_of(FOV_DEG) / SIZE[0])
    cameras = [(math.radians(pitch), 0.0, focal) for pitch in pitches]
    best = pitches[np.argmax(found.log(np.array(cameras)))]
    assert best == pytest.approx(-20.0, abs=3.0)


def test_blur_that_does_not_slope_tells_nothing():
    flat = CocMap(
        coc_px=np.full((512, 960), 3.0, np.float32), sigma_px=np.full((512, 960), 0.8, np.float32)
    )
    assert fit_ground_blur(flat) is None


def test_map_without_a_sure_place_tells_nothing():
    unsure = ground()
    assert fit_ground_blur(CocMap(coc_px=unsure.coc_px, sigma_px=unsure.sigma_px + 60.0)) is None


def test_blur_moves_the_prior_towards_its_roll():
    cameras = np.array([(-0.3, math.radians(roll), 0.2) for roll in (0.0, 2.0)])
    level, turned = CameraPrior().log(cameras)
    blur = fit_ground_blur(ground(roll_deg=2.0))
    level_with, turned_with = CameraPrior(blur=blur).log(cameras)
    assert turned_with - level_with > turned - level + 1.0
