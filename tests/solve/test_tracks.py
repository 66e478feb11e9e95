"""Points followed through pictures that move in a known way."""

import cv2
import numpy as np

from nlens_video.solve.tracks import Tracker, observations


def shifted(step, frames=8, seed=0):
    """Pictures of smooth noise that moves by a step (columns, rows) each frame [px]."""
    rng = np.random.default_rng(seed)
    wide = cv2.GaussianBlur(rng.uniform(0, 255, (300, 420)).astype(np.float32), (0, 0), 2.0)
    wide = cv2.normalize(wide, None, 0, 255, cv2.NORM_MINMAX)
    for n in range(frames):
        move = np.float32([[1, 0, n * step[0] - 50], [0, 1, n * step[1] - 50]])
        yield (
            cv2.warpAffine(wide, move, (320, 200), flags=cv2.INTER_CUBIC)
            .clip(0, 255)
            .astype(np.uint8)
        )


def test_points_follow_the_picture_to_a_tenth_of_a_pixel():
    tracker = Tracker()
    for picture in shifted((1.3, -0.7)):
        tracker.add(picture)
    whole = [track for track in tracker.tracks if len(track) == 8]
    moves = np.array([track[7] - track[0] for track in whole])
    assert len(whole) > 50
    assert abs(np.median(moves, axis=0) - (7 * 1.3, -7 * 0.7)).max() < 0.1


def test_points_that_leave_the_frame_end():
    tracker = Tracker()
    for picture in shifted((12.0, 0.0)):
        tracker.add(picture)
    columns = [point[0] for track in tracker.tracks for point in track.values()]
    assert max(columns) <= 320.0
    assert any(len(track) < 8 and 7 not in track for track in tracker.tracks)


def test_flat_pictures_have_no_points():
    tracker = Tracker()
    for _ in range(3):
        tracker.add(np.full((200, 320), 128, np.uint8))
    assert tracker.tracks == []


def test_observations_name_track_place_and_position():
    tracks = [{0: np.array([1.0, 2.0]), 4: np.array([3.0, 4.0])}, {2: np.array([5.0, 6.0])}]
    numbers, places, pixels = observations(tracks, [0, 4])
    assert numbers.tolist() == [0, 0]
    assert places.tolist() == [0, 1]
    assert pixels.tolist() == [[1.0, 2.0], [3.0, 4.0]]
