"""Reopening of a lost device or URL; frame numbers and times continue."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from types import TracebackType
from typing import Self

from nlens_video.core.errors import InputError
from nlens_video.video.info import Packet, SourceFrame, SourceInfo
from nlens_video.video.input.source import PacketSink, Source

_RETRY_S = 0.5


class Reconnecting:
    """A source that is reopened when it ends, until it stays away or is closed.

    Frames keep counting. Where pictures were missing, time is missing as well: the first frame of
    another connection comes as much later as it came later by the clock, and what travels along
    (sound) by the same amount. Streams that the first connection did not have are left out.

    Args:
        connect: opens the source.
        patience_s: how long to wait for a lost source [s].

    Attributes:
        info: as the first connection gave it.
        packet_sink: as any source's.
        lost: how often the source was lost and came back [1].

    Raises:
        InputError: it cannot be opened the first time.
    """

    def __init__(self, connect: Callable[[], Source], patience_s: float) -> None:
        self._connect = connect
        self._patience_s = patience_s
        self._closed = threading.Event()
        self._connection = connect()
        self._damaged_before = 0
        self._warnings_before: tuple[str, ...] = ()
        # from this connection's times to the output's [s], None until its first frame tells
        self._shift: Fraction | None = Fraction(0)
        self._waiting: list[Packet] = []  # for that
        self._heard: dict[int, Fraction] = {}  # end of each stream that travels along [s]
        self._start: Fraction | None = None  # of the first frame [s]
        self._last: tuple[Fraction, float] | None = None  # its end in the output, and by the clock
        self.info: SourceInfo = self._connection.info
        self.packet_sink: PacketSink | None = None
        self.lost = 0

    @property
    def damaged(self) -> int:
        """Packets and frames that were damaged so far."""
        return self._damaged_before + self._connection.damaged

    def warnings(self) -> tuple[str, ...]:
        """What happened so far that a person should know, beside the damaged packets."""
        return (*self._warnings_before, *self._connection.warnings())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._closed.set()
        self._connection.__exit__(kind, error, trace)

    def __iter__(self) -> Iterator[SourceFrame]:
        index = 0
        while True:
            self._connection.packet_sink = self._hand_on
            for frame in self._connection:
                now = time.monotonic()
                if self._shift is None:
                    self._shift = self._came_back_at(now) - _moment(frame)
                    for packet in self._waiting:
                        self._hand_on(packet)
                    self._waiting.clear()
                moment = _moment(frame) + self._shift
                if self._start is None:
                    self._start = moment
                yield self._placed(frame, index, moment)
                self._last = (moment, now)
                index += 1
            if not self._came_back():
                return

    def _placed(self, frame: SourceFrame, index: int, moment: Fraction) -> SourceFrame:
        if not self.lost:
            return frame
        pts = round(moment / self.info.time_base)
        duration = round(frame.duration * frame.time_base / self.info.time_base)
        return replace(
            frame, index=index, pts=pts, time_base=self.info.time_base, duration=duration,
            time_s=float(moment - (self._start or 0)),
        )  # fmt: skip

    def _came_back_at(self, now: float) -> Fraction:
        """Where its first frame goes in the output [s]: at least a frame after the last one."""
        if self._last is None:
            return Fraction(0)
        moment, then = self._last
        step = 1 / (self.info.average_rate or Fraction(25))
        return max(moment + step, moment + Fraction(now - then).limit_denominator(1_000_000))

    def _came_back(self) -> bool:
        """Wait for the source, and take it where it left off.

        Raises:
            InputError: what came back has other pictures.
        """
        self._connection.__exit__(None, None, None)
        deadline = time.monotonic() + self._patience_s
        while not self._closed.wait(_RETRY_S):
            try:
                again = self._connect()
            except InputError:
                if time.monotonic() > deadline:
                    return False
                continue
            self._damaged_before += self._connection.damaged
            self._warnings_before += self._connection.warnings()
            self._connection = again
            self._check(again.info)
            self._shift = None
            self.lost += 1
            return True
        return False

    def _check(self, info: SourceInfo) -> None:
        was, now = (f"{one.width}x{one.height} {one.pixel_format}" for one in (self.info, info))
        if was != now:
            raise InputError(
                f"{self.info.name}: came back with {now} after {was}; start again for other frames"
            )

    def _hand_on(self, packet: Packet) -> None:
        """A packet in the output's time, where it comes after the one before it.

        One of a stream that was not there at first is dropped.
        """
        if self._shift is None:
            self._waiting.append(packet)
            return
        known = {(one.index, one.codec) for one in self.info.copied}
        stream, unit = packet.stream, packet.time_base
        name = "" if stream.codec_context is None else stream.codec_context.name
        if self.packet_sink is None or (stream.index, name) not in known or packet.dts is None:
            return
        ticks = round(self._shift / unit)
        packet.dts += ticks
        packet.pts = None if packet.pts is None else packet.pts + ticks
        moment = packet.dts * unit
        if self.lost and moment <= self._heard.get(stream.index, moment - 1):
            return
        self._heard[stream.index] = moment
        self.packet_sink(packet)


def _moment(frame: SourceFrame) -> Fraction:
    return frame.pts * frame.time_base
