"""Chunks that a run is to make, handed to it while it is at work."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from queue import Empty, SimpleQueue

from nlens_video.video.chunks.chunk_id import ChunkMark


class ChunkFeed:
    """Chunks of one plate in the order of their frames; more may come until it is ended.

    Args:
        marks: those that are known already.
        on_done: called with each whose file is there.

    Attributes:
        begun: what `next` has given and the run's sink has not yet taken.
        done: called by the sink.
    """

    def __init__(
        self,
        marks: Iterable[ChunkMark] = (),
        on_done: Callable[[ChunkMark], None] = lambda mark: None,
    ) -> None:
        self.begun: deque[ChunkMark] = deque()
        self.done = on_done
        self._waiting: SimpleQueue[ChunkMark | None] = SimpleQueue()
        for mark in marks:
            self.add(mark)

    def add(self, mark: ChunkMark) -> None:
        """One more, none of whose frames lies before the end of the one before."""
        self._waiting.put(mark)

    def drop(self) -> None:
        """Forget those that nobody has asked for yet."""
        with suppress(Empty):
            while True:
                self._waiting.get_nowait()

    def end(self) -> None:
        """No more will come."""
        self._waiting.put(None)

    def next(self) -> ChunkMark | None:
        """The next one, waited for; None at the end."""
        mark = self._waiting.get()
        if mark is None:
            self.end()  # whoever asks again is told again
        else:
            self.begun.append(mark)
        return mark
