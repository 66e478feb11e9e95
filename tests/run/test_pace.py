"""Checks of the plate look less and less often while nothing changes."""

import pytest

from nlens_video.run.checks.pace import Pace


def looks(pace, frames, rests):
    seen = []
    for index in range(frames):
        if pace.due(index):
            seen.append(index)
            pace.looked(index, rests=rests(index))
    return seen


def test_wait_doubles_up_to_the_longest_while_the_plate_rests():
    assert looks(Pace(0.04, 0.08, 0.4), 40, lambda index: index > 0) == [0, 2, 6, 14, 24, 34]


def test_change_brings_the_shortest_wait_back():
    assert looks(Pace(0.04, 0.08, 0.4), 24, lambda index: index not in (0, 14)) == [
        0, 2, 6, 14, 16, 20,
    ]  # fmt: skip


@pytest.mark.parametrize("frame_s", [0.0, 0.5])
def test_every_frame_is_due_where_frames_are_rarer_than_looks(frame_s):
    assert looks(Pace(frame_s, 0.08, 0.4), 5, lambda index: True) == [0, 1, 2, 3, 4]


def test_frames_that_were_dropped_are_made_up_for_by_the_next():
    pace = Pace(0.04, 0.08, 0.4)
    pace.looked(0, rests=False)
    assert not pace.due(1)
    assert pace.due(3)
