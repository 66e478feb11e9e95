"""A killed run leaves no damaged result, and the next run resumes it."""

import pytest
from hard.faults.kills import Executioner, make_shot

pytestmark = pytest.mark.needs_gl


def test_killed_run_leaves_no_result_and_a_playable_temporary_file(tmp_path):
    executioner = Executioner(make_shot(tmp_path / "shot"), 3)
    for _ in range(3):
        executioner.kill_keeping()
    executioner.finish()
    tally = executioner.tally
    assert (tally.broken, tally.strange, tally.unplayable) == (0, [], 0)


def test_resumed_killed_run_gives_the_frames_of_an_undisturbed_one(tmp_path):
    executioner = Executioner(make_shot(tmp_path / "shot"), 4)
    for _ in range(3):
        executioner.kill_resumable()
    executioner.finish("--resume")
    tally = executioner.tally
    assert (tally.broken, tally.strange, tally.lost) == (0, [], 0)
