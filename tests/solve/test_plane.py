"""Keyframes of even ground alone: focal length and normal by the plane's homographies."""

import math

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st
from support.camera_paths import SIZE, focal_of, project, rotation
from support.seen_points import observed

from nlens_video.cameras.ground import fit_ground
from nlens_video.solve.paths.plane import changes, plane_bundles

WIDTH, HEIGHT = SIZE
COUNT = 6


def seen(fov_deg, *, depth=0.0, count=COUNT, points=600, noise_px=0.1):
    """What a camera sees that moves sideways over the ground and turns, and its pitch [deg]."""
    rng = np.random.default_rng(1)
    heights = rng.uniform(0.0, depth, points)
    ground = np.column_stack([rng.uniform(-5, 5, points), heights, rng.uniform(-9, 1, points)])
    frames = []
    for n in range(count):
        share = n / (count - 1)
        turn = rotation(math.radians(-5 + 10 * share), math.radians(-22.0), 0.02 * share)
        pixels, inside = project(ground, turn, np.array([0.7 * share, 1.4, 2.0]), fov_deg)
        frames.append((pixels + rng.normal(0.0, noise_px, pixels.shape), inside))
    return observed(frames).table(list(range(count)))


def best(bundles):
    return min(bundles, key=lambda one: one.unexplained_px)


@pytest.mark.parametrize("fov_deg", [30.0, 52.0, 75.0])
def test_field_of_view_and_ground_are_found_together(fov_deg):
    bundle = best(plane_bundles(seen(fov_deg), COUNT, SIZE, None))
    assert bundle.focals_px == pytest.approx(focal_of(fov_deg), rel=0.02)
    assert bundle.unexplained_px < 0.2
    normal, _ = fit_ground(bundle.points[np.isfinite(bundle.points[:, 0])], bundle.poses)
    assert normal @ bundle.poses[0][:3, 2] == pytest.approx(math.sin(math.radians(22.0)), abs=0.01)


def test_given_field_of_view_is_kept():
    bundle = best(plane_bundles(seen(52.0), COUNT, SIZE, focal_of(52.0)))
    assert bundle.focals_px == pytest.approx(focal_of(52.0), rel=1e-9)
    assert bundle.unexplained_px < 0.2


def test_points_with_depth_are_no_plane():
    assert plane_bundles(seen(52.0, depth=1.0), COUNT, SIZE, None) == []


@pytest.mark.parametrize(("count", "points"), [(2, 600), (COUNT, 30)])
def test_too_few_keyframes_or_points_tell_no_plane(count, points):
    assert plane_bundles(seen(52.0, count=count, points=points), count, SIZE, None) == []


angle = st.floats(-0.4, 0.4)


@settings(max_examples=60)
@drawn(
    turns=st.lists(st.tuples(angle, angle, angle), min_size=2, max_size=4),
    focal=st.floats(0.4, 2.5), tilt=st.tuples(angle, angle),
)  # fmt: skip
def test_homographies_of_a_plane_keep_its_lengths_and_angles(turns, focal, tilt):
    normal = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
    lens = np.diag([focal, focal, 1.0])
    maps = np.array([
        lens @ (rotation(*turn) + np.outer((0.1, -0.2, 0.05), normal)) @ np.linalg.inv(lens)
        for turn in turns
    ])  # fmt: skip
    assert abs(changes(maps, np.array([focal]), normal[None])).max() < 1e-6
    beside = np.array([*normal[[1, 2]], -normal[0]])
    assert np.isfinite(changes(maps, np.array([1.3 * focal]), beside[None])).all()
