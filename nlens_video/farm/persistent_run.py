"""A run that stays open between chunks, so that a worker starts once for a shot."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence

from nlens_video.core.errors import UsageError
from nlens_video.core.settings import Settings
from nlens_video.farm.chunk import write_chunks
from nlens_video.farm.store import Store
from nlens_video.video.chunks.chunk_id import ChunkMark
from nlens_video.video.chunks.chunk_queue import ChunkFeed


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
        self._feed = ChunkFeed(on_done=self._on_done)
        self._position: float = 0.0
        self._changed = threading.Condition()
        self._complete: set[ChunkMark] = set()  # and not yet waited for
        self._ended = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="nlens-persistent-run", daemon=True)
        self._thread.start()

    def accepts(self, settings: Settings, store: Store, mark: ChunkMark) -> bool:
        """Whether a chunk is of this run and starts at or after its position."""
        ahead = not self._ended and mark.first >= self._position
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
            for mark in marks:
                self._wait_for(mark)
                self._store.put(mark.file_name)
        except BaseException:
            self._position = math.inf  # accepts no more
            self._feed.drop()
            raise

    def _wait_for(self, mark: ChunkMark) -> None:
        with self._changed:
            self._changed.wait_for(lambda: mark in self._complete or self._ended)
        if mark not in self._complete:
            raise self._error or UsageError(
                f"{self._settings.source.spec}: ends before frame {mark.first}; was it changed?"
            )
        self._complete.remove(mark)

    def close(self) -> None:
        """End the run."""
        self._feed.end()
        self._thread.join()

    def _run(self) -> None:
        try:
            write_chunks(self._settings, self._feed, self._store.local)
        except BaseException as error:  # noqa: BLE001 - raised by `render`
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _on_done(self, mark: ChunkMark) -> None:
        with self._changed:
            self._complete.add(mark)
            self._changed.notify_all()
