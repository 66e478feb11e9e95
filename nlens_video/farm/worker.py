"""A worker of the farm: its tasks, and the run that it keeps open between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Self

from nlens_video.core import signals
from nlens_video.core.errors import UsageError
from nlens_video.core.settings import OutputSettings, Settings, SourceSettings
from nlens_video.farm.chunk import mark_of
from nlens_video.farm.job import Prepared, prepare, with_stored_fit
from nlens_video.farm.merge import Merged, merge_arriving
from nlens_video.farm.persistent_run import PersistentRun
from nlens_video.farm.store import Store
from nlens_video.run.open_run import opened
from nlens_video.run.preflight import preflight
from nlens_video.run.render import render
from nlens_video.video.chunks.chunk_id import ChunkMark


class Worker:
    """Runs one task at a time; the run of a shot stays open for its next chunks."""

    def __init__(self) -> None:
        self._open: PersistentRun | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()

    def prepare(self, settings: Settings, store: Store, chunk_s: float) -> Prepared:
        """Fit the lens and divide the plate into chunks, as `job.prepare`."""
        self.close()
        with opened(settings.source) as plate:
            preflight(settings, plate.info)
        return prepare(settings, store, chunk_s)

    def chunk(
        self, settings: Settings, fit: str | None, pieces: Sequence[ChunkMark], store: Store
    ) -> None:
        """Render a chunk, possibly on another machine than the one that planned it.

        Args:
            settings: the run.
            fit: name of its lens fit in the store, None where the run has one or needs none.
            pieces: its files, in order; existing ones are not rendered again.
            store: of the files.

        Raises:
            UsageError: files, version or renderer differ on this machine.
            NlensError: as `chunk.write_chunk`.
        """
        missing = [mark for mark in pieces if not store.has(mark.file_name)]
        if not missing:
            return
        fitted = with_stored_fit(settings, fit, store)
        if self._open is None or not self._open.accepts(fitted, store, missing[0]):
            self.close()
            own = mark_of(fitted)
            if (own.key, own.plate) != (missing[0].key, missing[0].plate):
                raise UsageError(
                    "a worker sees other files, or has another version or renderer, than the one "
                    "that made the fit; give all of them the same"
                )
            self._open = PersistentRun(fitted, store)
        self._open.render(missing)

    def whole(self, settings: Settings, fit: str | None, frames: int, store: Store) -> Merged:
        """Render a whole shot, as a single run.

        Args:
            settings: the run.
            fit: as for `chunk`.
            frames: of the plate [1].
            store: of the fit.

        Raises:
            NlensError: as `run.render`.
        """
        self.close()
        fitted = with_stored_fit(settings, fit, store)
        result = render(replace(fitted, track_focus="off"))
        return Merged(output=result.output, frames=frames, chunks=1, notes=result.notes)

    def merge(
        self, source: SourceSettings, marks: Sequence[ChunkMark], store: Store,
        output: OutputSettings, poll: Callable[[], None] = signals.check,
    ) -> Merged:  # fmt: skip
        """Merge chunks as they appear, as `merge.merge_arriving`."""
        self.close()
        return merge_arriving(source, marks, store, output, poll)

    def close(self) -> None:
        """Close the persistent run, if there is one."""
        if self._open is not None:
            self._open.close()
            self._open = None
