"""How a solved camera explains tracks and segments."""

import numpy as np
import pytest
from msgspec.structs import replace
from support.camera_paths import SIZE, focal_of, project, rotation
from support.seen_points import observed

from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera
from nlens_video.cli.plate_solver import require_path
from nlens_video.core.errors import InputError
from nlens_video.solve.evidence import (
    CLUTTER,
    VERTICAL,
    Reprojection,
    doubted_where_steep,
    line_groups,
    reproject,
    shows_ground,
)
from nlens_video.solve.still.segments import Segments

FOV_DEG = 50.0


def camera_of(poses, fov_deg=FOV_DEG):
    """A solved camera at given turns (3, 3) and places (3,), a frame a second."""
    keys = []
    for index, (turn, eye) in enumerate(poses):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn.T, -turn.T @ np.array(eye)
        keys.append(CameraKey(index=index, pts_s=float(index), world_to_camera=matrix,
                              fov_x_deg=fov_deg))  # fmt: skip
    return SolvedCamera(width=SIZE[0], height=SIZE[1], keys=tuple(keys))


def seen_by(poses, change=None):
    """Exact observations of points on the ground and above it, but for a frame's change [px]."""
    rng = np.random.default_rng(2)
    points = np.column_stack([
        rng.uniform(-3, 3, 60), rng.uniform(0, 1, 60), rng.uniform(-9, -2, 60),
    ])  # fmt: skip
    frames = []
    for frame, (turn, eye) in enumerate(poses):
        pixels, seen = project(points, turn, np.array(eye), FOV_DEG)
        frames.append((pixels + (change or {}).get(frame, 0.0), seen))
    return observed(frames)


WALK = [(rotation(0.02 * n, -0.25, 0.01 * n), (0.1 * n, 1.5, -0.05 * n)) for n in range(8)]
PAN = [(rotation(0.03 * n, -0.25, 0.0), (0.0, 1.5, 0.0)) for n in range(8)]


def test_a_path_beside_which_half_of_the_points_lie_is_refused_and_a_still_camera_is_none():
    times, frames = [float(n) for n in range(len(WALK))], range(40, 40 + len(WALK))
    camera = replace(camera_of(WALK), path="moving")
    require_path(camera, reproject(seen_by(WALK), times, camera), frames)
    rng = np.random.default_rng(5)
    stray = {frame: rng.normal(0.0, 0.05 * SIZE[0], 2) for frame in range(len(WALK))}
    tracked = reproject(seen_by(WALK, stray), times, camera)
    with pytest.raises(InputError, match="half of them are seen over 0.4% of the width beside it"):
        require_path(camera, tracked, frames)
    require_path(replace(camera, path="still"), tracked, frames)


def test_a_path_of_what_moves_by_itself_says_where_that_is_and_on_which_frames():
    camera = replace(camera_of(WALK), path="moving")
    number = np.repeat(np.arange(10), 8)
    on_path = (number < 4) & (np.tile(np.arange(8), 10) > 1)
    tracked = Reprojection(
        number,
        np.tile(np.arange(8), 10),
        np.where(on_path[:, None], (0.25 * SIZE[0], 0.75 * SIZE[1]), (0.6 * SIZE[0], 0.0)),
        np.where(on_path, 0.1, 7.0),
    )
    with pytest.raises(
        InputError, match="about 25% from the left and 75% from above on frames 42 to 47, and most"
    ):
        require_path(camera, tracked, range(40, 48))


@pytest.mark.parametrize("poses", [WALK, PAN], ids=["walk", "pan"])
def test_exact_tracks_lie_where_the_cameras_see_their_points(poses):
    seen = seen_by(poses)
    found = reproject(seen, [float(n) for n in range(len(poses))], camera_of(poses))
    assert len(found.error_px) == len(seen.table(list(range(len(poses))), fewest=5).numbers) > 200
    assert found.error_px.max() < 0.02
    frames, middle, most = found.by_frame()
    assert frames.tolist() == list(range(8)) and (middle <= most).all()


def test_cameras_that_do_not_follow_the_plate_have_an_error():
    still = camera_of(PAN[:1])
    found = reproject(seen_by(PAN), [float(n) for n in range(8)], still)
    assert found.median_px > 20.0


def test_one_frame_off_shows_in_that_frame():
    found = reproject(seen_by(PAN, {5: 8.0}), [float(n) for n in range(8)], camera_of(PAN))
    frames, middle, _ = found.by_frame()
    assert frames[middle.argmax()] == 5
    assert middle[5] > 5.0 > 3.0 > middle[2]


def test_shot_without_tracks_has_no_error_to_tell():
    found = reproject(observed([(np.zeros((0, 2)), np.zeros(0, bool))]), [0.0], camera_of(PAN[:1]))
    assert found.median_px is None
    assert not len(found.by_frame()[0])


def test_segments_are_grouped_by_the_direction_that_they_point_to():
    turn, eye = rotation(0.2, -0.3, 0.05), np.array([0.0, 1.5, 0.0])
    camera = camera_of([(turn, eye)]).at(0.0)
    assert camera.fx == pytest.approx(focal_of(FOV_DEG))
    # no line below the camera, which would point to the nadir as well
    starts = np.array([[x, 0.1, z] for x in (-1.0, 0.6, 1.2) for z in (-3.0, -4.0)])
    ends = []
    for direction in ((0.0, 0.7, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)):
        both = np.stack([starts, starts + direction], axis=1)
        ends.append(np.stack([project(both[:, k], turn, eye, FOV_DEG)[0] for k in (0, 1)], axis=1))
    odd = np.array([[[100.0, 100.0], [160.0, 170.0]]])
    segments = Segments(np.concatenate([*ends, odd]), np.full(19, 0.5))
    groups = line_groups(segments, camera)
    assert (groups[:6] == VERTICAL).all()
    assert {len(set(groups[6:12])), len(set(groups[12:18]))} == {1}
    assert groups[6] != groups[12] and min(groups[6], groups[12]) >= 1
    assert groups[18] == CLUTTER


TURN, EYE = rotation(0.3, -0.3, 0.0), np.array([0.0, 1.5, 0.0])
GRID = np.array([[x, 0.0, z] for x in (-0.8, 0.0, 0.8) for z in (-3.2, -4.0, -4.8)])


def seen_lines(starts, *directions):
    """Segments from some points along directions, as the camera at EYE sees them."""
    ends = []
    for direction in directions:
        both = np.stack([starts, starts + np.array(direction)], axis=1)
        ends.append(np.stack([project(both[:, k], TURN, EYE, FOV_DEG)[0] for k in (0, 1)], axis=1))
    return Segments(np.concatenate(ends), np.full(len(starts) * len(directions), 0.5))


TILES = seen_lines(GRID, (0.6, 0.0, 0.0), (0.0, 0.0, -0.6))
WALL = seen_lines(GRID + (0.0, 0.4, 0.0), (0.6, 0.0, 0.0), (0.0, 0.6, 0.0))
SURE = replace(camera_of([(TURN, EYE)]), horizon="measured", method="vanishing points")


def told(segments, camera=SURE):
    middle = segments.ends.mean(axis=(0, 1)) / SIZE
    return shows_ground(segments, camera, 0.0, (float(middle[0]), float(middle[1])))


def test_lines_along_two_directions_tell_the_ground():
    assert told(TILES)


def test_a_wall_does_not_tell_the_ground():
    assert not told(WALL)


def test_lines_far_from_the_place_do_not_tell_its_ground():
    assert not shows_ground(TILES, SURE, 0.0, (0.02, 0.98))


def test_a_horizon_that_is_assumed_tells_no_ground_by_its_lines():
    assert not told(TILES, replace(SURE, horizon="assumed"))


@pytest.mark.parametrize(
    "change", [{"path": "moving"}, {"scale": "metres"}, {"method": "vanishing points and blur"}]
)
def test_a_path_a_scale_or_blur_tells_the_ground(change):
    assert told(WALL, replace(SURE, horizon="assumed", **change))


@pytest.mark.parametrize(
    ("pitch_deg", "posts", "expected"),
    [(-45.0, 0, "assumed"), (-45.0, 4, "measured"), (-30.0, 0, "measured")],
)
def test_steep_view_without_anything_upright_may_be_of_a_wall(pitch_deg, posts, expected):
    turn, eye = rotation(0.2, np.radians(pitch_deg), 0.0), np.array([0.0, 3.0, 0.0])
    corners = [(x, 0.0, z) for x in (-1.0, 0.0, 1.0) for z in (-2.0, -3.0, -4.0)]
    starts = [c for c in corners for _ in range(2)]
    ends = [(x + dx, y, z + dz) for x, y, z in corners for dx, dz in ((0.8, 0.0), (0.0, 0.8))]
    starts += [(0.3 * n - 0.7, 0.0, -2.7) for n in range(posts)]
    ends += [(0.3 * n - 0.7, 0.5, -2.7) for n in range(posts)]
    lines = np.stack(
        [project(np.array(one), turn, eye, FOV_DEG)[0] for one in (starts, ends)], axis=1
    )
    errors = CameraErrors(fov_deg=1.0, pitch_deg=0.2, roll_deg=0.2)
    camera = replace(camera_of([(turn, eye)]), path="still", horizon="measured", errors=errors)
    found = doubted_where_steep(camera, Segments(lines, np.full(len(lines), 0.5)))
    assert found.horizon == expected
    assert found.errors.pitch_deg == pytest.approx(0.2) or expected == "assumed"
    assert found.errors.pitch_deg >= 10.0 or expected == "measured"
