"""A worker of the farm: its tasks, and the run that stays open between chunks of one shot."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue

from msgspec.structs import replace

from nlens_video.core import signals
from nlens_video.core.errors import UsageError
from nlens_video.core.settings import OutputSettings, Settings, SourceSettings
from nlens_video.farm.chunk import mark_of, with_stored_look, write_chunks
from nlens_video.farm.job import Prepared, prepare, with_stored_fit
from nlens_video.farm.merge import Merged, merge_arriving
from nlens_video.farm.store import Store
from nlens_video.run.plate_source import opened
from nlens_video.run.preflight import preflight
from nlens_video.run.render import render
from nlens_video.video.chunk_queue import ChunkFeed, ChunkMark


class PersistentRun:
    """Renders chunks as they are added, in a thread of its own.

    The plate stays open at the end of the last chunk, and so do scene, measured effects, networks,
    OpenGL context and the state of exposure matching.

    Args:
        settings: the run.
        store: of the chunks.
    """

    def __init__(self, settings: Settings, store: Store) -> None:
        self._settings = settings
        self._store = store
        self._done: SimpleQueue[ChunkMark | None] = SimpleQueue()  # None: the run has ended
        self._feed = ChunkFeed(on_done=self._done.put)
        self._position: float = 0.0
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="nlens-persistent-run", daemon=True)
        self._thread.start()

    def accepts(self, settings: Settings, store: Store, mark: ChunkMark) -> bool:
        """Whether a chunk is of this run and starts at or after its position."""
        ahead = self._thread.is_alive() and mark.first >= self._position
        return ahead and (settings, store) == (self._settings, self._store)

    def render(self, marks: Sequence[ChunkMark]) -> None:
        """Render chunks one after the other; each is put into the store when it is complete.

        Args:
            marks: the chunks, in order, at least one; the first is one that it `accepts`.

        Raises:
            UsageError: the plate has no such frames.
            NlensError: as `run.render` and `Store.put`; the run then accepts no more.
        """
        end = marks[-1].end
        self._position = math.inf if end is None else end
        for mark in marks:
            self._feed.add(mark)
        try:
            for mark in marks:  # which are completed in their order
                if self._done.get() is None:
                    raise self._error or UsageError(
                        f"{self._settings.source.spec}: ends before frame {mark.first}; "
                        "was it changed?"
                    )
                self._store.put(mark.file_name)
        except BaseException:
            self._position = math.inf  # accepts no more
            self._feed.drop()
            raise

    def close(self) -> None:
        """End the run."""
        self._feed.end()
        self._thread.join()

    def _run(self) -> None:
        try:
            write_chunks(self._settings, self._feed, self._store.local)
        except BaseException as error:  # noqa: BLE001 - raised by `render`
            self._error = error
        self._done.put(None)


class Worker:
    """Runs one task at a time; the run of a shot stays open for its next chunks."""

    def __init__(self) -> None:
        self._open: PersistentRun | None = None

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
        fitted = with_stored_look(fitted, store, missing[0].key)
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
        fitted = with_stored_look(fitted, store, mark_of(fitted).key)
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
