"""Tasks of the farm: what a shot consists of, which task may run now, results and retries."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from pathlib import Path
from typing import Any, cast

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import NlensError
from nlens_video.core.settings import Settings
from nlens_video.farm.job import PIECE_S, Prepared, check_chunkable, length_of
from nlens_video.farm.merge import Merged
from nlens_video.farm.store import Store
from nlens_video.farm.worker import Worker
from nlens_video.video.atomic_files import remove_stale
from nlens_video.video.chunk_queue import ChunkMark

_MOST_TRIES = 3  # of one task, before its shot fails


class Shot(Struct, frozen=True, kw_only=True):
    """A run to render in chunks.

    Attributes:
        settings: the run, its paths absolute.
        store: of fit and chunks.
        chunk_s: length of a chunk, which is the work of one task, > 0 [s].

    Raises:
        UsageError: an option is given that needs a single run, such as --range or --report.
    """

    settings: Settings
    store: Store
    chunk_s: float

    def __post_init__(self) -> None:
        check_chunkable(self.settings)


class Task(Struct, frozen=True):
    """Work for one worker.

    Attributes:
        description: for errors and notes.
        work: a method of `Worker`, which pickles by its name.
        arguments: of it; they are pickled, and so is its result.
        files: that a worker may leave partly written when it dies.
        done: called in this process with its result.
        follows: whether it reads what the other tasks write: it runs beside them in this process,
            or after them.
    """

    description: str
    work: Callable[..., Any]
    arguments: tuple[object, ...]
    files: tuple[Path, ...] = ()
    done: Callable[[Any], None] = lambda answer: None
    follows: bool = False


Plan = Generator[list[Task], list[object], Merged]
"""Yields lists of tasks that may run in parallel, is sent their results, and returns the merge."""


class Progress:
    """Frames rendered of all shots; the total is known once every plate is counted."""

    def __init__(self, shots: int, on_progress: Callable[[int, int | None], None]) -> None:
        self._uncounted = shots
        self._on_progress = on_progress
        self._done = self._total = 0

    def counted(self, frames: int, done: int) -> None:
        """Add a plate of `frames` frames, `done` of which were rendered before."""
        self._uncounted -= 1
        self._total += frames
        self.rendered(done)

    def rendered(self, frames: int) -> None:
        """Add rendered frames."""
        self._done += frames
        self._on_progress(self._done, None if self._uncounted else self._total)


def plan(shot: Shot, progress: Progress) -> Plan:
    """The tasks of a shot: one that counts and fits, one for each missing chunk, one that merges.

    A chunk is stored as pieces of about two seconds, so that the merge can follow closely and a
    lost worker costs little. A shot of a single chunk is rendered directly, without a merge.

    Args:
        shot: the shot.
        progress: counts rendered frames.
    """
    name = shot.settings.source.spec
    pieces = max(1, round(shot.chunk_s / PIECE_S))
    piece_s = shot.chunk_s / pieces
    (counted,) = yield [
        Task(f"the fit of {name}", Worker.prepare, (shot.settings, shot.store, piece_s))
    ]
    prepared = cast("Prepared", counted)
    marks = prepared.marks
    names = shot.store.existing(mark.file_name for mark in marks)
    existing = {mark for mark in marks if mark.file_name in names}
    progress.counted(prepared.frames, sum(length_of(mark, prepared.frames) for mark in existing))
    longest = max((length_of(mark, prepared.frames) for mark in marks), default=1)
    pieces = max(1, round(shot.chunk_s / (longest * prepared.frame_s)))  # frames may last seconds
    chunks = [marks[at : at + pieces] for at in range(0, len(marks), pieces)]
    missing = [tuple(mark for mark in chunk if mark not in existing) for chunk in chunks]
    result = () if shot.settings.output is None else (Path(shot.settings.output.spec),)

    def rendering(pieces: tuple[ChunkMark, ...]) -> Task:
        frames = sum(length_of(mark, prepared.frames) for mark in pieces)
        return Task(
            f"frames {pieces[0].first} to {pieces[-1].end} of {name}",
            Worker.chunk,
            (shot.settings, prepared.fit, pieces, shot.store),
            tuple(shot.store.local / mark.file_name for mark in pieces),
            lambda answer: progress.rendered(frames),
        )

    if len(chunks) == 1 and not existing:
        whole = Task(
            name,
            Worker.whole,
            (shot.settings, prepared.fit, prepared.frames, shot.store),
            result,
            lambda answer: progress.rendered(prepared.frames),
        )
        (merged,) = yield [whole]
    else:
        arguments = (shot.settings.source, marks, shot.store, shot.settings.output)
        merging = Task(f"the merge of {name}", Worker.merge, arguments, result, follows=True)
        *_, merged = yield [*(rendering(chunk) for chunk in missing if chunk), merging]
    return cast("Merged", merged)


@dataclass(order=True, frozen=True, slots=True)
class QueuedTask:
    """A task of a shot, ordered by shot and number.

    Attributes:
        shot: index of the shot.
        number: index of the task among those that its plan has yielded together.
        task: the task.
    """

    shot: int
    number: int
    task: Task = field(compare=False)


@dataclass(slots=True)
class _ShotState:
    """A shot: results of the tasks that it waits for, and the task that follows the others."""

    plan: Plan
    answers: list[object]
    awaited: int = 0
    follower: QueuedTask | None = None
    notes: tuple[str, ...] = ()
    result: Merged | NlensError | None = None


class TaskQueue:
    """Tasks of shots, earlier shots first.

    Args:
        plans: of the shots; none has started yet.
    """

    def __init__(self, plans: Sequence[Plan]) -> None:
        self._shots = [_ShotState(plan, []) for plan in plans]
        self._begun = 0
        self._waiting: list[QueuedTask] = []
        self._losses: Counter[tuple[int, str]] = Counter()

    def begin(self, shots: int) -> None:
        """Start the first `shots` plans, unless they have started."""
        for number in range(self._begun, min(shots, len(self._shots))):
            self._begun = number + 1
            self._advance(number, None)

    def __len__(self) -> int:
        """Number of shots."""
        return len(self._shots)

    @property
    def waiting(self) -> bool:
        """Whether a task may run now."""
        while self._waiting and not self.wants(self._waiting[0]):
            heappop(self._waiting)
        return bool(self._waiting)

    def next(self) -> QueuedTask:
        """The next task; call only where `waiting` is true."""
        return heappop(self._waiting)

    def next_follower(self) -> QueuedTask | None:
        """A task that may run beside the unfinished tasks whose files it reads."""
        for shot in self._shots:
            if shot.follower is not None and shot.result is None:
                found, shot.follower = shot.follower, None
                return found
        return None

    def wants(self, waiting: QueuedTask) -> bool:
        """Whether a task is still needed: its shot has not failed."""
        return self._shots[waiting.shot].result is None

    def answered(self, waiting: QueuedTask, answer: object) -> None:
        """Store the result of a task, an `NlensError` where it has failed."""
        shot = self._shots[waiting.shot]
        if shot.result is not None:
            return
        if isinstance(answer, NlensError):
            shot.result = answer
            return
        waiting.task.done(answer)
        shot.answers[waiting.number] = answer
        shot.awaited -= 1
        if not shot.awaited:
            self._advance(waiting.shot, shot.answers)
        elif shot.awaited == 1 and shot.follower is not None:
            heappush(self._waiting, shot.follower)
            shot.follower = None

    def lost(self, waiting: QueuedTask, reason: str) -> None:
        """Repeat a task whose worker was lost; the third time its shot fails."""
        task = waiting.task
        for file in task.files:
            remove_stale(file)
        self._losses[waiting.shot, task.description] += 1
        if self._losses[waiting.shot, task.description] < _MOST_TRIES:
            self._shots[waiting.shot].notes += (f"{task.description}: done again ({reason})",)
            heappush(self._waiting, waiting)
            return
        error = NlensError(
            f"{task.description}: {_MOST_TRIES} workers were lost over it ({reason}); render it "
            "alone with -v to see why"
        )
        self.answered(waiting, error)

    def results(self) -> list[Merged | NlensError]:
        """Results and errors of the shots, once all tasks are done."""
        return [shot.result for shot in self._shots if shot.result is not None]

    def _advance(self, number: int, answers: list[object] | None) -> None:
        """Send the results to a shot's plan and queue its next tasks."""
        shot = self._shots[number]
        try:
            tasks = next(shot.plan) if answers is None else shot.plan.send(answers)
        except StopIteration as end:
            merged: Merged = end.value
            shot.result = replace(merged, notes=(*merged.notes, *shot.notes))
            return
        except NlensError as error:
            shot.result = error
            return
        shot.answers, shot.awaited = [None] * len(tasks), len(tasks)
        for at, task in enumerate(tasks):
            waiting = QueuedTask(number, at, task)
            if task.follows and len(tasks) > 1:
                shot.follower = waiting
            else:
                heappush(self._waiting, waiting)
