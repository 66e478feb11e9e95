"""Packets of the other streams in the time of the pictures, whose wrong time stamps are repaired.

Where recordings are joined, as by `cat`, the times of all streams begin anew, each at its own place
in the file; the pictures get an offset from there on, and so must what goes with them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

from nlens_video.video.info import Packet
from nlens_video.video.input.repair import SourceClock, begins_anew

_DECODING = 64
"""Frames by which decoded pictures are behind the packets that are read, at the most [1]."""


_UNDATED = 32
"""Packets without a decoding time that wait for one; 16 pictures at most are reordered [1]."""


class _Waiting(NamedTuple):
    """A packet that was read.

    Attributes:
        packet: with the source's times.
        part: number of the recording that it belongs to.
        frame: number of frames that had been shown when it was read.
    """

    packet: Packet
    part: int
    frame: int


class PassedPackets:
    """The packets of the other streams, from reading until the pictures' offset is known."""

    def __init__(self) -> None:
        self._waiting: deque[_Waiting] = deque()
        self._undated: dict[int, list[Packet]] = {}
        self._part = self._settled = self._shown = 0
        self._last: int | None = None  # of the pictures' packets [ticks]
        self._now_s: Fraction | None = None  # the same
        self._before_s = Fraction(0)  # of their last one before the part
        self._parts: dict[int, int] = {}
        self._passed: dict[int, int] = {}

    def see(self, packet: Packet) -> bool:
        """Note the time of a packet of the pictures; whether another recording begins with it."""
        if packet.dts is None or not packet.time_base:
            return False
        begins = begins_anew(packet, self._last)
        if begins:
            self._part += 1
            self._before_s = self._now_s or Fraction(0)
        self._last, self._now_s = packet.dts, packet.dts * Fraction(packet.time_base)
        return begins

    def add(self, packet: Packet) -> None:
        """Add a packet that was read.

        Matroska stores no decoding times, and FFmpeg finds none for a video's first packets where
        pictures are reordered. These wait for the next one and count back from its time.
        """
        undated = self._undated.setdefault(packet.stream.index, [])
        if packet.dts is None:
            if packet.pts is not None and len(undated) < _UNDATED:
                undated.append(packet)
            return
        dts = packet.dts
        for one in reversed(undated):
            dts = one.dts = dts - max(1, one.duration or 0)
        for one in (*undated, packet):
            self._add(one)
        undated.clear()

    def _add(self, packet: Packet) -> None:
        part = self._parts.get(packet.stream.index, 0)
        if part < self._part and packet.dts is not None and self._now_s is not None:
            at_s = packet.dts * Fraction(packet.time_base or 1)
            if abs(at_s - self._now_s) < abs(at_s - self._before_s):
                part = self._parts[packet.stream.index] = self._part
        self._waiting.append(_Waiting(packet, part, self._shown))

    def due(self, clock: SourceClock, *, ended: bool = False) -> Iterator[Packet]:
        """Those whose offset is known, in the order of the source.

        A packet that overlaps the recording before is left out.

        Args:
            clock: of the pictures.
            ended: whether no further picture comes.
        """
        self._shown = clock.frames
        if ended:
            self._date_the_last()
        while self._waiting:
            packet, part, frame = self._waiting[0]
            offsets = clock.offsets
            if part > max(len(offsets), self._settled):
                if not ended and self._shown - frame < _DECODING:
                    return
                self._settled = part  # the step was one of a wrong time stamp
            self._waiting.popleft()
            offset = offsets[min(part, len(offsets)) - 1] if part and offsets else 0
            if self._shifted(packet, offset * clock.time_base):
                yield packet

    def _date_the_last(self) -> None:
        """Decode what still waits for a time as it is shown."""
        for undated in self._undated.values():
            for one in undated:
                one.dts = one.pts
                self._add(one)
            undated.clear()

    def _shifted(self, packet: Packet, offset_s: Fraction) -> bool:
        """Shift a packet in place; whether it comes after the one before."""
        stream, dts = packet.stream.index, packet.dts
        if dts is None or not packet.time_base:
            return True
        ticks = round(offset_s / packet.time_base)
        packet.dts = dts + ticks
        packet.pts = None if packet.pts is None else packet.pts + ticks
        if offset_s and dts + ticks <= self._passed.get(stream, dts + ticks - 1):
            return False
        self._passed[stream] = dts + ticks
        return True
