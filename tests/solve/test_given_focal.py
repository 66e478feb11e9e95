"""A given field of view that the camera's movement contradicts."""

import math

import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of, project, rotation
from support.seen_points import observed

from nlens_video.solve.paths.given_focal import told_against, without_fov
from nlens_video.solve.paths.moving import PartSolver

FOV_DEG = 50.0
KEYFRAMES = list(range(9))
MEASURED = 0.08


def solver(*, turn_deg, way, zoom=1.0):
    """What a camera sees among things on the ground that turns and moves sideways."""
    rng = np.random.default_rng(7)
    points = np.column_stack(
        [rng.uniform(-5, 5, 600), rng.choice([0.0, 0.4, 1.0], 600), rng.uniform(-9, -1, 600)]
    )
    frames = []
    for n in KEYFRAMES:
        share = n / KEYFRAMES[-1]
        turn = rotation(math.radians(turn_deg * (share - 0.5)), math.radians(-16.0), 0.0)
        eye = np.array([way * (share - 0.5), 1.4, 2.0 - 0.4 * way * share])
        fov = FOV_DEG * zoom ** (share**2)
        pixels, inside = project(points, turn, eye, fov)
        frames.append((pixels + rng.normal(0.0, 0.05, pixels.shape), inside))
    return PartSolver(observed(frames), SIZE)


@pytest.mark.slow
@pytest.mark.parametrize(("turn_deg", "way"), [(14.0, 0.0), (14.0, 1.0)])
@pytest.mark.parametrize("given", [44.0, 56.0])
def test_field_of_view_that_a_turn_contradicts_is_told_with_the_right_one(turn_deg, way, given):
    seen = solver(turn_deg=turn_deg, way=way)
    found = told_against(seen, KEYFRAMES, focal_of(given), MEASURED)
    assert found is not None
    focal, error = found
    assert focal == pytest.approx(focal_of(FOV_DEG) / SIZE[0], rel=max(0.01, 3.0 * error))


@pytest.mark.slow
@pytest.mark.parametrize(("turn_deg", "way"), [(14.0, 0.0), (14.0, 1.0)])
def test_field_of_view_that_is_right_to_a_percent_or_two_is_not_contradicted(turn_deg, way):
    seen = solver(turn_deg=turn_deg, way=way)
    assert told_against(seen, KEYFRAMES, focal_of(FOV_DEG), MEASURED) is None
    assert told_against(seen, KEYFRAMES, 1.02 * focal_of(FOV_DEG), MEASURED) is None


@pytest.mark.slow
@pytest.mark.parametrize(("turn_deg", "zoom"), [(0.0, 1.0), (14.0, 1.3)])
def test_straight_path_and_zoom_contradict_no_field_of_view(turn_deg, zoom):
    seen = solver(turn_deg=turn_deg, way=1.0, zoom=zoom)
    assert told_against(seen, KEYFRAMES, focal_of(44.0), MEASURED) is None


def test_advice_says_what_the_movement_tells():
    assert without_fov(None) == "leave --fov out, or "
    assert without_fov((50.04, 0.21)) == (
        "the movement tells 50.04 ± 0.21 degrees: leave --fov out, or "
    )
