"""Lines of what moves by itself before a camera that turns are left out."""

import math

import cv2
import numpy as np
import pytest
from support.camera_paths import rotation

from nlens_video.solve import shot
from nlens_video.solve.paths.moving_areas import beside_areas, moving_areas
from nlens_video.solve.still.segments import find_segments
from nlens_video.solve.still.vanishing import Mixture

SIZE = (320, 180)
FOCAL = 400.0
PLATE_FOCAL, PLATE_SIZE = 800.0, (1400, 900)


def lens(focal, size):
    return np.array([[focal, 0, -size[0] / 2], [0, -focal, -size[1] / 2], [0, 0, -1.0]])


def room():
    """A wide picture of a textured room with a pillar that stands."""
    rng = np.random.default_rng(6)
    wide = cv2.GaussianBlur(rng.uniform(0, 255, PLATE_SIZE[::-1]).astype(np.float32), (0, 0), 5.0)
    wide = cv2.normalize(wide, None, 60.0, 150.0, cv2.NORM_MINMAX)
    wide[250:650, 860:920] = 225.0
    return wide


def turned_clip(frames=6, walks=True, light=0.0):
    """Pictures of a camera that turns while a dark post walks past, and the turns."""
    wide, pictures, turns = room(), {}, {}
    for n in range(frames):
        turn = rotation(math.radians(0.6 * math.sin(n)), math.radians(0.5 * math.cos(2 * n)), 0.0)
        matrix = lens(FOCAL, SIZE) @ turn.T @ np.linalg.inv(lens(PLATE_FOCAL, PLATE_SIZE))
        picture = cv2.warpPerspective(wide, matrix, SIZE, flags=cv2.INTER_AREA)
        if walks:
            left = 10 + 34 * n * 6 // frames
            picture[30:160, left : left + 18] = 15.0
        pictures[n], turns[n] = np.uint8(picture * (1.0 + light * n)), turn
    return pictures, turns


def upright(segments):
    """Columns of long upright segments."""
    ways = abs(segments.ends[:, 1] - segments.ends[:, 0])
    return segments.ends[(ways[:, 1] > 40) & (ways[:, 0] < 8)].mean(axis=1)[:, 0]


@pytest.mark.parametrize("light", [0.0, 0.015])
def test_lines_of_a_post_that_walks_are_left_out_and_those_of_a_pillar_stay(light):
    pictures, turns = turned_clip(light=light)
    areas = moving_areas(pictures, turns, dict.fromkeys(pictures, FOCAL))
    for n, picture in pictures.items():
        left = 10 + 34 * n
        found = find_segments(picture)
        kept = beside_areas(found, areas[n])
        before, after = (abs(upright(one) - left - 9) for one in (found, kept))
        assert (before < 14).sum() >= 2
        assert (after < 14).sum() == 0
        assert areas[n].mean() < 0.15
        if abs(left - 200) > 60:
            assert (before > 14).sum() == (after > 14).sum() > 0


def test_nothing_moves_where_the_camera_alone_turns():
    pictures, turns = turned_clip(walks=False)
    for areas in moving_areas(pictures, turns, dict.fromkeys(pictures, FOCAL)).values():
        assert not areas.any()


def test_nothing_is_left_out_where_two_pictures_show_a_place():
    pictures, turns = turned_clip(frames=2)
    for areas in moving_areas(pictures, turns, dict.fromkeys(pictures, FOCAL)).values():
        assert not areas.any()


def test_lines_of_who_walks_do_not_tell_the_attitude_of_a_camera_that_turns(monkeypatch):
    taken = []

    def mixture(segments, *rest):
        taken.append(segments)
        return Mixture(segments, *rest)

    monkeypatch.setattr(shot, "Mixture", mixture)
    solver = shot.ShotSolver(size=SIZE)
    pictures, _ = turned_clip(frames=24)
    for n, picture in pictures.items():
        solver.add(picture, n / 24)
    assert solver.solve().path == "rotation"
    columns = upright(taken[-1])
    assert len(columns) >= 2
    assert ((columns > 225) & (columns < 285)).all()  # the pillar
