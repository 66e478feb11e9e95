"""Long streams: the suite runs a short one, `stream.py` the long one."""

import json
from functools import cache

from hard.catalogue import PAGE, Outcome, at_least, at_most, case, exactly
from hard.drawing import OURS, plot
from hard.endurance import stream

RECORD = PAGE.parent / "hard" / "endurance.json"
SHORT = 600


@cache
def _long():
    return json.loads(RECORD.read_text())


def _outcome(run, frames, what, figures, *, settled=True):
    memory = run["memory"]

    def draw(axes):
        axes.plot(range(len(memory)), memory, color=OURS, label=what)
        axes.set_ylim(0, 1.2 * max(memory))

    growth = at_most("memory, growth from the second fifth to the last [MB]",
                     stream.growth_mb(memory), 8.0)  # fmt: skip
    measured = (exactly("frames", run["frames"], frames), *figures)
    return Outcome(
        (*measured, growth) if settled else measured,
        lambda: plot(draw, x="sample over the run", y="memory [MB]"),
    )


def _of_loop(run, frames):
    return _outcome(run, frames, "a loop through the live compositor", (
        at_least("times that the same moment came round", run["rounds"], frames // 64),
        exactly("of these, composites that differ in any bit", run["rounds that differ"], 0),
        exactly("drift of the lens that was found, share", run["slope drift"], 0.0),
    ))  # fmt: skip


def _of_file(run, frames):
    figures = (exactly("times of frames, off by ticks of 1 / 30000 s", run["ticks off"], 0.0),)
    # a short run still loads libraries: `tests/run/test_memory.py` compares two lengths
    return _outcome(run, frames, "the command line", figures, settled=frames > SHORT)


@case
def test_live_loop_of_600_frames():
    """600 noisy frames of a live loop: the same moment gives the same bits, the lens stays."""
    return _of_loop(stream.loop(SHORT), SHORT)


@case
def test_file_of_600_frames():
    """600 frames at 30000/1001 a second: every time is exact."""
    return _of_file(stream.file(SHORT), SHORT)


# Recorded runs: cases of the page, not tests.


@case
def live_loop_of_100_000_frames():
    """The same over 100 000 frames, as `tests/hard/endurance/stream.py` recorded it."""
    return _of_loop(_long()["loop"], 100_000)


@case
def file_of_100_000_frames():
    """An hour of frames, likewise recorded: no tick is lost, only the file's index grows."""
    return _of_file(_long()["file"], 100_000)
