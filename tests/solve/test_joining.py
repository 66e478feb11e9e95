"""Segments on one line become one line."""

import numpy as np
import pytest

from nlens_video.solve.still.joining import join_segments


def pieces(count, length, gap, slope=0.2, off=0.0):
    """Pieces of a line through (100, 100), each `off` beside it in turn."""
    along = np.array([1.0, slope]) / np.hypot(1.0, slope)
    across = np.array([-along[1], along[0]])
    starts = (length + gap) * np.arange(count)
    sides = off * (-1.0) ** np.arange(count)
    first = (100.0, 100.0) + starts[:, None] * along + sides[:, None] * across
    return np.stack([first, first + length * along], axis=1)


def test_pieces_of_a_line_become_one_as_long_as_all():
    ends = pieces(6, 30.0, 10.0)
    joined, errors = join_segments(ends, np.array([0.7, 0.7, 1.4, 0.7, 0.7, 0.7]))
    assert joined.shape == (1, 2, 2)
    assert np.linalg.norm(joined[0, 1] - joined[0, 0]) == pytest.approx(230.0, abs=0.1)
    assert errors == [1.4]


def test_joined_line_averages_the_errors_of_its_pieces():
    joined, _ = join_segments(pieces(8, 30.0, 8.0, off=0.4), np.full(8, 0.7))
    vector = joined[0, 1] - joined[0, 0]
    assert len(joined) == 1
    assert vector[1] / vector[0] == pytest.approx(0.2, abs=3e-3)


def test_parallel_lines_stay_apart():
    ends = np.concatenate([pieces(2, 60.0, 10.0), pieces(2, 60.0, 10.0) + (0.0, 6.0)])
    assert len(join_segments(ends, np.full(4, 0.7))[0]) == 2


def test_lines_that_cross_stay_apart():
    ends = np.concatenate([pieces(1, 80.0, 0.0, slope=0.2), pieces(1, 80.0, 0.0, slope=0.6)])
    assert len(join_segments(ends, np.full(2, 0.7))[0]) == 2


def test_wide_gap_is_not_bridged():
    assert len(join_segments(pieces(2, 30.0, 200.0), np.full(2, 0.7))[0]) == 2


def test_one_segment_and_none_stay_as_they_are():
    for count in (0, 1):
        ends = pieces(count, 30.0, 5.0)
        joined, errors = join_segments(ends, np.full(count, 0.7))
        assert joined.shape == (count, 2, 2)
        assert len(errors) == count
