"""Chunks rendered in this process, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from nlens_video.chunk_mark import ChunkMark
from nlens_video.farm.chunk import write_row
from nlens_video.settings import Settings


def render_here(
    settings: Settings, marks: Sequence[ChunkMark], folder: Path,
    on_done: Callable[[ChunkMark], None],
) -> None:  # fmt: skip
    """Render chunks; those that follow each other by one run, which starts and decodes once.

    Args:
        settings: the run.
        marks: what to render, in order.
        folder: where chunks lie.
        on_done: called with each that is done.

    Raises:
        NlensError: as `run.render`.
    """
    for row in rows(marks):
        told = _Told(row, on_done)
        write_row(settings, row, folder, told.written)
        told.rest()


class _Told:
    """Turns a count of frames into the chunks that are done."""

    def __init__(self, row: Sequence[ChunkMark], on_done: Callable[[ChunkMark], None]) -> None:
        self._first = row[0].first
        self._waiting = list(row)
        self._on_done = on_done

    def written(self, count: int, total: int | None) -> None:
        # a frame of the next chunk tells that this one has its name
        while len(self._waiting) > 1 and count > self._waiting[1].first - self._first:
            self._on_done(self._waiting.pop(0))

    def rest(self) -> None:
        for mark in self._waiting:
            self._on_done(mark)


def rows(marks: Sequence[ChunkMark]) -> Iterator[tuple[ChunkMark, ...]]:
    """Groups of marks, each of which begins where the one before ends."""
    row: list[ChunkMark] = []
    for mark in marks:
        if row and row[-1].end != mark.first:
            yield tuple(row)
            row = []
        row.append(mark)
    if row:
        yield tuple(row)
