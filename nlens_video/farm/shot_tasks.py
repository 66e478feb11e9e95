"""Tasks of a shot: fit, chunks and merge, each of which any worker can run."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from nlens_video.core.errors import UsageError
from nlens_video.core.settings import Settings
from nlens_video.farm.job import PIECE_S, Prepared, check_chunkable, length_of
from nlens_video.farm.merge import Merged
from nlens_video.farm.store import Store
from nlens_video.farm.worker import Worker
from nlens_video.video.chunks.chunk_id import ChunkMark


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
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
        if self.settings.output is None:
            raise UsageError("no output was named")
        check_chunkable(self.settings)


@dataclass(frozen=True, slots=True)
class Task:
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
    arguments = (shot.settings, shot.store, shot.chunk_s / pieces)
    (counted,) = yield [Task(f"the fit of {name}", Worker.prepare, arguments)]
    prepared = cast("Prepared", counted)
    marks = prepared.marks
    names = shot.store.existing(mark.file_name for mark in marks)
    existing = {mark for mark in marks if mark.file_name in names}
    progress.counted(prepared.frames, sum(length_of(mark, prepared.frames) for mark in existing))
    longest = max((length_of(mark, prepared.frames) for mark in marks), default=1)
    pieces = max(1, round(shot.chunk_s / (longest * prepared.frame_s)))  # frames may last seconds
    chunks = [marks[at : at + pieces] for at in range(0, len(marks), pieces)]
    missing = [tuple(mark for mark in chunk if mark not in existing) for chunk in chunks]
    if len(chunks) == 1 and not existing:
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
