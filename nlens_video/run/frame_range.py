"""The frames of a run: ranges of a source with their packets, chunks, and lookahead."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar

from msgspec.structs import replace

from nlens_video.core.layers import Picture
from nlens_video.video.chunk_queue import ChunkFeed
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.seek import INTERLEAVING_S
from nlens_video.video.interfaces import Source

if TYPE_CHECKING:
    import av

    Packet = av.Packet[Any]


_SUBTITLE_S = 8  # what may be on screen at a range's start is read from so long before it [s]
LOOKAHEAD_FRAMES = 7  # a mean of eight frames has about a third of the noise of one
Item = TypeVar("Item")


class SourceSlice(ABC):
    """Iterates over a part of a source; its first frames can be previewed whatever the part.

    Args:
        source: the frames.

    Attributes:
        on_skipped: called with each frame that is decoded and lies outside the part.
        skip_to: called with the number of the first frame that is needed; earlier frames may then
            be left undecoded. Does nothing unless the source can seek.
    """

    def __init__(self, source: Source) -> None:
        self.on_skipped: Callable[[SourceFrame], None] = lambda frame: None
        self.skip_to: Callable[[int], None] = lambda number: None
        self._frames = iter(source)
        self._ahead: deque[SourceFrame] = deque()

    def peek(self, count: int) -> tuple[Picture, ...]:
        """The pictures of the source's first `count` frames; call before `items`.

        The shot is measured on these frames, so that every part of it is measured alike.
        """
        self._ahead.extend(islice(self._frames, count - len(self._ahead)))
        return tuple(frame.picture for frame in self._ahead)

    @abstractmethod
    def items(self) -> Iterator[SourceFrame | Packet]:
        """Frames and packets in the source's order."""

    def _in_order(self) -> Iterator[SourceFrame]:
        while self._ahead:
            yield self._ahead.popleft()
        yield from self._frames


class ChunkRange(SourceSlice):
    """The frames of queued chunks, at the source's own times; no packets.

    Args:
        source: the frames.
        feed: the chunks; the next one is taken when the first frame after a chunk is decoded.
    """

    def __init__(self, source: Source, feed: ChunkFeed) -> None:
        super().__init__(source)
        self._feed = feed

    def items(self) -> Iterator[SourceFrame | Packet]:
        """Frames in the source's order."""
        mark = self._feed.next()
        for frame in self._in_order():
            while mark is not None and mark.end is not None and frame.index >= mark.end:
                mark = self._feed.next()
            if mark is None:
                return
            if frame.index < mark.first:
                self.on_skipped(frame)
            else:
                yield frame


class FrameRange(SourceSlice):
    """The frames and packets of one range; its first frame is at time 0.

    A subtitle that is on screen at the first frame begins there, and lasts as long as it did. Of
    the other streams that is left which begins within the range; of a video also what its last
    pictures are predicted from, which may be shown up to some pictures after the end.

    Args:
        source: the frames and, through its `packet_sink`, the other streams' packets.
        frames: first index and the one past the last, None for an open end.
    """

    def __init__(self, source: Source, frames: tuple[int, int | None]) -> None:
        super().__init__(source)
        self._source = source
        self._first, self._end = frames
        self._packets: deque[Packet] = deque()
        self._subtitles = {one.index for one in source.info.copied if one.type == "subtitle"}
        self._videos = {one.index for one in source.info.copied if one.type == "video"}
        self._on_screen: list[Packet] = []  # subtitles before the range that may last into it
        self._start_s: Fraction | None = None if self._first else Fraction(0)
        self._start_pts = 0
        self._end_s: Fraction | None = None
        source.packet_sink = self._packets.append

    def items(self) -> Iterator[SourceFrame | Packet]:
        """Frames and packets in the source's order."""
        rate = self._source.info.average_rate or 30
        self.skip_to(self._first - (round(_SUBTITLE_S * rate) if self._subtitles else 0))
        following = waiting = 0
        for frame in self._in_order():
            moment = frame.pts * frame.time_base
            if self._start_s is None and frame.index > following:  # by a connection of its own
                self._forget(waiting)
            if self._end is not None and frame.index >= self._end:
                if self._end_s is None:
                    self._end_s = moment
                # audio packets of the last frames may follow later in the file
                if not self._source.info.copied or moment > self._end_s + INTERLEAVING_S:
                    break
            yield from self._released(moment)
            if frame.index < self._first:
                self.on_skipped(frame)
            elif self._end_s is None:
                if self._start_s is None:
                    self._start_pts, self._start_s = frame.pts, moment
                    self._packets.extendleft(reversed(self._on_screen))
                    yield from self._released(moment)
                yield replace(frame, pts=frame.pts - self._start_pts)
            following, waiting = frame.index + 1, len(self._packets)
        yield from self._released(None)

    def _forget(self, waiting: int) -> None:
        """Drop the packets of a connection that is closed, and with it their streams.

        Args:
            waiting: how many of those that wait are of it [1].
        """
        for _ in range(waiting):
            self._packets.popleft()
        self._on_screen.clear()

    def _released(self, moment: Fraction | None) -> Iterator[Packet]:
        """Packets whose time is decided, in their order, up to a frame's time; None for all.

        Those before the range wait until its start is known, and those that the file holds ahead of
        the frames until it is known that they do not lie behind its end.
        """
        if self._start_s is None:
            while self._packets and moment is not None:
                if _seconds(self._packets[0]) > moment - INTERLEAVING_S:
                    return
                self._on_screen.append(self._packets.popleft())
                self._on_screen = [one for one in self._on_screen if self._is_shown(one, moment)]
            return
        until = moment if self._end is not None and self._end_s is None else None
        while self._packets:
            if until is not None and _seconds(self._packets[0]) > until:
                return
            packet = self._packets.popleft()
            if self._first and _seconds(packet) < self._start_s:
                if not self._is_shown(packet, self._start_s):
                    continue
                _begin_at(packet, self._start_s)
            if self._end_s is not None and self._needed_s(packet) >= self._end_s:
                continue
            yield self._shifted(packet)

    def _needed_s(self, packet: Packet) -> Fraction:
        """When a packet is needed; pictures are decoded before some that are shown earlier [s]."""
        if packet.stream_index in self._videos and packet.dts is not None:
            return packet.dts * Fraction(packet.time_base or 0)
        return _seconds(packet)

    def _is_shown(self, packet: Packet, moment: Fraction) -> bool:
        """Whether a packet, begun by a moment [s], is a subtitle that is still shown then."""
        lasts_s = (packet.duration or 0) * Fraction(packet.time_base or 0)
        return packet.stream_index in self._subtitles and _seconds(packet) + lasts_s > moment

    def _shifted(self, packet: Packet) -> Packet:
        if self._start_s and packet.time_base:
            ticks = round(self._start_s / packet.time_base)
            packet.dts = None if packet.dts is None else packet.dts - ticks
            packet.pts = None if packet.pts is None else packet.pts - ticks
        return packet


def _seconds(packet: Packet) -> Fraction:
    ticks = packet.pts if packet.pts is not None else packet.dts
    return (ticks or 0) * Fraction(packet.time_base or 0)


def _begin_at(packet: Packet, moment: Fraction) -> None:
    """Let a packet begin later [s], and end when it did."""
    ticks = round(moment / Fraction(packet.time_base or 1))
    begun = packet.pts if packet.pts is not None else packet.dts
    packet.duration = max(0, (begun or 0) + (packet.duration or 0) - ticks)
    packet.pts = packet.dts = ticks


def look_ahead(
    items: Iterator[Item], wanted: Callable[[], bool]
) -> Iterator[tuple[Item, tuple[Picture, ...]]]:
    """Each item with the pictures of the frames that follow it.

    Args:
        items: frames and packets, in order.
        wanted: asked before each item whether to read ahead; once it is false, items that were
            read ahead come first and no more are read than are yielded.

    Yields:
        Item and up to `LOOKAHEAD_FRAMES` later pictures, none where the item is not a frame.
    """
    ahead: deque[Item] = deque()
    while True:
        reading = wanted()
        if reading:
            missing = LOOKAHEAD_FRAMES + 1 - len(_pictures(ahead))
            while missing and (item := next(items, None)) is not None:
                ahead.append(item)
                missing -= isinstance(item, SourceFrame)
        item = ahead.popleft() if ahead else next(items, None)
        if item is None:
            return
        yield item, _pictures(ahead) if reading and isinstance(item, SourceFrame) else ()


def _pictures(items: Iterable[object]) -> tuple[Picture, ...]:
    return tuple(item.picture for item in items if isinstance(item, SourceFrame))
