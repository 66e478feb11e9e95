"""Rotation and field of view from tracks of a camera that turns on the spot."""

import math

import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of, project, rotation

from nlens_video.solve.rotation import resect_rotations, solve_rotation

FRAMES = list(range(12))


def pan(fov_deg, noise_px=0.1, moving=0, parallax=0.0):
    """Tracks of a pan over 12 degrees, and the camera axes of each frame."""
    rng = np.random.default_rng(3)
    points = np.column_stack(
        [rng.uniform(-6, 6, 400), rng.uniform(-3, 3, 400), rng.uniform(-9, -5, 400)]
    )
    tracks = [{} for _ in points]
    turns = []
    for frame in FRAMES:
        turn = rotation(math.radians(6.0 - frame), math.radians(-10.0 + 0.2 * frame), 0.0)
        turns.append(turn)
        shifted = points.copy()
        shifted[:moving, 0] += 0.05 * frame
        pixels, seen = project(shifted, turn, np.array([parallax * frame, 0.0, 0.0]), fov_deg)
        for number in np.flatnonzero(seen):
            tracks[number][frame] = pixels[number] + rng.normal(0.0, noise_px, 2)
    return tracks, np.array(turns)


@pytest.mark.slow
@pytest.mark.parametrize("fov_deg", [25.0, 40.0, 65.0])
def test_field_of_view_and_rotations_of_a_pan_are_found(fov_deg):
    tracks, turns = pan(fov_deg)
    found = solve_rotation(tracks, FRAMES, SIZE)
    assert found.focal_px == pytest.approx(focal_of(fov_deg), rel=0.01)
    assert abs(found.focal_px - focal_of(fov_deg)) < 4.0 * found.focal_stderr_px
    expected = turns[0].T @ turns
    assert abs(found.rotations - expected).max() < 2e-3
    assert found.residual_px < 0.3


def test_things_that_move_are_left_out():
    tracks, turns = pan(40.0, moving=80)
    found = solve_rotation(tracks, FRAMES, SIZE)
    assert found.focal_px == pytest.approx(focal_of(40.0), rel=0.02)


def test_known_focal_length_is_kept():
    tracks, _ = pan(40.0)
    found = solve_rotation(tracks, FRAMES, SIZE, focal_of(40.0))
    assert found.focal_px == pytest.approx(focal_of(40.0))
    assert found.focal_stderr_px == 0.0


def test_camera_that_moves_is_not_taken_for_one_that_turns():
    tracks, _ = pan(40.0, parallax=0.25)
    found = solve_rotation(tracks, FRAMES, SIZE)
    assert found is None or found.residual_px > 1.0


def test_frames_between_keyframes_follow_from_the_points():
    tracks, turns = pan(40.0)
    keyframes = FRAMES[::4] + FRAMES[-1:]
    path = solve_rotation(tracks, keyframes, SIZE)
    found = resect_rotations(tracks, keyframes, FRAMES, path, SIZE)
    assert abs(found - turns[0].T @ turns).max() < 3e-3


def test_frames_without_common_points_are_not_solved():
    tracks = [{0: np.array([10.0, 10.0])}, {1: np.array([20.0, 20.0])}]
    assert solve_rotation(tracks, [0, 1], SIZE) is None
