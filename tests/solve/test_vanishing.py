"""Pitch, roll and focal length from line segments with known vanishing points."""

import math

import cv2
import numpy as np
import pytest
from support.camera_paths import SIZE, focal_of, project, rotation

from nlens_video.solve.still.prior import CameraPrior
from nlens_video.solve.still.segments import Segments, find_segments, pooled
from nlens_video.solve.still.vanishing import Mixture

FOV_DEG = 48.0


def lines(pitch_deg, roll_deg, fov_deg=FOV_DEG, clutter=20, upright=25, level=40, seed=0):
    """Segments of a room of boxes, seen by a camera with these angles, with clutter."""
    rng = np.random.default_rng(seed)
    turn = rotation(math.radians(25.0), math.radians(pitch_deg), math.radians(roll_deg))
    starts, ends = [], []
    for direction, count in (((0, 1, 0), upright), ((1, 0, 0), level), ((0, 0, 1), level)):
        # places before the camera, from its own axes
        place = turn @ np.stack(
            [
                rng.uniform(-2, 2, 8 * count),
                rng.uniform(-1, 1, 8 * count),
                rng.uniform(-7, -3, 8 * count),
            ]
        )
        first = place.T
        second = first + 0.6 * np.array(direction)
        a, seen = project(first, turn, np.zeros(3), fov_deg)
        b, also = project(second, turn, np.zeros(3), fov_deg)
        both = np.flatnonzero(seen & also)[:count]
        starts.append(a[both] + rng.normal(0, 0.3, (len(both), 2)))
        ends.append(b[both] + rng.normal(0, 0.3, (len(both), 2)))
    middle = rng.uniform(50, 450, (clutter, 2)) * (1.8, 1.0)
    angle = rng.uniform(0, math.pi, clutter)
    half = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    starts.append(middle - half)
    ends.append(middle + half)
    both = np.stack([np.concatenate(starts), np.concatenate(ends)], axis=1)
    return Segments(both, np.full(len(both), 0.5))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg"), [(-5.0, 0.0), (-15.0, 1.5), (-30.0, -2.0), (4.0, 0.0)]
)
def test_camera_is_found_among_boxes_and_clutter(pitch_deg, roll_deg):
    found = Mixture(lines(pitch_deg, roll_deg), SIZE).solve()
    assert math.degrees(found.pitch) == pytest.approx(pitch_deg, abs=1.5)
    assert math.degrees(found.roll) == pytest.approx(roll_deg, abs=0.7)
    assert math.exp(found.log_focal) == pytest.approx(focal_of(FOV_DEG) / SIZE[0], rel=0.08)


@pytest.mark.slow
def test_known_focal_length_is_kept():
    known = math.log(focal_of(FOV_DEG) / SIZE[0])
    found = Mixture(lines(-15.0, 0.0), SIZE, CameraPrior((known, 1e-3))).solve()
    assert found.log_focal == pytest.approx(known, abs=0.01)
    assert math.degrees(found.pitch) == pytest.approx(-15.0, abs=1.0)


@pytest.mark.slow
def test_clutter_alone_gives_large_errors():
    found = Mixture(lines(-15.0, 0.0, clutter=40, upright=0, level=0), SIZE).solve()
    assert math.degrees(math.sqrt(found.covariance[0, 0])) > 3.0


@pytest.mark.slow
def test_errors_shrink_with_more_lines():
    few = Mixture(lines(-15.0, 0.0, upright=6, level=8), SIZE).solve()
    many = Mixture(lines(-15.0, 0.0, upright=40, level=80), SIZE).solve()
    assert many.covariance[0, 0] < few.covariance[0, 0]


def test_picture_without_an_edge_has_no_segment():
    assert len(find_segments(np.full((120, 200), 90, np.uint8)).ends) == 0


def test_dark_margin_of_a_scan_is_no_line_of_the_scene():
    luma = np.full((512, 768), 20, np.uint8)
    luma[3:-3, 4:-4] = 170
    cv2.line(luma, (200, 120), (560, 400), 60, 3, cv2.LINE_AA)
    found = find_segments(luma)
    vectors = found.ends[:, 1] - found.ends[:, 0]
    assert len(vectors) and (abs(vectors) > 20).all()


def test_an_edge_that_several_pictures_show_counts_once():
    """Pictures of one scene are not independent: what they share tells no more than one of them."""
    rng = np.random.default_rng(8)
    starts = np.array([[60.0, 50.0], [400.0, 90.0], [240.0, 300.0]])
    ends = np.stack([starts, starts + [[150.0, 20.0], [-10.0, 120.0], [170.0, -60.0]]], axis=1)
    one = Segments(ends, np.full(3, 0.35))
    again = Segments(ends + rng.normal(0.0, 0.3, ends.shape), np.full(3, 0.35))
    other = Segments(ends[:1] + [0.0, 40.0], np.full(1, 0.6))
    assert len(pooled([one, again], 10).ends) == 3
    found = pooled([one, again, other], 10)
    assert len(found.ends) == 4 and sorted(found.error_px) == [0.35, 0.35, 0.35, 0.6]
    assert (np.diff(found.lengths) <= 0).all()
    assert len(pooled([one, other], 2).ends) == 2


def test_lines_of_a_chequered_floor_run_across_its_tiles():
    tiles = np.indices((8, 12)).sum(axis=0) % 2
    floor = np.kron(tiles, np.full((40, 40), 120)).astype(np.uint8) + 60
    found = find_segments(np.ascontiguousarray(floor))
    assert np.median(found.lengths[:10]) > 300.0


def test_one_direction_does_not_stand_for_all():
    luma = np.full((600, 600), 90, np.uint8)
    for row in range(10, 590, 5):
        luma[row : row + 2, 20:580:80] = 200
        luma[row : row + 2, 20:60] = 200
    luma[:, 300:303] = 30
    found = find_segments(luma)
    assert len(found.ends) <= 120
    assert any(abs(ends[1, 0] - ends[0, 0]) < 2.0 for ends in found.ends)


def test_picture_without_lines_leaves_what_is_known_beforehand():
    found = Mixture(Segments(np.zeros((0, 2, 2)), np.zeros(0)), SIZE).solve()
    assert math.degrees(math.sqrt(found.covariance[0, 0])) > 5.0
    assert math.sqrt(found.covariance[2, 2]) > 0.3


def test_chequered_floor_seen_from_above_gives_the_camera():
    turn = rotation(math.radians(30.0), math.radians(-25.0), math.radians(1.0))
    starts, ends = [], []
    for place in np.arange(-4.0, 4.1, 0.5):
        for first, last in (
            ((place, -8.0), (place, 0.0)),
            ((-4.0, place - 4.0), (4.0, place - 4.0)),
        ):
            line = np.array([(x, -1.5, z) for x, z in (first, last)])
            share = np.linspace(0.0, 1.0, 400)[:, None]
            pixels, seen = project(
                line[0] + share * (line[1] - line[0]), turn, np.zeros(3), FOV_DEG
            )
            if seen.sum() > 20:
                starts.append(pixels[seen][0])
                ends.append(pixels[seen][-1])
    both = np.stack([np.array(starts), np.array(ends)], axis=1)
    found = Mixture(Segments(both, np.full(len(both), 0.5)), SIZE).solve()
    assert math.degrees(found.pitch) == pytest.approx(-25.0, abs=1.0)
    assert math.degrees(found.roll) == pytest.approx(1.0, abs=0.7)
    assert math.exp(found.log_focal) == pytest.approx(focal_of(FOV_DEG) / SIZE[0], rel=0.05)


def test_defocused_edge_is_found_once():
    ramp = 255.0 / (1.0 + np.exp(-(np.arange(960) - 480) / 6.0))
    luma = np.broadcast_to(ramp, (512, 960)).astype(np.uint8)
    found = find_segments(np.ascontiguousarray(luma))
    upright = [ends for ends in found.ends if abs(ends[1, 0] - ends[0, 0]) < 3.0]
    assert upright
    assert abs(np.mean([ends[:, 0].mean() for ends in upright]) - 480.5) < 4.0
