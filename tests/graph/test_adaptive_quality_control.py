"""The controller of adaptive quality on simulated frame times."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.graph.adaptive_quality import BudgetControl

LEVELS = ("standard", "realtime", "draft")
COST = {"standard": 100.0, "realtime": 40.0, "draft": 30.0}


def control(budget_ms=120.0):
    return BudgetControl(budget_ms, LEVELS, 1 / 25)


def drive(controller, load, frames, first=0, lag=3):
    """Feed times of `COST` by `load(frame)`; results come `lag` frames late, as in a pipeline."""
    waiting, times, levels = [], [], []
    for frame in range(first, first + frames):
        level = controller.level
        waiting.append((frame, level, COST[level] * load(frame)))
        if len(waiting) > lag:
            controller.observe(*waiting.pop(0))
        levels.append(level)
        times.append(COST[level] * load(frame))
    return times, levels


def test_frames_within_the_budget_keep_the_quality_level():
    controller = control()
    drive(controller, lambda frame: 1.1 + 0.05 * np.sin(frame), 500)
    assert controller.steps == [] and controller.level == "standard"


def test_single_slow_frames_keep_the_quality_level():
    controller = control()
    drive(controller, lambda frame: 3.0 if frame % 6 == 0 else 1.0, 500)
    assert controller.steps == []


def test_sustained_load_lowers_the_level_within_a_second_and_keeps_95_percent_in_budget():
    controller = control()
    times, levels = drive(controller, lambda frame: 1.0 if frame < 100 else 2.0, 600)
    assert [step.level for step in controller.steps] == ["realtime"]
    assert levels.index("realtime") - 100 < 25
    assert np.mean(np.array(times) <= 120.0) >= 0.95


def test_level_is_lowered_one_step_at_a_time_down_to_the_last():
    controller = control(budget_ms=1.0)
    drive(controller, lambda frame: 1.0, 300)
    assert [step.level for step in controller.steps] == ["realtime", "draft"]


def test_level_is_raised_only_after_a_long_time_within_budget():
    controller = control()
    _, levels = drive(controller, lambda frame: 2.0 if 50 <= frame < 100 else 0.8, 400)
    assert [step.level for step in controller.steps] == ["realtime", "standard"]
    assert levels.index("standard", 100) - 100 >= 75 - 8


def test_level_is_not_raised_without_headroom_for_the_next_one():
    controller = control()
    # standard would need 110 of 120 ms
    drive(controller, lambda frame: 2.0 if frame < 40 else 1.1, 800)
    assert [step.level for step in controller.steps] == ["realtime"]


def test_each_failed_raise_doubles_the_wait_for_the_next():
    controller = control()
    since, level = 0, controller.level
    for frame in range(6000):
        since = since + 1 if controller.level == level else 0
        level = controller.level
        # `realtime` grows cheaper when nothing is gained by it, so that the prediction is wrong
        cost = {"standard": 150.0, "realtime": 60.0 if since < 20 else 25.0, "draft": 20.0}
        controller.observe(frame, level, cost[level])
    ups = [step.frame for step in controller.steps if step.level == "standard"]
    gaps = np.diff(ups)
    assert len(gaps) >= 3 and (gaps[1:] > 1.5 * gaps[:-1]).all()


def test_times_of_frames_from_a_former_level_are_ignored():
    controller = control(budget_ms=50.0)
    for frame in range(8):
        controller.observe(frame, "standard", 100.0)
    assert controller.level == "realtime"
    for frame in range(8, 40):
        controller.observe(frame, "standard", 100.0)
    assert controller.level == "realtime"


@given(st.lists(st.floats(0.1, 4.0), min_size=20, max_size=300))
def test_control_is_deterministic_and_moves_to_neighbouring_levels_only(loads):
    runs = []
    for _ in range(2):
        controller = control()
        drive(controller, lambda frame: loads[frame], len(loads))
        runs.append(controller.steps)
    assert runs[0] == runs[1]
    at = [0, *(LEVELS.index(step.level) for step in runs[0])]
    assert (np.abs(np.diff(at)) == 1).all()
    frames = [step.frame for step in runs[0]]
    assert (np.diff(frames) >= 8).all()
