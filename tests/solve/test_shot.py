"""Shots from pictures: cuts are found, long ones are solved in parts."""

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from support import grounds
from support.camera_paths import rotation

from nlens_video.core.errors import InputError
from nlens_video.solve.paths.joining import Joined, parts_of
from nlens_video.solve.paths.moving import Part
from nlens_video.solve.shot import ShotSolver

SIZE = (320, 180)


def texture(seed, light=0.0):
    rng = np.random.default_rng(seed)
    wide = cv2.GaussianBlur(rng.uniform(0, 255, (400, 700)).astype(np.float32), (0, 0), 2.0)
    return cv2.normalize(wide, None, 40.0 + light, 160.0 + light, cv2.NORM_MINMAX)


def panned(wide, frames):
    for n in range(frames):
        yield wide[50 : 50 + SIZE[1], 20 + 2 * n : 20 + 2 * n + SIZE[0]].astype(np.uint8)


def solver_of(pictures, **options):
    solver = ShotSolver(size=SIZE, **options)
    for n, picture in enumerate(pictures):
        solver.add(np.ascontiguousarray(picture), n / 24)
    return solver


def test_cut_is_named_by_its_frame_in_the_plate():
    pictures = [*panned(texture(1), 9), *panned(texture(2, 60.0), 9)]
    with pytest.raises(InputError, match=r"frame 109: another shot .* 100:109 or --range 109:"):
        solver_of(pictures, first=100).solve()


@pytest.mark.slow
def test_lamp_that_is_switched_on_is_no_cut():
    wide = texture(1)
    pictures = [picture + np.uint8(40 * (n > 5)) for n, picture in enumerate(panned(wide, 12))]
    assert solver_of(pictures).solve().path == "rotation"


@pytest.mark.parametrize("frames", [3, 30, 200, 5000])
def test_parts_cover_the_shot_and_overlap(frames):
    parts = parts_of([0.0] + [4.0] * (frames - 1), 960)
    assert parts[0][0] == 0 and parts[-1][-1] == frames - 1
    for one, other in zip(parts, parts[1:], strict=False):
        assert one[-1] > other[0]
    assert max(len(part) for part in parts) < 18


def test_short_shot_is_one_part():
    assert parts_of([0.0] + [4.0] * 47, 960) == [list(range(0, 48, 4)) + [47]]


def test_next_part_of_a_turn_that_zooms_takes_over_its_focal_length():
    part = Part(
        kind="rotation", frames=[4, 5, 6], poses=np.tile(np.eye(4), (3, 1, 1)),
        focals_px=np.array([900.0, 950.0, 1000.0]), focal_error=0.01, focal_noise=0.01,
        names=np.arange(1), points=np.array([[0.0, 0.0, -1.0]]), residual_px=0.1, zooms=True,
        turn=0.1,
    )  # fmt: skip
    assert Joined.begun(part).zoomed_focal_px(5) == 950.0
    assert Joined.begun(replace(part, zooms=False)).zoomed_focal_px(5) is None


@pytest.mark.slow
def test_parts_of_a_walk_over_even_ground_share_a_focal_length_however_unsure_it_is():
    poses = [
        (rotation(np.radians(4 - 0.7 * n), np.radians(-20), 0.01), (0.06 * n, 1.5, -0.05 * n))
        for n in range(26)
    ]
    solver = ShotSolver(size=grounds.SIZE, lines=False, every=1)
    for n, picture in enumerate(grounds.pictures(poses)):
        solver.add(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), n / 24)
    solved = solver.solve()
    assert len(parts_of([0.0] + [20.0] * 25, grounds.SIZE[0], 1)) > 1
    assert solved.errors.fov_deg > 0.5
    fovs = [key.fov_x_deg for key in solved.keys]
    assert len(fovs) == 26 and fovs == pytest.approx([fovs[0]] * 26, abs=1e-6)
    assert abs(fovs[0] - grounds.FOV_DEG) < 2.0 * solved.errors.fov_deg


def test_lines_of_what_moves_before_a_still_camera_are_left_out():
    wide = texture(3)[: SIZE[1], : SIZE[0]].astype(np.uint8)
    wide[:, 250:] = 230  # stands
    pictures = []
    for n in range(6):
        picture = wide.copy()
        picture[40:140, 20 + 30 * n : 40 + 30 * n] = 255  # walks
        pictures.append(picture)
    solver = solver_of(pictures)
    assert solver.solve().path == "still"
    upright = [ends for ends in solver.segments.ends if abs(np.diff(ends, axis=0)[0, 1]) > 60]
    assert upright
    assert all(abs(ends[:, 0].mean() - 250) < 3.0 for ends in upright)
