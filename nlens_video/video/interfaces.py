"""Base classes of sources and sinks, which are context managers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self, TypeAlias

from nlens_video.video.info import Packet, SourceFrame, SourceInfo

PacketSink: TypeAlias = Callable[[Packet], None]


class Source(ABC):
    """Frames in order, once; closing it early is fine.

    Attributes:
        info: properties of the source.
        packet_sink: receives the packets of the streams in `info.copied`, in the order of the
            source, on the thread that iterates; set it before the first frame.
    """

    info: SourceInfo
    packet_sink: PacketSink | None = None
    _damaged = 0

    @property
    def damaged(self) -> int:
        """Packets, frames or files so far that were damaged [1]."""
        return self._damaged

    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Irregularities of the source so far, other than damaged packets."""

    @abstractmethod
    def close(self) -> None:
        """Close the files; idempotent."""

    @abstractmethod
    def __iter__(self) -> Iterator[SourceFrame]:
        """The frames; packets of other streams go to `packet_sink` as they are read."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class SwitchingSource(Source):
    """A source that reads one connection after another; damage and warnings add up.

    Args:
        connection: the first one, whose properties count.
    """

    def __init__(self, connection: Source) -> None:
        self.info = connection.info
        self._connection = connection
        self._warnings: tuple[str, ...] = ()

    @property
    def damaged(self) -> int:
        """Packets and frames so far that were damaged [1]."""
        return self._damaged + self._connection.damaged

    def warnings(self) -> tuple[str, ...]:
        """Irregularities of the connections so far, other than damaged packets."""
        return (*self._warnings, *self._connection.warnings())

    def close(self) -> None:
        """Close the current connection."""
        self._connection.close()

    def _switch_to(self, connection: Source) -> None:
        before, self._connection = self._connection, connection
        self._damaged += before.damaged
        self._warnings += before.warnings()
        before.close()


class Sink(ABC):
    """Writes frames in order; left without `commit`, it leaves nothing behind.

    Attributes:
        kept: the partial file of an aborted run, where one was requested.
        keeps_nothing: whether one was requested, and nothing that plays was written.
        cut_off: whether an aborted run ended a stream before its end.
    """

    kept: Path | None = None
    keeps_nothing = False
    cut_off = False
    _notes: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences from the source so far, with reasons, for the plan and the log."""
        return self._notes

    @abstractmethod
    def write(self, frame: SourceFrame) -> None:
        """Encode one frame at its own time.

        Raises:
            OutputError: the disk is full, or the encoder refuses the frame.
        """

    @abstractmethod
    def write_packet(self, packet: Packet) -> None:
        """Write a packet of one of the source's other streams."""

    @abstractmethod
    def commit(self) -> None:
        """Finish the result and rename it to its final name.

        Raises:
            OutputError: it cannot be written.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the files; without `commit`, discard them."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
