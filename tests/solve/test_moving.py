"""The path of a moving camera, its field of view and the ground from tracks."""

import math

import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of, project, rotation

from nlens_video.cameras.ground import fit_ground
from nlens_video.solve.moving import solve_moving

FRAMES = list(range(24))
FOV_DEG = 52.0


def walk(turning=1.0):
    """Tracks of a camera that walks over a ground with things on it, and its poses."""
    rng = np.random.default_rng(5)
    ground = np.column_stack([rng.uniform(-4, 4, 500), np.zeros(500), rng.uniform(-10, 0, 500)])
    things = np.column_stack(
        [rng.uniform(-3, 3, 200), rng.uniform(0, 1, 200), rng.uniform(-9, -1, 200)]
    )
    points = np.concatenate([ground, things])
    tracks = [{} for _ in points]
    poses = []
    for frame in FRAMES:
        share = frame / FRAMES[-1]
        pose = np.eye(4)
        pose[:3, :3] = rotation(
            turning * math.radians(-6 + 12 * share), math.radians(-15), math.radians(1.2)
        )
        pose[:3, 3] = (-0.4 + 0.8 * share, 1.25, 2.2 - 0.5 * share)
        poses.append(pose)
        pixels, seen = project(points, pose[:3, :3], pose[:3, 3], FOV_DEG)
        for number in np.flatnonzero(seen):
            tracks[number][frame] = pixels[number] + rng.normal(0.0, 0.1, 2)
    return [track for track in tracks if len(track) >= 6], np.array(poses)


@pytest.fixture(scope="module")
def walked():
    tracks, poses = walk()
    return solve_moving(tracks, FRAMES[::3] + FRAMES[-1:], FRAMES, SIZE), poses


@pytest.mark.slow
def test_field_of_view_is_measured_with_its_error(walked):
    found, _ = walked
    assert found.focal_px == pytest.approx(focal_of(FOV_DEG), rel=0.01)
    assert abs(found.focal_px - focal_of(FOV_DEG)) < 4.0 * found.focal_stderr_px + 1.0


def test_all_frames_have_a_pose(walked):
    assert list(walked[0].poses) == FRAMES


def test_turns_between_frames_are_found(walked):
    found, poses = walked
    turns = np.array([pose[:3, :3] for pose in found.poses.values()])
    assert abs(turns[0].T @ turns - poses[0, :3, :3].T @ poses[:, :3, :3]).max() < 3e-3


def test_ground_is_level_as_the_camera_saw_it(walked):
    found, poses = walked
    normal, _ = fit_ground(found.points, np.array(list(found.poses.values())))
    seen = found.poses[0][:3, :3].T @ normal
    expected = poses[0][:3, :3].T @ (0.0, 1.0, 0.0)
    assert math.degrees(math.acos(min(1.0, seen @ expected))) < 0.5


@pytest.mark.slow
def test_straight_path_without_a_turn_does_not_tell_the_field_of_view():
    tracks, _ = walk(turning=0.0)
    found = solve_moving(tracks, FRAMES[::3] + FRAMES[-1:], FRAMES, SIZE)
    assert found is None or found.focal_stderr_px > 0.08 * found.focal_px


def test_straight_path_is_solved_with_a_known_field_of_view():
    tracks, poses = walk(turning=0.0)
    found = solve_moving(tracks, FRAMES[::3] + FRAMES[-1:], FRAMES, SIZE, focal_of(FOV_DEG))
    eyes = np.array([pose[:3, 3] for pose in found.poses.values()])
    steps = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    assert len(eyes) == len(FRAMES)
    assert steps.std() < 0.05 * steps.mean()
