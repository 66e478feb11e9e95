"""Points followed through pictures that move in a known way."""

import cv2
import numpy as np
import pytest

from nlens_video.solve.tracks import Tracker


def texture(seed=0, size=(300, 420)):
    rng = np.random.default_rng(seed)
    wide = cv2.GaussianBlur(rng.uniform(0, 255, size).astype(np.float32), (0, 0), 2.0)
    return cv2.normalize(wide, None, 0, 255, cv2.NORM_MINMAX)


def warped(matrix):
    found = cv2.warpAffine(texture(), np.float32(matrix), (320, 200), flags=cv2.INTER_CUBIC)
    return found.clip(0, 255).astype(np.uint8)


def shifted(step, frames=8):
    """Pictures of smooth noise that moves by a step (columns, rows) each frame [px]."""
    for n in range(frames):
        yield warped([[1, 0, n * step[0] - 50], [0, 1, n * step[1] - 50]])


def followed(pictures):
    tracker = Tracker()
    for picture in pictures:
        tracker.add(picture)
    return tracker


def whole(tracker):
    """First and last positions of the points that all frames show."""
    frames = range(len(tracker.observations))
    table = tracker.observations.table(list(frames), fewest=len(frames))
    return table.at(0)[1], table.at(len(frames) - 1)[1]


def test_points_follow_the_picture_to_a_twentieth_of_a_pixel():
    first, last = whole(followed(shifted((1.3, -0.7))))
    assert len(first) > 50
    assert abs(np.median(last - first, axis=0) - (7 * 1.3, -7 * 0.7)).max() < 0.05


def test_points_do_not_drift_while_the_picture_grows():
    frames = 40
    scales = [1.01**n for n in range(frames)]
    pictures = (warped([[s, 0, 160 - 210 * s], [0, s, 100 - 150 * s]]) for s in scales)
    first, last = whole(followed(pictures))
    expected = (first - 0.5 - (160, 100)) * scales[-1] + (160, 100) + 0.5
    assert len(first) > 20
    assert np.median(np.linalg.norm(last - expected, axis=1)) < 0.15


def test_points_that_leave_the_frame_end():
    tracker = followed(shifted((12.0, 0.0)))
    frames = [tracker.observations.frame(n) for n in range(8)]
    assert max(pixels[:, 0].max() for _, pixels in frames) <= 320.0
    assert not set(frames[0][0]) <= set(frames[7][0])


def test_points_that_are_covered_end():
    pictures = list(shifted((1.0, 0.0)))
    for picture in pictures[4:]:
        picture[60:140, 100:200] = 128
    tracker = followed(pictures)
    _, pixels = tracker.observations.frame(7)
    inside = (abs(pixels - (150, 100)) < (40, 30)).all(axis=1)
    assert not inside.any()


def test_flat_pictures_have_no_points():
    tracker = followed(np.full((3, 200, 320), 128, np.uint8))
    assert not tracker.current
    assert not tracker.moves


@pytest.mark.parametrize(("step", "moves"), [((0.0, 0.0), False), ((0.4, 0.0), True)])
def test_still_pictures_are_told_from_moving_ones(step, moves):
    assert followed(shifted(step, frames=12)).moves is moves


def test_thing_that_moves_over_a_still_picture_does_not_move_the_camera():
    pictures = list(shifted((0.0, 0.0), frames=12))
    for n, picture in enumerate(pictures):
        picture[50:110, 20 + 8 * n : 80 + 8 * n] = texture(1)[:60, :60].astype(np.uint8)
    assert not followed(pictures).moves


def test_things_that_move_over_half_of_a_still_and_noisy_picture_do_not_move_the_camera():
    rng = np.random.default_rng(3)
    pictures = list(shifted((0.0, 0.0), frames=20))
    waves = texture(2, (300, 600)).astype(np.uint8)
    for n, picture in enumerate(pictures):
        picture[:, 90:260] = waves[:200, 5 * n : 5 * n + 170]
        noisy = picture + rng.normal(0.0, 4.0, picture.shape)
        picture[:] = np.clip(noisy, 0, 255).astype(np.uint8)
    assert not followed(pictures).moves


def test_camera_that_moves_towards_a_point_moves_though_what_is_far_stays():
    scales = [1.004**n for n in range(30)]
    assert followed(warped([[s, 0, 160 - 210 * s], [0, s, 100 - 150 * s]]) for s in scales).moves


def test_camera_that_begins_to_move_late_moves():
    pictures = [warped([[1, 0, -50 - 2.0 * max(0, n - 30)], [0, 1, -50]]) for n in range(40)]
    assert followed(pictures).moves


def test_what_is_lifted_over_most_of_a_still_picture_for_a_moment_does_not_move_the_camera():
    pictures = list(shifted((0.0, 0.0), frames=60))
    for n in range(40, 45):
        still = pictures[n].copy()
        pictures[n][:, 75:] = np.roll(still, -6 * (n - 39), axis=0)[:, 75:]
    lifted = followed(pictures)
    assert lifted._left > 2
    assert not lifted.moves


def test_camera_that_turns_for_a_moment_moves():
    way = [2.0 * min(max(0, n - 40), 5) for n in range(60)]
    pictures = [warped([[1, 0, -50 - one], [0, 1, -50]]) for one in way]
    assert followed(pictures).moves
