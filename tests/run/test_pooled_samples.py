"""The lens under a moving camera is fitted on several frames, of which each sees other ground."""

import numpy as np
import pytest
from msgspec.structs import replace
from support import shots
from support.planes import HEIGHT, WIDTH, ground, of_map

from nlens_video.cameras.files import read_camera
from nlens_video.cli.main import main
from nlens_video.core.layers import CocMap
from nlens_video.core.lens_fit import LensFit
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import FitLens

SLOPE, FOCUS = 40.0, 0.5


def seen(low, high, seed, scale=1.0):
    """CoC and ground of a frame that sees disparities from low to high, read with an error."""
    plane = ground(near=1.0, far=low)
    plane = GroundProjection(
        mask=plane.mask, disparity_of=of_map(np.clip(plane.disparity, low, high)), ground_y=0.0
    )
    coc = scale * np.abs(SLOPE * (plane.disparity - FOCUS))
    coc = coc + np.random.default_rng(seed).normal(0.0, 0.5, (HEIGHT, WIDTH))
    sigma = np.full((HEIGHT, WIDTH), 1.0, np.float32)
    return CocMap(coc_px=np.abs(coc).astype(np.float32), sigma_px=sigma), plane


def test_frames_that_see_other_ground_tell_the_lens_that_one_does_not():
    stage = FitLens()
    first, other = seen(0.85, 0.95, 0), seen(0.55, 0.65, 1)
    alone = stage(*first).fit
    pooled = stage(*first, others=[stage.samples(*other)]).fit
    assert pooled.slope == pytest.approx(SLOPE, rel=0.05)
    assert pooled.slope_stderr < 0.5 * alone.slope_stderr
    assert "2 frames of a moving camera" in pooled.method


def test_frame_that_is_misread_does_not_count_among_others():
    stage = FitLens()
    others = [stage.samples(*seen(0.2, 0.95, seed)) for seed in range(1, 5)]
    fit = stage(*seen(0.2, 0.95, 0, scale=0.1), others=others).fit
    there = np.linspace(0.3, 0.9, 4)
    assert np.abs(fit.coc_px(there) - SLOPE * (there - FOCUS)).max() < 1.0


def fitted(folder, path, zoom=1.0):
    """The fit of a clip whose camera.json says how the camera moves; it stays where it is."""
    file = shots.camera_json(folder / "camera.json")
    still = read_camera(file, (shots.WIDTH, shots.HEIGHT), 25)
    fov = still.keys[0].fov_x_deg
    keys = [
        replace(still.keys[0], index=at, pts_s=at / 25, fov_x_deg=fov * zoom ** (at / 11))
        for at in range(12)
    ]
    file.write_text(replace(still, keys=tuple(keys), path=path).to_json())
    kept = folder / "fit.json"
    words = ["fit", folder / "in.mp4", folder / "anim.glb", kept, "--camera-from", file]
    assert main(list(map(str, words))) == 0
    return LensFit.load(kept)


@pytest.mark.slow
def test_fit_of_a_moving_camera_takes_five_frames_and_that_of_others_one(tmp_path):
    shots.write_shot(tmp_path, still=False, fit=False)
    moving, still = fitted(tmp_path, "moving"), fitted(tmp_path, "still")
    assert "5 frames of a moving camera" in moving.method
    assert "moving" not in still.method
    assert moving.n == 5 * still.n
    there = np.linspace(0.3, 0.8, 4)
    truth = shots.SLOPE * there + shots.INTERCEPT
    assert np.abs(moving.coc_px(there) - truth).max() < 1.0
    assert "moving" not in fitted(tmp_path, "moving", zoom=1.1).method
