"""What a worker does, and what it keeps from one task to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Self

from nlens_video.core import signals
from nlens_video.core.errors import UsageError
from nlens_video.core.settings import OutputSettings, Settings, SourceSettings
from nlens_video.farm.chunk import mark_of
from nlens_video.farm.job import Prepared, prepare, with_stored
from nlens_video.farm.merge import Merged, merge_arriving
from nlens_video.farm.persistent_run import OpenRun
from nlens_video.farm.store import Store
from nlens_video.run.open_run import opened
from nlens_video.run.preflight import preflight
from nlens_video.run.render import render
from nlens_video.video.chunks.chunk_id import ChunkMark


class Worker:
    """One at a time: the tasks of a farm; a shot's run stays open for the chunks that follow."""

    def __init__(self) -> None:
        self._open: OpenRun | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()

    def prepare(self, settings: Settings, store: Store, chunk_s: float) -> Prepared:
        """Find the lens and cut the plate into chunks, as `job.prepare`."""
        self.close()
        with opened(settings.source) as plate:
            preflight(settings, plate.info)
        return prepare(settings, store, chunk_s)

    def chunk(
        self, settings: Settings, fit: str | None, pieces: Sequence[ChunkMark], store: Store
    ) -> None:
        """Render a chunk on a machine that may differ from the one that has planned it.

        Args:
            settings: the run.
            fit: name of its lens in the store, None where the run has one or needs none.
            pieces: the files that it lies in, in order; those that are there already stay.
            store: where they shall lie.

        Raises:
            UsageError: the machine differs.
            NlensError: as `chunk.write_chunk`.
        """
        missing = [mark for mark in pieces if not store.has(mark.file_name)]
        if not missing:
            return
        known = with_stored(settings, fit, store)
        if self._open is None or not self._open.takes(known, store, missing[0]):
            self.close()
            seen = mark_of(known)
            if (seen.key, seen.plate) != (missing[0].key, missing[0].plate):
                raise UsageError(
                    "a worker sees other files, or has another version or renderer, than the one "
                    "that made the fit; give all of them the same"
                )
            self._open = OpenRun(known, store)
        self._open.render(missing)

    def whole(self, settings: Settings, fit: str | None, frames: int, store: Store) -> Merged:
        """Render a shot into its result, as a single run does.

        Args:
            settings: the run.
            fit: as for `chunk`.
            frames: of the plate [1].
            store: where the fit lies.

        Raises:
            NlensError: as `run.render`.
        """
        self.close()
        known = with_stored(settings, fit, store)
        outcome = render(replace(known, track_focus="off"))
        return Merged(output=outcome.output, frames=frames, chunks=1, notes=outcome.notes)

    def merge(
        self, source: SourceSettings, marks: Sequence[ChunkMark], store: Store,
        output: OutputSettings, look: Callable[[], None] = signals.check,
    ) -> Merged:  # fmt: skip
        """Join chunks as they come, as `merge.merge_arriving`."""
        self.close()
        return merge_arriving(source, marks, store, output, look)

    def close(self) -> None:
        """End the shot's run that stays open, if there is one."""
        if self._open is not None:
            self._open.close()
            self._open = None
