"""Shots on their way through a farm: fit, chunks, merge, each a task that any worker can do."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from nlens_video.chunk_mark import ChunkMark
from nlens_video.errors import UsageError
from nlens_video.farm.job import Prepared, check, length_of
from nlens_video.farm.merge import Merged
from nlens_video.farm.store import Store
from nlens_video.farm.workbench import Workbench
from nlens_video.settings import Settings


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """A run that is to be made in chunks.

    Attributes:
        settings: the run, its paths absolute.
        store: where fit and chunks lie.
        chunk_s: length of a chunk, > 0 [s].

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
        file: what a worker that dies may leave half-written, or None.
        done: called here with what it returned.
        follows: whether it waits for what the tasks beside it write: it may be done while they are
            at work, by somebody else than a worker, or after them.
    """

    words: str
    work: Callable[..., Any]
    arguments: tuple[object, ...]
    file: Path | None = None
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

    A shot of one chunk is rendered at once: nothing goes through the store, nothing is merged.

    Args:
        shot: the shot.
        progress: told of what is done.
    """
    name = shot.settings.source.spec
    (counted,) = yield [
        Task(f"the fit of {name}", Workbench.prepare, (shot.settings, shot.store, shot.chunk_s))
    ]
    prepared = cast("Prepared", counted)
    missing = [m for m in prepared.marks if not shot.store.has(m.file_name)]
    frames = {mark: length_of(mark, prepared.frames) for mark in prepared.marks}
    progress.counted(prepared.frames, prepared.frames - sum(frames[mark] for mark in missing))
    if len(prepared.marks) == 1 and missing:
        (whole,) = yield [_whole(prepared, shot.store, progress)]
        return cast("Merged", whole)
    merging = Task(
        f"the merge of {name}",
        Workbench.merge,
        (shot.settings.source, prepared.marks, shot.store, shot.settings.output),
        None if shot.settings.output is None else Path(shot.settings.output.spec),
        follows=True,
    )
    rendering = [_chunk(prepared, mark, shot.store, frames[mark], progress) for mark in missing]
    *_, merged = yield [*rendering, merging]
    return cast("Merged", merged)


def _whole(prepared: Prepared, store: Store, progress: Progress) -> Task:
    output = prepared.settings.output
    return Task(
        prepared.settings.source.spec,
        Workbench.whole,
        (prepared.settings, prepared.fit, prepared.frames, store),
        None if output is None else Path(output.spec),
        lambda answer: progress.rendered(prepared.frames),
    )


def _chunk(
    prepared: Prepared, mark: ChunkMark, store: Store, frames: int, progress: Progress
) -> Task:
    return Task(
        f"frames {mark.first} to {mark.end} of {prepared.settings.source.spec}",
        Workbench.chunk,
        (prepared.settings, prepared.fit, mark, store),
        store.local / mark.file_name,
        lambda answer: progress.rendered(frames),
    )
