"""Seeking to an exact frame: by an index of the packets, checked against the decoded times."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Unpack

from nlens_video.core.settings import InputArguments
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.packet_index import index_until
from nlens_video.video.input.source import AvSource, open_source
from nlens_video.video.interfaces import Source, SwitchingSource

INTERLEAVING_S = Fraction(2)
"""Largest interleaving distance of two streams' packets of one time [s]."""
_LEAST_SKIP = 48  # frames: fewer are decoded faster than a file is opened


def open_seekable(spec: str, **hints: Unpack[InputArguments]) -> Source:
    """Open a source that can skip frames if it is a file; arguments as `open_source`."""
    source = open_source(spec, **hints)
    return SeekableSource(source) if isinstance(source, AvSource) else source


class SeekableSource(SwitchingSource):
    """A file that can skip frames.

    Where the packet index is unambiguous and the decoder confirms its times, the file is opened a
    second time and decoded from a key frame before the wanted frame; else all frames are decoded.

    Args:
        first: an open file.
    """

    def __init__(self, first: AvSource) -> None:
        super().__init__(first)
        self._hints = first.hints
        self._wanted = 0

    def skip_to(self, number: int) -> None:
        """Allow frames before `number` to be skipped from the next frame on."""
        self._wanted = number

    def __iter__(self) -> Iterator[SourceFrame]:
        self._connection.packet_sink = self.packet_sink
        for frame in self._connection:
            yield frame
            if self._wanted > frame.index + _LEAST_SKIP:
                later = self._opened_at(self._wanted, frame.index)
                self._wanted = 0
                if later is not None:
                    self._switch_to(later)
                    yield from self
                    return

    def _opened_at(self, number: int, here: int) -> AvSource | None:
        """The file from frame `number` on, None where the index is ambiguous or saves nothing."""
        if self.info.kind != "video" or self.damaged:
            return None
        index = index_until(self.info.name, self._hints, number)
        if index is None:
            return None
        early = INTERLEAVING_S if self.info.copied else Fraction(0)
        start = index.start_before(number, round(early / self.info.time_base))
        if start <= here:
            return None
        later = AvSource(self.info.name, self._hints)
        if later.start_at(index.pts, start, number):
            return later
        later.close()
        return None
