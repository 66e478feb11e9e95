"""Drift of an object over tracked ground."""

import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of, project, rotation

from nlens_video.core.layers import Box
from nlens_video.scene.camera import Camera
from nlens_video.solve.ground_drift import GroundDrift, ground_seen, has_moved, seen_by_pinhole

FOV_DEG = 50.0
OBJECT = Box(400, 200, 560, 400)


def camera_at(turn, eye, fov_deg=FOV_DEG):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, eye
    return Camera.centred(pose, focal_of(fov_deg), *SIZE, 1.0)


def poses(kind, frames=20):
    for n in range(frames):
        if kind == "pan":
            yield rotation(0.01 * n, -0.3, 0.0), np.array([0.0, 1.5, 0.0])
        else:
            yield rotation(0.003 * n, -0.3, 0.0), np.array([0.02 * n, 1.5, -0.03 * n])


def drift(kind, seen_by, standing=0, noise=0.05):
    """The drift of an object whose camera at each frame is `seen_by(turn, eye)`."""
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.linspace(-3, 3, 40), np.linspace(-9, -1, 40)), axis=-1)
    ground = np.insert(grid.reshape(-1, 2), 1, 0.0, axis=1)
    ground[:standing, 1] = 0.5
    found, before = GroundDrift(), None
    for turn, eye in poses(kind):
        pixels, seen = project(ground, turn, eye, FOV_DEG)
        pixels += rng.normal(0.0, noise, pixels.shape)
        points = {n: pixels[n].astype(np.float32) for n in np.flatnonzero(seen)}
        now = seen_by(turn, eye)
        found.add(points, OBJECT, ground_seen(before or now, now, 0.0))
        before = now
    return found


@pytest.mark.parametrize("kind", ["pan", "walk"])
def test_camera_of_the_plate_does_not_drift(kind):
    found = drift(kind, camera_at)
    assert found.frames == 19
    assert found.rms_px < 0.5
    assert not found.slides(SIZE[0])


@pytest.mark.parametrize("kind", ["pan", "walk"])
def test_camera_that_stands_still_drifts_as_far_as_the_ground_moves(kind):
    first = next(poses(kind))
    found = drift(kind, lambda turn, eye: camera_at(*first))
    assert found.slides(SIZE[0])
    if kind == "pan":  # 19 steps of 0.01 rad: 195 px in the frame's middle, more below it
        assert found.worst_px == pytest.approx(0.19 * focal_of(FOV_DEG), rel=0.25)


def test_points_of_a_lens_with_distortion_are_where_a_pinhole_sees_them():
    camera = camera_at(*next(poses("walk")))
    ideal = np.array([[480.0, 256.0], [100.0, 60.0], [900.0, 480.0]])
    flat = (ideal - (480.0, 256.0)) / camera.fx
    bent = ideal + (ideal - (480.0, 256.0)) * -0.1 * (flat**2).sum(axis=1, keepdims=True)
    seen = seen_by_pinhole(dict(enumerate(bent.astype(np.float32))), camera, -0.1)
    assert abs(np.array([seen[n] for n in range(3)]) - ideal).max() < 0.05


def test_camera_of_another_lens_drifts():
    found = drift("pan", lambda turn, eye: camera_at(turn, eye, 0.8 * FOV_DEG))
    assert found.slides(SIZE[0])


def test_what_moves_by_itself_beside_the_object_is_no_drift():
    still = camera_at(rotation(0.0, -0.3, 0.0), np.array([0.0, 1.5, 0.0]))
    rng = np.random.default_rng(5)
    places = rng.uniform((0, 150), (960, 512), (400, 2)).astype(np.float32)
    beside = (abs(places[:, 0] - 480) < 110) & (abs(places[:, 1] - 420) < 60)
    found = GroundDrift()
    for n in range(20):
        moved = places + np.float32([3.0 * n, 0.0]) * beside[:, None]
        found.add(dict(enumerate(moved)), OBJECT, ground_seen(still, still, 0.0))
    assert found.frames > 5
    assert not found.slides(SIZE[0])


@pytest.mark.parametrize("slides", [False, True])
def test_large_thing_around_the_object_is_not_taken_for_its_ground(slides):
    """Three points of five, beside the object and in the frame, are of a car that drives by."""
    still = camera_at(rotation(0.0, -0.3, 0.0), np.array([0.0, 1.5, 0.0]))
    rng = np.random.default_rng(7)
    places = rng.uniform((0, 250), (960, 512), (400, 2))
    of_the_car = np.arange(400) % 5 < 3
    found = GroundDrift()
    for n in range(20):
        moved = places + np.outer(of_the_car, [12.0 * n, 0.0]) + rng.normal(0.0, 0.1, places.shape)
        moved[~of_the_car] += [0.6 * n * slides, 0.0]
        points = dict(enumerate(moved.astype(np.float32)))
        found.add(points, OBJECT, ground_seen(still, still, 0.0))
    assert found.slides(SIZE[0]) == slides
    if slides:
        assert found.worst_px == pytest.approx(0.6 * 19, rel=0.1)


def test_noise_of_a_still_plate_is_no_drift():
    still = camera_at(rotation(0.0, -0.3, 0.0), np.array([0.0, 1.5, 0.0]))
    rng = np.random.default_rng(6)
    places = rng.uniform((300, 350), (660, 450), (12, 2))
    found = GroundDrift()
    for _ in range(300):
        noisy = (places + rng.normal(0.0, 0.5, places.shape)).astype(np.float32)
        found.add(dict(enumerate(noisy)), OBJECT, ground_seen(still, still, 0.0))
    assert not found.slides(SIZE[0])


def test_pixels_above_the_horizon_have_no_ground():
    level = camera_at(rotation(0.0, 0.0, 0.0), np.array([0.0, 1.5, 0.0]))
    seen = ground_seen(level, level, 0.0)(np.array([[480.0, 100.0], [480.0, 400.0]]))
    assert np.isnan(seen[0]).all()
    assert seen[1] == pytest.approx([480.0, 400.0])


def test_camera_has_moved_where_its_pose_or_lens_differs():
    turn, eye = rotation(0.0, -0.3, 0.0), np.array([0.0, 1.5, 0.0])
    assert not has_moved(camera_at(turn, eye), camera_at(turn, eye))
    assert has_moved(camera_at(turn, eye), camera_at(turn, eye + 0.01))
    assert has_moved(camera_at(turn, eye), camera_at(turn, eye, 51.0))
