"""Seeking to an exact frame: by an index of the packets, checked against the decoded times."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from types import TracebackType
from typing import Self

from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.input.packet_index import index_until
from nlens_video.video.input.source import AvSource, PacketSink, Source, open_source

INTERLEAVING_S = Fraction(2)
"""Largest interleaving distance of two streams' packets of one time [s]."""
_LEAST_SKIP = 48  # frames: fewer are decoded faster than a file is opened


def open_seekable(spec: str, **hints: str | None) -> Source:
    """Open a source that can skip frames if it is a file; arguments as `open_source`."""
    source = open_source(spec, **hints)
    return SeekableSource(source) if isinstance(source, AvSource) else source


class SeekableSource:
    """A file whose reader may skip frames.

    Where the packet index is unambiguous and the decoder confirms its times, the file is opened a
    second time and decoded from a key frame before the wanted frame; else all frames are decoded.

    Args:
        first: a file that is open.

    Attributes:
        info: what is known about it.
    """

    def __init__(self, first: AvSource) -> None:
        self._wanted = 0
        self._source = first
        self._damaged_before = 0
        self._warnings_before: tuple[str, ...] = ()
        self.info: SourceInfo = first.info

    @property
    def packet_sink(self) -> PacketSink | None:
        """As any source's."""
        return self._source.packet_sink

    @packet_sink.setter
    def packet_sink(self, sink: PacketSink | None) -> None:
        self._source.packet_sink = sink

    @property
    def damaged(self) -> int:
        """Packets and frames that were damaged so far."""
        return self._damaged_before + self._source.damaged

    def warnings(self) -> tuple[str, ...]:
        """What happened so far that a person should know, beside the damaged packets."""
        return (*self._warnings_before, *self._source.warnings())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._source.__exit__(kind, error, trace)

    def skip_to(self, number: int) -> None:
        """Allow frames before `number` to be skipped from the next frame on."""
        self._wanted = number

    def __iter__(self) -> Iterator[SourceFrame]:
        frames = iter(self._source)
        for frame in frames:
            yield frame
            if self._wanted > frame.index + _LEAST_SKIP:
                later = self._opened_at(self._wanted, frame.index)
                self._wanted = 0
                if later is not None:
                    self._switch_to(later)
                    yield from self
                    return

    def _switch_to(self, later: AvSource) -> None:
        before, self._source = self._source, later
        later.packet_sink = before.packet_sink
        self._damaged_before += before.damaged
        self._warnings_before += before.warnings()
        before.__exit__(None, None, None)

    def _opened_at(self, number: int, here: int) -> AvSource | None:
        """The file opened at a frame; None where that gains nothing or is not certain."""
        if self.info.kind != "video" or self.damaged:
            return None
        index = index_until(self.info.name, self._source.hints, number)
        if index is None:
            return None
        early = INTERLEAVING_S if self.info.copied else Fraction(0)
        start = index.start_before(number, round(early / self.info.time_base))
        if start <= here:
            return None
        later = AvSource(self.info.name, self._source.hints)
        if later.start_at(index.pts, start, number):
            return later
        later.__exit__(None, None, None)
        return None
