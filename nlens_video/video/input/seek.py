"""A file of which frames can be left out: found by its packets, and shown to be those decoded."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from types import TracebackType
from typing import Self

from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.input.packet_index import index_until
from nlens_video.video.input.source import AvSource, PacketSink, Source, open_source

INTERLEAVING_S = Fraction(2)
"""How far apart in a file two streams' packets of one moment may lie [s]."""
_WORTH = 48  # frames: fewer are decoded sooner than a file is opened


def open_sought(spec: str, **hints: str | None) -> Source:
    """Open a file whose reader may ask for frames to be left out; arguments as `open_source`."""
    source = open_source(spec, **hints)
    return Sought(source) if isinstance(source, AvSource) else source


class Sought:
    """A file whose reader may ask for frames to be left out.

    Where packets tell for certain which frame is which, and the decoder's times say the same, the
    file is opened a second time and read from a key frame before; else all frames are read.

    Args:
        first: a file that is open.

    Attributes:
        info: what is known about it.
    """

    def __init__(self, first: AvSource) -> None:
        self._wanted = 0
        self._now = first
        self._damaged_before = 0
        self._mishaps_before: tuple[str, ...] = ()
        self.info: SourceInfo = first.info

    @property
    def packet_sink(self) -> PacketSink | None:
        """As any source's."""
        return self._now.packet_sink

    @packet_sink.setter
    def packet_sink(self, sink: PacketSink | None) -> None:
        self._now.packet_sink = sink

    @property
    def damaged(self) -> int:
        """Packets and frames that were damaged so far."""
        return self._damaged_before + self._now.damaged

    def warnings(self) -> tuple[str, ...]:
        """What happened so far that a person should know, beside the damaged packets."""
        return (*self._mishaps_before, *self._now.warnings())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._now.__exit__(kind, error, trace)

    def skip_to(self, number: int) -> None:
        """Frames from the next one on that lie before this one may be left out."""
        self._wanted = number

    def __iter__(self) -> Iterator[SourceFrame]:
        frames = iter(self._now)
        for frame in frames:
            yield frame
            if self._wanted > frame.index + _WORTH:
                later = self._opened_at(self._wanted, frame.index)
                self._wanted = 0
                if later is not None:
                    self._go_over_to(later)
                    yield from self
                    return

    def _go_over_to(self, later: AvSource) -> None:
        before, self._now = self._now, later
        later.packet_sink = before.packet_sink
        self._damaged_before += before.damaged
        self._mishaps_before += before.warnings()
        before.__exit__(None, None, None)

    def _opened_at(self, number: int, here: int) -> AvSource | None:
        """The file again, where it goes on with a frame; None where that is no gain or not sure."""
        if self.info.kind != "video" or self.damaged:
            return None
        index = index_until(self.info.name, self._now.hints, number)
        if index is None:
            return None
        early = INTERLEAVING_S if self.info.copied else Fraction(0)
        start = index.start_before(number, round(early / self.info.time_base))
        if start <= here:
            return None
        later = AvSource(self.info.name, self._now.hints)
        if later.start_at(index.pts, start, number):
            return later
        later.__exit__(None, None, None)
        return None
