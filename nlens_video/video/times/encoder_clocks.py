"""Times of the frames that an encoder gets, and of the packets that it gives."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import lcm
from typing import TypeAlias

import av
from av.video.stream import VideoStream

from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.times.start import begins_at_zero

_LONGEST_DELAY_S = 60  # from decoding to display, beyond what gaps between frames add
_LONGEST_GAP_S = 3600  # a longer one is a wrong time
_SEEN_STEPS = 1  # by which pictures of uneven times may be late unsaid [1]
_FINEST = 1_000_000
"""Most ticks in a second; rates that need more are estimates [1/s]."""
Packets: TypeAlias = "list[av.Packet[VideoStream]]"


class EncoderClock:
    """Times of an encoder with exact pts.

    Attributes:
        time_base: of the encoder [s].
    """

    def __init__(self, info: SourceInfo) -> None:
        self.time_base = info.time_base
        self._first: int | None = None
        self._longest_s = Fraction(_LONGEST_DELAY_S)

    @property
    def notes(self) -> tuple[str, ...]:
        """On times so far that the result does not have."""
        return ()

    def missed(self, frame: SourceFrame) -> Iterator[av.VideoFrame]:
        """Pictures to encode before a frame, where it leaves a gap that needs them."""
        del frame
        return iter(())

    def stamp(self, encoded: av.VideoFrame, frame: SourceFrame) -> None:
        """Set the time of a frame to encode."""
        encoded.pts, encoded.time_base = frame.pts, frame.time_base
        encoded.duration = frame.duration
        self._first = frame.pts if self._first is None else self._first
        # the first packet may be decoded as long before its frame as the clip lasts
        self._longest_s = _LONGEST_DELAY_S + 2 * (frame.pts - self._first) * frame.time_base

    def retimed(self, packets: Packets) -> Packets:
        """The packets, in place, at the source's times."""
        for packet in packets:
            if packet.pts is None or packet.dts is None:
                continue
            # x265 leaves dts to chance in clips shorter than its reordering delay
            if abs(packet.pts - packet.dts) * Fraction(packet.time_base or 1) > self._longest_s:
                packet.dts = packet.pts
        return packets


class FixedRateClock(EncoderClock):
    """Times of an encoder that needs a fixed rate; its packets get the source's times back.

    Containers that count pictures keep the steps of the rate.
    """

    def __init__(self, info: SourceInfo, rate: Fraction) -> None:
        super().__init__(info)
        self.time_base = 1 / rate
        self._source = info.time_base
        self._first: int | None = None
        self._last = -1
        self._latest = 0
        self._least = round(self.time_base / self._source / 2)
        self._own: dict[int, int] = {}  # the source's times of the steps that may still come

    def stamp(self, encoded: av.VideoFrame, frame: SourceFrame) -> None:
        """Set the time of a frame to the nearest free step of the rate."""
        if self._first is None:
            self._first, self._latest = frame.pts, frame.pts - self._least
        self._last = max(self._step(frame), self._last + 1)
        # apart by more than a tick of any container
        self._latest = max(frame.pts, self._latest + self._least)
        self._own[self._last] = self._latest
        encoded.pts, encoded.time_base, encoded.duration = self._last, self.time_base, 1

    def _step(self, frame: SourceFrame) -> int:
        first = frame.pts if self._first is None else self._first
        return round((frame.pts - first) * self._source / self.time_base)

    def retimed(self, packets: Packets) -> Packets:
        """The packets, in place, at the source's times, or counted from the first frame's."""
        for packet in packets:
            if packet.dts is not None:  # no later packet goes back behind it
                self._own = {step: own for step, own in self._own.items() if step >= packet.dts}
            counted = begins_at_zero(packet.stream.container.format.name)
            own = {} if counted else self._own
            packet.pts = None if packet.pts is None else self._time(packet.pts, own)
            packet.dts = None if packet.dts is None else self._time(packet.dts, own)
            packet.duration = round(self.time_base / self._source)
            packet.time_base = self._source
        return packets

    def _time(self, step: int, own: dict[int, int]) -> int:
        """Time of a step, which before the first frame is no picture's own."""
        counted = (self._first or 0) + round(step * self.time_base / self._source)
        return own.get(step, counted)


class CountingClock(FixedRateClock):
    """Times of a container that stores none: each step of the rate needs a picture."""

    def __init__(self, info: SourceInfo, rate: Fraction, container: str) -> None:
        super().__init__(info, rate)
        self._container = container
        self._shown: av.VideoFrame | None = None
        self._repeated = self._late = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """On pictures so far that fill gaps, and on those that come later than the plate's."""
        why = f"{self._container} stores no times; .mov, .mkv and .mp4 files do"
        again = f"gaps between pictures are filled with {self._repeated}, each the one before again"
        late_s = float(self._late * self.time_base)
        rate = float(1 / self.time_base)
        late = f"pictures come up to {late_s:.2f} s late, at {rate:.5g} per second"
        told = ((self._repeated, again), (self._late > _SEEN_STEPS, late))
        return tuple(f"{text}: {why}" for holds, text in told if holds)

    def missed(self, frame: SourceFrame) -> Iterator[av.VideoFrame]:
        """The last picture, again for each step up to a frame; none where its time is wrong."""
        missing = self._step(frame) - self._last - 1
        if self._shown is None or missing * self.time_base > _LONGEST_GAP_S:
            return
        for _ in range(missing):
            self._last += 1
            self._shown.pts = self._last
            yield self._shown
            self._repeated += 1

    def stamp(self, encoded: av.VideoFrame, frame: SourceFrame) -> None:
        """Set the time of a frame to the nearest free step of the rate."""
        super().stamp(encoded, frame)
        self._shown = encoded
        self._late = max(self._late, self._last - self._step(frame))


class GridClock(EncoderClock):
    """Times of a constant rate whose frames last no whole number of the source's ticks.

    Matroska rounds times to milliseconds, so that frames of 1001/24000 s last 41 or 42 ms. Frames
    within one tick of the rate's times get these, all others keep their own. Ticks are such that
    both are whole numbers of them.
    """

    def __init__(self, info: SourceInfo) -> None:
        super().__init__(info)
        rate = info.average_rate or Fraction(25)
        self.time_base = _common_tick(rate, info.time_base)
        self._step = int(1 / rate / self.time_base)
        self._last: int | None = None

    @staticmethod
    def suits(info: SourceInfo) -> bool:
        """Whether a source's rate is constant and its ticks do not express it."""
        rate = info.average_rate
        if rate is None or not info.steady or (1 / rate / info.time_base).denominator == 1:
            return False
        return _common_tick(rate, info.time_base) * _FINEST >= 1

    def stamp(self, encoded: av.VideoFrame, frame: SourceFrame) -> None:
        """Set the time of a frame to that of the rate, or to its own where they differ."""
        super().stamp(encoded, frame)
        unit, first = frame.time_base / self.time_base, self._first or 0
        since = (frame.pts - first) * unit
        nearest = round(since / self._step) * self._step
        on_grid = abs(nearest - since) <= unit
        pts = round(first * unit) + (nearest if on_grid else round(since))
        self._last = pts if self._last is None else max(pts, self._last + 1)
        encoded.pts, encoded.time_base = self._last, self.time_base
        encoded.duration = self._step if on_grid else round(frame.duration * unit)


def _common_tick(rate: Fraction, time_base: Fraction) -> Fraction:
    """The longest tick of which a frame and a tick of a source are whole numbers [s].

    Args:
        rate: of the frames [1/s].
        time_base: a tick of the source [s].
    """
    return Fraction(1, lcm(rate.numerator, time_base.denominator))
