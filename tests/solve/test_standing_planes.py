"""Planes on the ground of a straight path, and the focal length that stands them upright."""

import math

import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of, project, rotation
from support.seen_points import observed

from nlens_video.cameras.ground import fit_ground
from nlens_video.solve.paths.bundle import Bundle
from nlens_video.solve.paths.standing_planes import standing_planes

FOV_DEG = 60.0
FOCAL = focal_of(FOV_DEG)
KEYFRAMES = 6
PITCH = math.radians(-12.0)


def board(rng, lean_deg):
    """Points (40, 3) on a board [m] that leans from the vertical."""
    middle = rng.uniform((-2.5, 0.7, -7.0), (2.5, 0.9, -1.5))
    middle[0] += math.copysign(0.8, middle[0])
    turn = rotation(rng.uniform(-0.7, 0.7), math.radians(lean_deg), 0.0)
    flat = np.column_stack([rng.uniform(-0.4, 0.4, (40, 2)), np.zeros(40)])
    return middle + flat @ turn.T


def path(leans_deg, seed=4, pole=0):
    """A camera that walks straight over a ground with boards, solved at its focal length.

    Args:
        leans_deg: of each board [deg].
        seed: of all places.
        pole: points on an upright pole.
    """
    rng = np.random.default_rng(seed)
    ground = np.column_stack([rng.uniform(-3, 3, 300), np.zeros(300), rng.uniform(-9, 0.5, 300)])
    points = np.concatenate([ground, *(board(rng, lean) for lean in leans_deg)])
    heights = np.linspace(0.1, 1.2, pole)
    points = np.concatenate([points, np.stack(np.broadcast_arrays(0.9, heights, -2.0), axis=1)])
    poses, frames = [], []
    for share in np.linspace(0.0, 1.0, KEYFRAMES):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation(0.0, PITCH, 0.0), (0.2, 1.0, 3.2 - 1.6 * share)
        poses.append(pose)
        pixels, seen = project(points, pose[:3, :3], pose[:3, 3], FOV_DEG)
        frames.append((pixels + rng.normal(0.0, 0.1, pixels.shape), seen))
    table = observed(frames).table(list(range(KEYFRAMES)), 3)
    exact = Bundle(table, SIZE, np.array(poses), np.full(KEYFRAMES, FOCAL), points[table.names])
    return exact.adjusted(focal=False)


def standing(bundle):
    return standing_planes(bundle, fit_ground(bundle.points, bundle.poses))


def found(planes):
    """Mean and deviation of the focal length [1] by the planes alone, by the true one."""
    logs = np.linspace(-0.4, 0.4, 801)
    values = planes.log(logs + math.log(FOCAL / SIZE[0]))
    weights = np.exp(values - values.max())
    mean = np.average(logs, weights=weights)
    return mean, math.sqrt(np.average((logs - mean) ** 2, weights=weights))


@pytest.mark.parametrize("share", [0.7, 1.0, 1.4])
def test_focal_length_is_that_by_which_boards_are_upright(share):
    planes = standing(path([0.0] * 6).stretched(share * FOCAL))
    assert len(planes.planes) >= 4
    middle, error = found(planes)
    assert abs(middle) < 0.02
    assert 0.3 * abs(middle) < error < 0.04


def test_boards_that_lean_are_outvoted():
    middle, error = found(standing(path([0.0, 15.0, 0.0, 0.0, -12.0, 0.0, 0.0])))
    assert abs(middle) < 0.04
    assert 0.5 * abs(middle) < error < 0.06


def test_one_board_that_leans_leaves_the_focal_length_uncertain():
    middle, error = found(standing(path([6.0])))
    assert abs(middle) > 0.05
    assert abs(middle) < 2.5 * error


def test_ground_alone_tells_no_focal_length():
    planes = standing(path([]))
    assert np.ptp(planes.log(np.linspace(-0.5, 0.5, 11))) == pytest.approx(0.0, abs=1e-6)


def test_upright_pole_alone_tells_no_focal_length():
    planes = standing(path([], pole=60))
    assert found(planes)[1] > 0.1
