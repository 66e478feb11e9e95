"""Identity of chunks (lossless parts of a longer result), and the queue of those to render."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from queue import Empty, SimpleQueue

from msgspec import Struct
from msgspec.structs import asdict


class ChunkMark(Struct, frozen=True, kw_only=True):
    """Identity of a chunk, stored in its file so that chunks are never mixed up.

    Attributes:
        key: hash of everything that its pictures depend on; chunks of one result share it.
        plate: hash of the plate alone.
        first: number of its first frame in the plate [1].
        end: one past its last frame, or past the plate's end; None for the plate's end [1].
    """

    key: str
    plate: str
    first: int
    end: int | None

    @property
    def file_name(self) -> str:
        """Canonical name of its file."""
        end = "end" if self.end is None else f"{self.end:08d}"
        return f"{self.key}-{self.first:08d}-{end}.nut"

    def to_json(self) -> str:
        """Serialise it for the chunk's file."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> ChunkMark:
        """Parse what `to_json` has written.

        Raises:
            ValueError: the text is something else.
        """
        try:
            raw = json.loads(text)
            mark = cls(
                key=str(raw["key"]), plate=str(raw["plate"]), first=int(raw["first"]),
                end=None if raw["end"] is None else int(raw["end"]),
            )  # fmt: skip
        except (KeyError, TypeError) as error:
            raise ValueError(f"no chunk's mark: {text[:80]}") from error
        if mark.first < 0 or (mark.end is not None and mark.end <= mark.first):
            raise ValueError(f"frames {mark.first} to {mark.end}")
        return mark


class ChunkFeed:
    """Queue of chunks of one plate in the order of their frames; it may grow until it is ended.

    Args:
        marks: the first entries.
        on_done: called with each chunk whose file is complete.

    Attributes:
        begun: chunks that `next` has returned and the sink has not yet opened.
        done: `on_done`, called by the sink.
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
        """Append a chunk that starts at or after the end of the last one."""
        self._waiting.put(mark)

    def drop(self) -> None:
        """Remove the chunks that `next` has not returned yet."""
        with suppress(Empty):
            while True:
                self._waiting.get_nowait()

    def end(self) -> None:
        """Declare that no chunk follows."""
        self._waiting.put(None)

    def next(self) -> ChunkMark | None:
        """The next chunk; blocks until there is one; None at the end."""
        mark = self._waiting.get()
        if mark is None:
            self.end()  # later calls get None as well
        else:
            self.begun.append(mark)
        return mark
