"""Presentation times on their way through encoders, some of which only know a fixed rate."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, TypeAlias

import av

from nlens_video.video.info import SourceFrame, SourceInfo

if TYPE_CHECKING:
    from av.video.stream import VideoStream

Packets: TypeAlias = "list[av.Packet[VideoStream]]"
_FIXED_RATE = ("mpeg1video", "mpeg2video")
_MPEG4_LARGEST = 65535
"""Largest denominator of a time base in an MPEG-4 part 2 header."""

_LONGEST_DELAY_S = 60  # between decoding and showing a frame: more is no delay but an error


class EncoderClock:
    """Passes pts through exactly.

    Attributes:
        time_base: in which the encoder counts [s].
    """

    def __init__(self, info: SourceInfo) -> None:
        self.time_base = info.time_base

    def stamp(self, encoded: av.VideoFrame, frame: SourceFrame) -> None:
        """Give the frame to encode its time."""
        encoded.pts, encoded.time_base = frame.pts, frame.time_base
        encoded.duration = frame.duration

    def retimed(self, packets: Packets) -> Packets:
        """The encoder's packets at the source's times."""
        for packet in packets:
            # x265 leaves dts to chance in clips shorter than its reordering delay
            if packet.pts is not None and packet.dts is not None and packet.time_base:
                if abs(packet.pts - packet.dts) * packet.time_base > _LONGEST_DELAY_S:
                    packet.dts = packet.pts
        return packets


class FixedRateClock(EncoderClock):
    """Counts frames for the encoder and gives its packets the source's times back."""

    def __init__(self, info: SourceInfo, rate: Fraction) -> None:
        super().__init__(info)
        self.time_base = 1 / rate
        self._source = info.time_base
        self._first: int | None = None
        self._last = -1

    def stamp(self, encoded: av.VideoFrame, frame: SourceFrame) -> None:
        """Give the frame to encode the nearest free step of the rate."""
        if self._first is None:
            self._first = frame.pts
        step = round((frame.pts - self._first) * self._source / self.time_base)
        self._last = max(step, self._last + 1)
        encoded.pts, encoded.time_base, encoded.duration = self._last, self.time_base, 1

    def retimed(self, packets: Packets) -> Packets:
        """The encoder's packets, counted from the first frame's pts."""
        for packet in packets:
            scale = self.time_base / self._source
            first = self._first or 0
            packet.pts = None if packet.pts is None else first + round(packet.pts * scale)
            packet.dts = None if packet.dts is None else first + round(packet.dts * scale)
            packet.duration = round(scale)
            packet.time_base = self._source
        return packets


def encoder_clock(codec: str, container: str, info: SourceInfo) -> EncoderClock:
    """The clock that an encoder and a container can do with."""
    fixed = codec in _FIXED_RATE or container == "yuv4mpegpipe"
    # AVI has a place for each tick of its clock, not for times; readers take the ticks for frames.
    fixed |= container == "avi" and info.steady
    fine = codec == "mpeg4" and info.time_base.denominator > _MPEG4_LARGEST
    if fixed or fine:
        return FixedRateClock(info, info.average_rate or Fraction(25))
    return EncoderClock(info)
