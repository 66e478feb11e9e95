"""Observations are kept by frame, in memory or on disk."""

import numpy as np

from nlens_video.solve.points.observations import Observations


def kept(*frames):
    found = Observations()
    for numbers, pixels in frames:
        found.add(np.array(numbers, np.int64), np.array(pixels, np.float32).reshape(-1, 2))
    return found


def test_frames_are_read_back_in_any_order():
    seen = kept(([3, 5], [[1, 2], [3, 4]]), ([], []), ([5], [[7, 8]]))
    assert len(seen) == 3
    assert seen.frame(2)[1].tolist() == [[7.0, 8.0]]
    assert seen.frame(0)[0].tolist() == [3, 5]
    assert seen.frame(1)[0].tolist() == []


def test_table_holds_the_points_that_enough_frames_show():
    seen = kept(([3, 5], [[1, 2], [3, 4]]), ([9], [[0, 0]]), ([9, 5], [[5, 6], [7, 8]]))
    table = seen.table([0, 2], fewest=2)
    assert table.names.tolist() == [5]
    assert table.numbers.tolist() == [0, 0]
    assert table.places.tolist() == [0, 1]
    assert table.pixels.tolist() == [[3.0, 4.0], [7.0, 8.0]]
    assert table.at(1)[1].tolist() == [[7.0, 8.0]]


def test_frames_beyond_what_memory_holds_are_found_again():
    seen = Observations()
    for frame in range(2500):
        seen.add(np.arange(700), np.full((700, 2), frame, np.float32))
    assert seen.frame(1234)[1][0].tolist() == [1234.0, 1234.0]
