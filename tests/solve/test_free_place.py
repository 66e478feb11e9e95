"""The place that is chosen for an object: on the ground, in view, clear of what moves or stands."""

import functools

import numpy as np
import pytest
from support import marker_plates as plates

from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.solve.evidence import standing_points
from nlens_video.solve.free_place import free_place
from nlens_video.solve.still.segments import Segments

SIZE = np.array([960.0, 512.0])


def path(count, *, walk=0.0, turn_deg=0.0, pitch_deg=-15.0):
    keys = [
        CameraKey(
            index=n, pts_s=n / 24, fov_x_deg=60.0,
            world_to_camera=np.linalg.inv(
                plates.pose(pitch_deg, 0.0, 1.6, yaw_deg=turn_deg * n, x=walk * n)
            ),
        )
        for n in range(count)
    ]  # fmt: skip
    times = tuple(key.pts_s for key in keys)
    return SolvedCamera(width=960, height=512, keys=tuple(keys)), times


@functools.cache
def cameras_of(solved, times):
    return [solved.at(time_s) for time_s in times]


def track(solved, times, points):
    """The pixels of a point that is somewhere else on each frame, as far as they are in view."""
    seen = {}
    for frame, (camera, point) in enumerate(zip(cameras_of(solved, times), points, strict=True)):
        spot = camera.pixels(camera.to_camera(np.array([point])))[0]
        if (spot > 0).all() and (spot < SIZE).all():
            seen[frame] = spot.astype(np.float32)
    return seen


def ground_tracks(solved, times):
    return [
        track(solved, times, [(x, 0.0, z)] * len(times))
        for x in np.linspace(-2, 2, 15)
        for z in np.linspace(-8, -2.5, 15)
    ]


@pytest.mark.parametrize("moves", [{}, {"walk": 0.05}, {"turn_deg": 0.5}])
def test_empty_ground_is_used_in_the_middle(moves):
    solved, times = path(12, **moves)
    tracks = [one for one in ground_tracks(solved, times) if len(one) > 5]
    x, y = free_place(tracks, times, solved)
    assert x == 0.5
    assert 0.5 < y < 0.9


def test_what_walks_through_the_middle_is_left_its_way():
    solved, times = path(12)
    walkers = [
        track(solved, times, [(x + 0.03 * n, h, -3.6) for n in range(12)])
        for x in np.linspace(-0.5, 0.2, 12)
        for h in (0.05, 0.4, 0.8, 1.2, 1.6)
    ]
    x, _ = free_place(
        [one for one in [*ground_tracks(solved, times), *walkers] if one], times, solved
    )
    foot = solved.at(0.0).pixels(solved.at(0.0).to_camera(np.array([[-0.15, 0.0, -3.6]])))[0] / SIZE
    assert abs(x - foot[0]) > 0.12


def test_what_stands_in_the_middle_of_a_path_is_left_alone():
    solved, times = path(12, walk=0.05)
    post = [
        track(solved, times, [(x, h, -4.2)] * 12)
        for x in np.linspace(0.1, 0.4, 6)
        for h in np.linspace(0.15, 0.9, 8)
    ]
    tracks = [one for one in [*ground_tracks(solved, times), *post] if len(one) > 5]
    alone = free_place([one for one in ground_tracks(solved, times) if len(one) > 5], times, solved)
    assert free_place(tracks, times, solved) != alone


def test_place_stays_in_view_where_the_camera_turns_away():
    solved, times = path(24, turn_deg=-1.4)
    x, _ = free_place([], times, solved)
    assert x > 0.5


def test_camera_that_looks_up_shows_no_place():
    solved, times = path(1, pitch_deg=35.0)
    assert free_place([], times, solved) is None


def edges(camera, ends):
    """Segments of a picture between points of the world (N, 2, 3)."""
    return Segments(
        np.array([camera.pixels(camera.to_camera(np.array(pair))) for pair in ends]),
        np.full(len(ends), 0.3),
    )


def test_a_wall_before_a_still_camera_is_no_place():
    solved, times = path(1)
    camera = solved.at(0.0)
    frames = [
        [(x, low, -4.0), (x, low + 0.8, -4.0)]
        for x in (-0.9, -0.5, 0.0, 0.4, 0.8) for low in (0.0, 1.0)
    ]  # fmt: skip
    standing = standing_points(edges(camera, frames), camera)
    foot = camera.pixels(camera.to_camera(np.array([[0.0, 0.0, -4.0]])))[0] / SIZE
    alone = free_place([], times, solved)
    assert abs(alone[1] - foot[1]) < 0.1
    x, y = free_place([], times, solved, standing)
    assert y > foot[1] + 0.1 or abs(x - 0.5) > 0.15


def test_lanes_that_run_away_from_the_camera_are_ground():
    solved, _ = path(1)
    camera = solved.at(0.0)
    lanes = [[(x, 0.0, -2.5), (x, 0.0, -8.0)] for x in (-1.5, -0.7, 0.0, 0.8, 1.6)]
    assert len(standing_points(edges(camera, lanes), camera)) == 0
