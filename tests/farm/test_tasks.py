"""What a farm does next: tasks of shots in their order, chunks in pieces, workers that are lost."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from nlens_video.core.errors import InputError, NlensError
from nlens_video.core.settings import (
    ObjectSettings,
    OutputSettings,
    Settings,
    SourceSettings,
)
from nlens_video.farm.job import Prepared, ranges
from nlens_video.farm.merge import Merged
from nlens_video.farm.store import Folder
from nlens_video.farm.tasks import (
    Progress,
    Shot,
    Task,
    TaskQueue,
    plan,
)
from nlens_video.farm.worker import Worker
from nlens_video.video.atomic_files import partial_name
from nlens_video.video.chunk_queue import ChunkMark

MERGED = Merged(output="out.mkv", frames=1, chunks=1, notes=())


def settings():
    return Settings(
        source=SourceSettings(spec="in.mp4"),
        scene=ObjectSettings(glb=Path("anim.glb")),
        output=OutputSettings(spec="out.mkv"),
    )


class There(Folder, frozen=True):
    """A folder in which chunks with these first frames are said to be."""

    firsts: tuple[int, ...] = ()

    def has(self, name):
        return any(f"-{first:08d}-" in name for first in self.firsts)


def planned(chunk_s, frames, tmp_path, there=(), rate=24):
    """Tasks after the fit, the seconds that it was asked for, and what progress was told."""
    store = There(tmp_path, firsts=there)
    told = []
    progress = Progress(1, lambda done, total: told.append((done, total)))
    shot = plan(Shot(settings=settings(), store=store, chunk_s=chunk_s), progress)
    (fit,) = next(shot)
    marks = tuple(
        ChunkMark(key="0" * 16, plate="1" * 16, first=first, end=end)
        for first, end in ranges(frames, max(1, round(fit.arguments[2] * rate)))
    )
    prepared = Prepared(fit=None, marks=marks, frames=frames, frame_s=1 / rate)
    return shot.send([prepared]), fit.arguments[2], told


def spans(task):
    return [(mark.first, mark.end) for mark in task.arguments[2]]


def test_chunk_is_split_into_pieces_of_two_seconds(tmp_path):
    (first, second, merging), piece_s, told = planned(10.0, 300, tmp_path)
    assert piece_s == 2.0
    assert spans(first) == [(0, 48), (48, 96), (96, 144), (144, 192), (192, 240)]
    assert spans(second) == [(240, 288), (288, 300)]
    assert [len(task.files) for task in (first, second, merging)] == [5, 2, 1]
    assert merging.follows and len(merging.arguments[1]) == 7
    assert told == [(0, 300)]
    second.done(None)
    assert told[-1] == (60, 300)


def test_chunk_shorter_than_two_seconds_is_one_piece(tmp_path):
    tasks, piece_s, _ = planned(0.5, 30, tmp_path)
    assert piece_s == 0.5
    assert [spans(task) for task in tasks[:-1]] == [[(0, 12)], [(12, 24)], [(24, 30)]]


@pytest.mark.parametrize(
    ("rate", "chunk_s", "frames"), [(1, 3.0, 4), (0.25, 10.0, 2), (0.1, 10, 1)]
)
def test_piece_of_a_chunk_is_at_least_one_frame_long(tmp_path, rate, chunk_s, frames):
    tasks, _, _ = planned(chunk_s, 20, tmp_path, rate=rate)
    first = spans(tasks[0])
    assert first[-1][1] - first[0][0] == frames


def test_only_missing_pieces_are_rendered(tmp_path):
    there = (0, 96, 240, 288)
    tasks, _, told = planned(10.0, 300, tmp_path, there)
    assert [spans(task) for task in tasks[:-1]] == [[(48, 96), (144, 192), (192, 240)]]
    assert told == [(156, 300)]
    tasks[0].done(None)
    assert told[-1] == (300, 300)


def test_shot_of_one_chunk_is_one_task_unless_some_pieces_exist(tmp_path):
    (whole,), _, _ = planned(10.0, 240, tmp_path)
    assert whole.work is Worker.whole
    rendering, merging = planned(10.0, 240, tmp_path, (48,))[0]
    assert (rendering.work, merging.work) == (Worker.chunk, Worker.merge)
    assert spans(rendering) == [(0, 48), (96, 144), (144, 192), (192, 240)]


def task(words, **more):
    return Task(words, lambda bench: None, (), **more)


def steps(*lists):
    """A plan that wants these lists of tasks done, one after the other."""
    for tasks in lists:
        answers = yield tasks
        assert len(answers) == len(tasks)
    return MERGED


def test_earlier_shots_go_first_and_a_merge_waits_for_its_chunks():
    queue = TaskQueue([steps([task("a")]), steps([task("b"), task("c"), task("d", follows=True)])])
    queue.begin(1)
    assert queue.waiting
    a = queue.next()
    assert a.task.description == "a" and not queue.waiting
    queue.begin(len(queue))
    b, c = queue.next(), queue.next()
    assert (b.task.description, c.task.description, queue.waiting) == ("b", "c", False)
    for answered in (b, a, c):
        assert not queue.waiting
        queue.answered(answered, "done")
    assert queue.next_follower() is None  # it is everybody's now
    queue.answered(queue.next(), "done")
    assert queue.results() == [MERGED, MERGED]


def test_waiting_merge_is_given_out_once():
    queue = TaskQueue([steps([task("a"), task("b", follows=True)])])
    queue.begin(1)
    follower = queue.next_follower()
    assert (
        follower is not None and follower.task.description == "b" and queue.next_follower() is None
    )
    queue.answered(queue.next(), None)
    assert not queue.waiting
    queue.answered(follower, None)
    assert queue.results() == [MERGED]


def test_failed_shot_drops_its_remaining_tasks_and_others_continue():
    broken = InputError("in.mp4: no such file")
    queue = TaskQueue([steps([task("a"), task("b"), task("c", follows=True)]), steps([task("d")])])
    queue.begin(2)
    a = queue.next()
    queue.answered(a, broken)
    assert not queue.wants(a) and queue.next_follower() is None
    assert queue.waiting
    d = queue.next()
    assert d.task.description == "d"
    queue.answered(d, None)
    assert not queue.waiting and queue.results() == [broken, MERGED]


def test_task_of_a_lost_worker_is_tried_three_times_and_its_partial_files_are_removed(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    files = tuple(tmp_path / name for name in ("one.nut", "two.nut"))
    ours = f"-{os.getpid()}."
    left = [Path(str(partial_name(file)).replace(ours, f"-{gone.pid}.")) for file in files]
    queue = TaskQueue([steps([task("frames 0 to 9", files=files)])])
    queue.begin(1)
    for _ in range(3):
        for path in left:
            path.write_bytes(b"half")
        queue.lost(queue.next(), "it died")
        assert not any(path.exists() for path in left)
    assert not queue.waiting
    (failed,) = queue.results()
    assert isinstance(failed, NlensError)
    assert str(failed).startswith("frames 0 to 9: 3 workers were lost over it (it died); ")
