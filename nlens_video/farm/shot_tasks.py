"""Shots on their way through a farm: fit, chunks, merge, each a task that any worker can do."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from nlens_video.core.errors import UsageError
from nlens_video.core.settings import Settings
from nlens_video.farm.job import PIECE_S, Prepared, check, length_of
from nlens_video.farm.merge import Merged
from nlens_video.farm.store import Store
from nlens_video.farm.worker import Worker
from nlens_video.video.chunks.chunk_id import ChunkMark


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """A run that is to be made in chunks.

    Attributes:
        settings: the run, its paths absolute.
        store: where fit and chunks lie.
        chunk_s: length of a chunk, what a worker is given at a time, > 0 [s].

    Raises:
        UsageError: a range, a report or the like is asked for, which belong to single runs.
    """

    settings: Settings
    store: Store
    chunk_s: float

    def __post_init__(self) -> None:
        if self.settings.output is None:
            raise UsageError("no output was named")
        check(self.settings)


@dataclass(frozen=True, slots=True)
class Task:
    """Something for one worker.

    Attributes:
        words: what it is, for errors and notes.
        work: a method of `Workbench`, so that another process finds it by its name.
        arguments: of it; they travel, and so does what it returns.
        files: what a worker that dies may leave half-written.
        done: called here with what it returned.
        follows: whether it waits for what the tasks beside it write: it may be done while they are
            at work, by somebody else than a worker, or after them.
    """

    words: str
    work: Callable[..., Any]
    arguments: tuple[object, ...]
    files: tuple[Path, ...] = ()
    done: Callable[[Any], None] = lambda answer: None
    follows: bool = False


Plan = Generator[list[Task], list[object], Merged]
"""Gives tasks that may run at the same time, takes their answers, and ends with the result."""


class Progress:
    """Frames rendered of all shots; the total is known once every plate was counted."""

    def __init__(self, shots: int, on_progress: Callable[[int, int | None], None]) -> None:
        self._uncounted = shots
        self._on_progress = on_progress
        self._done = self._total = 0

    def counted(self, frames: int, done: int) -> None:
        """A plate has so many frames, of which some were there."""
        self._uncounted -= 1
        self._total += frames
        self.rendered(done)

    def rendered(self, frames: int) -> None:
        """So many more."""
        self._done += frames
        self._on_progress(self._done, None if self._uncounted else self._total)


def plan(shot: Shot, progress: Progress) -> Plan:
    """The tasks of a shot: one that counts and fits, one for each missing chunk, one that merges.

    A chunk lies in the store as pieces of some two seconds, so that the merge follows close behind
    and little is lost with a worker. A shot of one chunk is rendered at once: nothing goes through
    the store, nothing is merged.

    Args:
        shot: the shot.
        progress: told of what is done.
    """
    name = shot.settings.source.spec
    pieces = max(1, round(shot.chunk_s / PIECE_S))
    asked = (shot.settings, shot.store, shot.chunk_s / pieces)
    (counted,) = yield [Task(f"the fit of {name}", Worker.prepare, asked)]
    prepared = cast("Prepared", counted)
    marks = prepared.marks
    names = shot.store.there(mark.file_name for mark in marks)
    there = {mark for mark in marks if mark.file_name in names}
    progress.counted(prepared.frames, sum(length_of(mark, prepared.frames) for mark in there))
    longest = max((length_of(mark, prepared.frames) for mark in marks), default=1)
    pieces = max(1, round(shot.chunk_s / (longest * prepared.frame_s)))  # frames may be seconds
    chunks = [marks[at : at + pieces] for at in range(0, len(marks), pieces)]
    missing = [tuple(mark for mark in chunk if mark not in there) for chunk in chunks]
    if len(chunks) == 1 and not there:
        (whole,) = yield [_whole(prepared, shot.store, progress)]
        return cast("Merged", whole)
    merging = Task(
        f"the merge of {name}",
        Worker.merge,
        (shot.settings.source, marks, shot.store, shot.settings.output),
        _result(shot.settings),
        follows=True,
    )
    rendering = [_chunk(prepared, chunk, shot.store, progress) for chunk in missing if chunk]
    *_, merged = yield [*rendering, merging]
    return cast("Merged", merged)


def _whole(prepared: Prepared, store: Store, progress: Progress) -> Task:
    return Task(
        prepared.settings.source.spec,
        Worker.whole,
        (prepared.settings, prepared.fit, prepared.frames, store),
        _result(prepared.settings),
        lambda answer: progress.rendered(prepared.frames),
    )


def _chunk(
    prepared: Prepared, pieces: tuple[ChunkMark, ...], store: Store, progress: Progress
) -> Task:
    frames = sum(length_of(mark, prepared.frames) for mark in pieces)
    return Task(
        f"frames {pieces[0].first} to {pieces[-1].end} of {prepared.settings.source.spec}",
        Worker.chunk,
        (prepared.settings, prepared.fit, pieces, store),
        tuple(store.local / mark.file_name for mark in pieces),
        lambda answer: progress.rendered(frames),
    )


def _result(settings: Settings) -> tuple[Path, ...]:
    return () if settings.output is None else (Path(settings.output.spec),)
