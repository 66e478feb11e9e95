"""The thread that draws goes on whatever a picture comes to."""

import queue
from types import SimpleNamespace

import pytest

from nlens_video.core.errors import SceneError
from nlens_video.studio.previews import Previews, Superseded, Wish


class Stage:
    """Stands in for the studio's stage; gives each of `outcomes` in turn, and raises errors."""

    def __init__(self, *outcomes):
        self.outcomes, self.calls = list(outcomes), []

    def inspect(self, settings):
        outcome = self.outcomes.pop(0)
        if isinstance(outcome, Exception):
            raise outcome
        return SimpleNamespace(drawn=lambda: (outcome, {}))

    def forget(self):
        self.calls.append("forget")

    def close(self):
        self.calls.append("close")


@pytest.fixture
def started():
    """Starts the thread on a stage; returns a function that asks it and waits for its answer."""
    running = []

    def start(stage):
        shot = SimpleNamespace(settings=lambda tables: tables)
        running.append(Previews(shot, stage, print))
        answers = queue.Queue()

        def ask(number):
            running[-1].ask("page", Wish(number, {}, 0, "focus"), answers.put)
            return answers.get(timeout=10)

        return ask

    yield start
    for previews in running:
        previews.close()
        assert not previews._thread.is_alive()


def test_page_is_told_of_an_unexpected_fault_and_gets_the_next_picture(started, capfd):
    stage = Stage(IndexError("list index out of range"), b"picture")
    ask = started(stage)
    said = ask(1).said
    assert said["error"] == "unexpected: IndexError: list index out of range"
    assert (said["number"], said["kind"]) == (1, "focus")
    assert "Traceback" in capfd.readouterr().err
    assert stage.calls == ["forget"]
    assert ask(2).picture == b"picture"


def test_fault_while_what_is_half_made_is_freed_is_no_end(started):
    stage = Stage(KeyError("a"), b"picture")
    stage.forget = lambda: stage.missing
    ask = started(stage)
    assert "KeyError" in ask(1).said["error"]
    assert ask(2).picture == b"picture"


def test_expected_fault_is_told_as_it_is_and_frees_nothing(started, capfd):
    stage = Stage(SceneError("no object"))
    assert started(stage)(1).said["error"] == "no object"
    assert stage.calls == []
    assert capfd.readouterr().err == ""


def test_picture_that_is_given_up_is_drawn_later(started):
    stage = Stage(Superseded(), b"picture")
    assert started(stage)(1).picture == b"picture"
    assert stage.calls == []
