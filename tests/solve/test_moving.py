"""The path of a moving camera, its field of view and the ground from tracks."""

import math

import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of, project, rotation
from support.seen_points import observed

from nlens_video.cameras.ground import fit_ground
from nlens_video.core.errors import InputError
from nlens_video.solve.paths.moving import PartSolver, with_focal

FRAMES = list(range(24))
KEYFRAMES = FRAMES[::3] + FRAMES[-1:]
FOV_DEG = 52.0


def walk(
    turning=1.0,
    zoom=1.0,
    walkers=0,
    distortion=0.0,
    way=1.0,
    sway=0.0,
    things=200,
    noise_px=0.1,
    drift_px=0.0,
):
    """Observations of a camera that walks over a ground with things on it, poses, focal lengths.

    Points of the lower part of the frame are seen below their place, in the end by `drift_px`.
    """
    rng = np.random.default_rng(5)
    ground = np.column_stack([rng.uniform(-4, 4, 500), np.zeros(500), rng.uniform(-10, 0, 500)])
    things = np.column_stack(
        [rng.uniform(-3, 3, things), rng.uniform(0, 1, things), rng.uniform(-9, -1, things)]
    )
    people = np.column_stack(
        [rng.uniform(-1, 0, walkers), rng.uniform(0, 1.5, walkers), np.full(walkers, -2.0)]
    )
    poses, focals, frames = [], [], []
    for frame in FRAMES:
        share = frame / FRAMES[-1]
        pose = np.eye(4)
        pose[:3, :3] = rotation(
            turning * math.radians(-6 + 12 * share), math.radians(-15), math.radians(1.2)
        )
        pose[:3, 3] = (way * (-0.4 + 0.8 * share), 1.25, 2.2 - way * 0.5 * share)
        pose[:3, 3] += sway * np.sin(share * np.array([7.0, 13.0, 10.0]) + (0.0, 1.0, 2.0))
        poses.append(pose)
        focal = focal_of(FOV_DEG) * zoom ** (share**2 * (3.0 - 2.0 * share))
        focals.append(focal)
        fov = 2.0 * math.degrees(math.atan(0.5 * SIZE[0] / focal))
        stepped = people + (1.2 * share, 0.05 * math.sin(9.0 * share), 0.3 * share)
        points = np.concatenate([ground, things, stepped])
        pixels, seen = project(points, pose[:3, :3], pose[:3, 3], fov)
        middle = np.array(SIZE) / 2.0
        square = (((pixels - middle) / focal) ** 2).sum(axis=1, keepdims=True)
        pixels = middle + (pixels - middle) * (1.0 + distortion * square)
        pixels[:, 1] += drift_px * share**2 * (pixels[:, 1] > 0.7 * SIZE[1])
        frames.append((pixels + rng.normal(0.0, noise_px, pixels.shape), seen))
    return observed(frames), np.array(poses), np.array(focals)


def followed_px(part, poses, focals):
    """Distance of ground points of the first frame from where later frames show them [px]."""
    ground = np.array([[x, 0.0, z] for x in (-0.8, 0.0, 0.8) for z in (-4.0, -2.5, -1.0)])
    normal, offset = fit_ground(part.points, part.poses)
    local = (ground - poses[0][:3, 3]) @ poses[0][:3, :3]
    # the same pixels of the first frame, cast on the ground that was found
    rays = local / -local[:, 2:] * (focals[0] / part.focals_px[0], focals[0] / part.focals_px[0], 1)
    rays = rays @ part.poses[0][:3, :3].T
    eye = part.poses[0][:3, 3]
    found = eye + rays * ((offset - normal @ eye) / (rays @ normal))[:, None]
    away = []
    for n, frame in enumerate(part.frames):
        places = []
        for points, pose, focal in (
            (ground, poses[frame], focals[frame]),
            (found, part.poses[n], part.focals_px[n]),
        ):
            seen = (points - pose[:3, 3]) @ pose[:3, :3]
            places.append(focal * seen[:, :2] / -seen[:, 2:])
        away.append(np.linalg.norm(places[0] - places[1], axis=1))
    return float(np.sqrt(np.mean(np.square(away))))


def solved(seen):
    solver = PartSolver(seen, SIZE)
    bundle = solver.solve(KEYFRAMES, None)
    return solver.moving(KEYFRAMES, bundle, *solver.focal_errors(bundle))


@pytest.fixture(scope="module")
def walked():
    seen, poses, focals = walk()
    return solved(seen), poses, focals


@pytest.mark.slow
def test_field_of_view_is_measured_with_its_error(walked):
    part, _, _ = walked
    assert part.focals_px == pytest.approx(focal_of(FOV_DEG), rel=0.01)
    assert abs(part.focals_px[0] / focal_of(FOV_DEG) - 1.0) < 4.0 * part.focal_error + 0.001
    assert not part.zooms


@pytest.mark.slow
@pytest.mark.parametrize("distortion", [-0.08, 0.05])
def test_distortion_of_the_lens_is_found_with_the_path(walked, distortion):
    assert walked[0].distortion == 0.0
    part = solved(walk(distortion=distortion)[0])
    assert part.distortion == pytest.approx(distortion, abs=0.01)
    assert part.focals_px == pytest.approx(focal_of(FOV_DEG), rel=0.01)
    assert part.residual_px < 0.2


def test_all_frames_have_a_pose(walked):
    assert walked[0].frames == FRAMES


def test_turns_between_frames_are_found(walked):
    part, poses, _ = walked
    turns = part.poses[:, :3, :3]
    assert abs(turns[0].T @ turns - poses[0, :3, :3].T @ poses[:, :3, :3]).max() < 3e-3


def test_points_of_the_ground_are_followed(walked):
    assert followed_px(*walked) < 0.3


def test_ground_is_level_as_the_camera_saw_it(walked):
    part, poses, _ = walked
    normal, _ = fit_ground(part.points, part.poses)
    seen = part.poses[0][:3, :3].T @ normal
    expected = poses[0][:3, :3].T @ (0.0, 1.0, 0.0)
    assert math.degrees(math.acos(min(1.0, seen @ expected))) < 0.2


@pytest.mark.slow
def test_zoom_is_followed_while_the_camera_walks():
    seen, poses, focals = walk(zoom=1.5)
    part = solved(seen)
    assert part.zooms
    assert part.focals_px == pytest.approx(focals, rel=0.02)
    assert followed_px(part, poses, focals) < 0.7


@pytest.mark.slow
def test_zoom_begins_with_the_field_of_view_that_is_given_even_a_wrong_one():
    seen, _, focals = walk(zoom=1.5)
    solver = PartSolver(seen, SIZE)
    bundle = solver.solve(KEYFRAMES, focals[0])
    assert bundle.focals_px[0] == pytest.approx(focals[0], rel=1e-9)
    assert bundle.focals_px[-1] == pytest.approx(focals[-1], rel=0.02)
    wrong = solver.solve(KEYFRAMES, 1.15 * focals[0])
    assert wrong.focals_px[0] == pytest.approx(1.15 * focals[0], rel=1e-9)


@pytest.mark.slow
def test_thing_that_walks_through_the_picture_is_left_out():
    seen, poses, focals = walk(walkers=200)
    assert followed_px(solved(seen), poses, focals) < 0.3


@pytest.mark.slow
def test_camera_held_by_hand_is_followed_while_somebody_walks_before_it():
    seen, poses, focals = walk(walkers=60, way=0.0, sway=0.05)
    part = solved(seen)
    assert part.focals_px == pytest.approx(focals, rel=0.01)
    assert len(part.points) > 450
    assert followed_px(part, poses, focals) < 0.3


@pytest.mark.slow
def test_straight_path_without_a_turn_does_not_tell_the_field_of_view():
    seen, _, _ = walk(turning=0.0)
    solver = PartSolver(seen, SIZE)
    assert min(solver.focal_errors(solver.solve(KEYFRAMES, None))) > 0.08


@pytest.mark.slow
@pytest.mark.parametrize(("given", "turning"), [(None, 1.0), (None, 0.5), (FOV_DEG, 0.5)])
def test_path_over_even_ground_alone_is_found(given, turning):
    seen, poses, focals = walk(things=0, way=0.6, turning=turning)
    solver = PartSolver(seen, SIZE)
    bundle = solver.solve(KEYFRAMES, None if given is None else focal_of(given))
    assert bundle.focals_px == pytest.approx(focal_of(FOV_DEG), rel=0.01)
    assert bundle.unexplained_px < 0.2
    assert followed_px(solver.moving(KEYFRAMES, bundle, 0.0, 0.0), poses, focals) < 0.3


@pytest.mark.slow
def test_error_of_the_field_of_view_covers_what_tracks_of_a_region_err_alike():
    at_random = PartSolver(walk(things=0, way=0.6, turning=0.5, noise_px=0.02)[0], SIZE)
    assert at_random.solve(KEYFRAMES, None).focal_bias() < 0.003
    seen, _, _ = walk(things=0, way=0.6, turning=0.5, noise_px=0.02, drift_px=0.6)
    bundle = PartSolver(seen, SIZE).solve(KEYFRAMES, None)
    off = abs(math.log(float(np.median(bundle.focals_px)) / focal_of(FOV_DEG)))
    assert 3.0 * bundle.focal_noise() < off < 3.0 * bundle.focal_bias()


@pytest.mark.slow
def test_straight_path_is_seen_alike_through_another_focal_length():
    seen, poses, focals = walk(turning=0.0)
    solver = PartSolver(seen, SIZE)
    bundle = solver.solve(KEYFRAMES, None)
    other = with_focal(bundle, 0.7 * focal_of(FOV_DEG))
    assert other.residual_px < 1.1 * bundle.residual_px
    assert followed_px(solver.moving(KEYFRAMES, other, 0.0, 0.0), poses, focals) < 0.3


def scattered(count):
    """Observations of points that move each by itself."""
    rng = np.random.default_rng(2)
    places = rng.uniform(0, 1, (count, 2)) * SIZE
    steps = rng.uniform(-6, 6, (count, 2))
    return observed([(places + n * steps, np.ones(count, bool)) for n in FRAMES])


def test_picture_whose_points_move_each_by_itself_is_refused():
    seen = scattered(200)
    with pytest.raises(InputError, match=r"frames 0 to 23: .* no path explains its 200"):
        PartSolver(seen, SIZE).solve(KEYFRAMES, None)


def test_frames_without_texture_are_named():
    seen = scattered(12)
    with pytest.raises(InputError, match=r"frames 0 to 23: .* 12 points .* little texture"):
        PartSolver(seen, SIZE).solve(KEYFRAMES, None)
