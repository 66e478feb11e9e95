"""Chunks written by one run, one after the other: each has its name as soon as it is whole."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from nlens_video.video.chunks.chunk_file import ChunkSink
from nlens_video.video.chunks.chunk_id import ChunkMark
from nlens_video.video.chunks.chunk_queue import ChunkFeed
from nlens_video.video.info import Packet, SourceFrame, SourceInfo


class ChunkWriter:
    """Writes the chunks that a feed has given; what was whole stays when a run is cut off.

    Args:
        folder: where the files appear.
        info: the plate.
        feed: tells which chunks the frames belong to, and is told what is done.

    Attributes:
        kept: None; a part of a chunk is of no use.
        notes: what was found of killed runs.
    """

    def __init__(self, folder: Path, info: SourceInfo, feed: ChunkFeed) -> None:
        self.kept: Path | None = None
        self.notes: tuple[str, ...] = ()
        self._folder = folder
        self._info = info
        self._feed = feed
        self._open: tuple[ChunkMark, ChunkSink] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        if self._open is not None:
            self._open[1].__exit__(kind, error, trace)

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame into its chunk.

        Raises:
            OutputError: the disk is full.
            UsageError: the plate's format has no lossless chunks.
        """
        if self._open is None:
            mark = self._feed.begun.popleft()
            self._open = mark, ChunkSink(self._folder / mark.file_name, self._info, mark)
            self.notes += self._open[1].notes
        mark, sink = self._open
        sink.write(frame)
        if mark.end is not None and frame.index + 1 >= mark.end:
            self.commit()

    def write_packet(self, packet: Packet) -> None:
        """Nothing: `merge` takes the other streams from the plate."""

    def commit(self) -> None:
        """Finish the chunk at hand.

        Raises:
            OutputError: it cannot be written.
        """
        if self._open is None:
            return
        mark, sink = self._open
        sink.commit()
        self._open = None
        self._feed.done(mark)
