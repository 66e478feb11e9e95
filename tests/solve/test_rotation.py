"""Rotation and field of view from tracks of a camera that turns on the spot."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.camera_paths import SIZE, focal_of, project, rotation
from support.seen_points import observed

from nlens_video.solve.paths.moving import PartSolver
from nlens_video.solve.paths.rotation import _Data, solve_rotation
from nlens_video.solve.points.evenly import evenly
from nlens_video.solve.points.noise import noise_px
from nlens_video.solve.points.observations import Observations

FRAMES = list(range(12))
ROOM = 2500


def pan(fov_deg, noise_px=0.1, moving=0, parallax=0.0, zoom=1.0, turning=1.0):
    """Observations of a pan over 12 degrees, camera axes and field of view of each frame."""
    rng = np.random.default_rng(3)
    points = np.column_stack(
        [rng.uniform(-6, 6, 400), rng.uniform(-3, 3, 400), rng.uniform(-9, -5, 400)]
    )
    turns, fovs, frames = [], [], []
    for frame in FRAMES:
        turn = rotation(
            turning * math.radians(6.0 - frame), math.radians(-10.0 + 0.2 * turning * frame), 0.0
        )
        share = zoom ** (frame / FRAMES[-1])
        fov = 2.0 * math.degrees(math.atan(math.tan(0.5 * math.radians(fov_deg)) / share))
        turns.append(turn)
        fovs.append(fov)
        shifted = points.copy()
        shifted[:moving, 0] += 0.05 * frame
        pixels, seen = project(shifted, turn, np.array([parallax * frame, 0.0, 0.0]), fov)
        frames.append((pixels + rng.normal(0.0, noise_px, pixels.shape), seen))
    return observed(frames), np.array(turns), np.array(fovs)


def solved(seen, focal_px=None, zooms=False):
    return solve_rotation(seen.table(FRAMES), len(FRAMES), SIZE, focal_px, zooms=zooms)


@pytest.mark.slow
@pytest.mark.parametrize("fov_deg", [25.0, 40.0, 65.0])
def test_field_of_view_and_rotations_of_a_pan_are_found(fov_deg):
    seen, turns, _ = pan(fov_deg)
    found = solved(seen)
    assert found.focals_px[0] == pytest.approx(focal_of(fov_deg), rel=0.01)
    assert abs(found.focals_px[0] / focal_of(fov_deg) - 1.0) < 4.0 * found.focal_error
    assert abs(found.rotations - turns[0].T @ turns).max() < 2e-3
    assert found.residual_px < 0.3


def test_things_that_move_are_left_out():
    seen, _, _ = pan(40.0, moving=80)
    assert solved(seen).focals_px[0] == pytest.approx(focal_of(40.0), rel=0.02)


def crossed(walkers):
    """Observations of a pan while somebody with so many points crosses close before the camera.

    The room's points are seen for three frames each, as where they are covered and uncovered.
    """
    rng = np.random.default_rng(4)
    room = np.column_stack(
        [rng.uniform(-6, 6, ROOM), rng.uniform(-5, 2, ROOM), rng.uniform(-9, -7, ROOM)]
    )
    begun = rng.integers(-2, len(FRAMES), ROOM)
    person = rng.uniform((0, 0), (90, SIZE[1]), (walkers, 2))
    turns, frames = [], []
    for frame in FRAMES:
        turn = rotation(math.radians(6.0 - frame), math.radians(-10.0), 0.0)
        pixels, seen = project(room, turn, np.zeros(3), 40.0)
        seen &= (frame >= begun) & (frame < begun + 3)
        left = 40.0 * frame
        seen &= (pixels[:, 0] < left) | (pixels[:, 0] > left + 90.0)
        there = np.concatenate([pixels, person + (left, 0.0)])
        there += rng.normal(0.0, 0.1, there.shape)
        turns.append(turn)
        frames.append((there, np.concatenate([seen, np.ones(walkers, bool)])))
    return observed(frames), np.array(turns)


def test_somebody_with_most_points_who_crosses_close_before_the_camera_is_left_out():
    seen, turns = crossed(walkers=220)
    assert abs(solved(seen, focal_of(40.0)).rotations - turns[0].T @ turns).max() < 0.01


def test_every_frame_follows_the_room_behind_somebody_who_crosses():
    seen, turns = crossed(walkers=400)
    part = PartSolver(seen, SIZE).turning(FRAMES, solved(seen, focal_of(40.0)))
    assert part.frames == FRAMES
    assert abs(part.poses[:, :3, :3] - turns[0].T @ turns).max() < 0.01


def test_points_that_are_taken_share_the_frame_evenly():
    seen, _ = crossed(walkers=220)
    table = seen.table(FRAMES)
    taken = evenly(table, len(FRAMES), SIZE)
    person = table.names[table.numbers] >= ROOM
    assert person.mean() > 0.5
    assert person[taken].mean() < 0.3


def test_noisy_tracks_of_a_turn_are_no_reason_to_look_for_a_path(monkeypatch):
    def fail(*_, **__):
        pytest.fail("a path was looked for")

    monkeypatch.setattr(PartSolver, "_bundle", fail)
    seen, turns, _ = pan(40.0, noise_px=0.7)
    assert solved(seen).residual_px > 0.6
    part = PartSolver(seen, SIZE).solve(FRAMES, None)
    assert part.kind == "rotation"
    assert abs(part.poses[:, :3, :3] - turns[0].T @ turns).max() < 5e-3


@pytest.mark.parametrize("parallax", [0.0, 0.05])
def test_noise_of_tracks_is_measured_whatever_depth_the_scene_has(parallax):
    seen, _, _ = pan(40.0, noise_px=0.5, parallax=parallax)
    assert noise_px(seen, FRAMES[0], FRAMES[-1]) == pytest.approx(1.1774 * 0.5, rel=0.1)


def test_noise_of_frames_that_share_no_points_is_not_known():
    seen = Observations()
    for frame in range(4):
        seen.add(np.arange(10 * frame, 10 * frame + 10), np.zeros((10, 2), np.float32))
    assert noise_px(seen, 0, 3) == 0.0


def test_known_focal_length_is_kept():
    seen, _, _ = pan(40.0)
    found = solved(seen, focal_of(40.0))
    assert found.focals_px[0] == pytest.approx(focal_of(40.0))
    assert found.focal_error == 0.0


def test_camera_that_moves_is_not_taken_for_one_that_turns():
    seen, _, _ = pan(40.0, parallax=0.25)
    found = solved(seen)
    assert found is None or found.residual_px > 1.0


def test_frames_between_keyframes_follow_from_the_points():
    seen, turns, _ = pan(40.0)
    part = PartSolver(seen, SIZE).solve(FRAMES[::4] + FRAMES[-1:], None)
    assert part.kind == "rotation"
    assert part.frames == FRAMES
    assert abs(part.poses[:, :3, :3] - turns[0].T @ turns).max() < 3e-3


def test_zoom_of_a_pan_is_followed_in_each_frame():
    seen, _, fovs = pan(50.0, zoom=1.6)
    part = PartSolver(seen, SIZE).solve(FRAMES[::2] + FRAMES[-1:], None)
    assert part.zooms
    expected = [focal_of(fov) for fov in fovs]
    assert part.focals_px == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_zoom_without_a_turn_does_not_tell_the_field_of_view():
    seen, _, _ = pan(50.0, zoom=1.6, turning=0.0)
    part = PartSolver(seen, SIZE).solve(FRAMES, None)
    assert part.focals_px[-1] / part.focals_px[0] == pytest.approx(1.6, rel=0.01)
    assert part.focal_error > 0.08


def test_frames_without_common_points_are_not_solved():
    seen = Observations()
    seen.add(np.arange(10), np.zeros((10, 2), np.float32))
    seen.add(np.arange(10, 20), np.zeros((10, 2), np.float32))
    assert solve_rotation(seen.table([0, 1], fewest=1), 2, SIZE) is None
    assert solve_rotation(seen.table([0, 1]), 2, SIZE) is None


def test_slopes_are_those_of_differences():
    rng = np.random.default_rng(0)
    frames, points, step = 5, 20, 1e-6
    rotations = Rotation.from_rotvec(rng.normal(0.0, 0.1, (frames, 3))).as_matrix()
    focals = rng.uniform(800.0, 1200.0, frames)
    numbers, places = np.repeat(np.arange(points), frames), np.tile(np.arange(frames), points)
    seen = rng.random(len(numbers)) < 0.8
    data = _Data(numbers[seen], places[seen], rng.uniform(-300.0, 300.0, (int(seen.sum()), 2)))
    found = data.slopes(focals, rotations)
    here = data.residuals(focals, rotations)
    for frame in range(frames):
        longer = focals.copy()
        longer[frame] *= np.exp(step)
        expected = (data.residuals(longer, rotations) - here) / step
        assert found[:, :, frame] == pytest.approx(expected, abs=5e-3)
        for axis in range(3):
            turned = rotations.copy()
            turned[frame] = turned[frame] @ Rotation.from_rotvec(step * np.eye(3)[axis]).as_matrix()
            expected = (data.residuals(focals, turned) - here) / step
            column = frames + 3 * frame + axis
            assert found[:, :, column] == pytest.approx(expected, abs=5e-3)
