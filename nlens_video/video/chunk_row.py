"""Chunks that follow each other, written by one run: each has its name as soon as it is whole."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from nlens_video.chunk_mark import ChunkMark
from nlens_video.video.chunk import ChunkSink
from nlens_video.video.info import Packet, SourceFrame, SourceInfo


class ChunkRow:
    """Writes the chunks of consecutive marks; what was whole stays when a run is cut off.

    Args:
        folder: where the files appear.
        info: the plate.
        marks: at least one, each beginning where the one before ends.

    Attributes:
        notes: what was found of killed runs.
        kept: None; a part of a chunk is of no use.
    """

    def __init__(self, folder: Path, info: SourceInfo, marks: Sequence[ChunkMark]) -> None:
        self.kept: Path | None = None
        self._folder = folder
        self._info = info
        self._waiting = deque(marks)
        self._mark = self._waiting.popleft()
        self._sink = self._opened()
        self.notes = self._sink.notes

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._sink.__exit__(kind, error, trace)

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame into its chunk.

        Raises:
            OutputError: the disk is full.
            UsageError: the plate's format has no lossless chunks.
        """
        while self._waiting and self._mark.end is not None and frame.index >= self._mark.end:
            self._sink.commit()
            self._mark = self._waiting.popleft()
            self._sink = self._opened()
        self._sink.write(frame)

    def write_packet(self, packet: Packet) -> None:
        """Nothing: `merge` takes the other streams from the plate."""

    def commit(self) -> None:
        """Finish the last chunk.

        Raises:
            OutputError: it cannot be written.
        """
        self._sink.commit()

    def _opened(self) -> ChunkSink:
        return ChunkSink(self._folder / self._mark.file_name, self._info, self._mark)
