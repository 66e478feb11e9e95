"""Reopening of a lost device or URL; frame numbers and times continue."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from fractions import Fraction

from msgspec.structs import replace

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Picture
from nlens_video.video.info import Packet, SourceFrame
from nlens_video.video.input.changed_frames import Conform
from nlens_video.video.interfaces import Source, SwitchingSource
from nlens_video.video.pixels.picture import AvPicture

_RETRY_S = 0.5
_PROMPT_FRAMES = 512
"""Among so many frames, the one that came soonest after its time came without delay [1]."""


class Arrivals:
    """When the frames of a connection come, against their times in the output.

    The first frames wait until FFmpeg knows the streams, the last ones may wait for a timeout: the
    promptest frames tell how the output's times and the clock belong together.

    Args:
        opened_s: when the first frame had come, by the clock [s].
        first: its time in the output [s].
    """

    def __init__(self, opened_s: float, first: Fraction) -> None:
        self._first_lag_s = self._least_lag_s = opened_s - float(first)
        self._last_lags_s = deque([self._first_lag_s], maxlen=_PROMPT_FRAMES)
        self._seen = 0

    def see(self, moment: Fraction, now_s: float) -> None:
        """Note a frame.

        Args:
            moment: its time in the output [s].
            now_s: when it came, by the clock [s].
        """
        lag_s = now_s - float(moment)
        self._last_lags_s.append(lag_s)
        if self._seen < _PROMPT_FRAMES:
            self._seen += 1
            self._least_lag_s = min(self._least_lag_s, lag_s)

    def following(self, opened_s: float) -> float:
        """Time in the output of the first frame of the next connection [s].

        It is taken to have waited as long as the first frame of this one.

        Args:
            opened_s: when it had come, by the clock [s].
        """
        waited_s = self._first_lag_s - self._least_lag_s
        return opened_s - waited_s - min(self._last_lags_s)


class Reconnecting(SwitchingSource):
    """A source that is reopened when it ends, until it stays away or is closed.

    Frame numbers continue. Times skip the gap: the first frame of a new connection is as much later
    as the clock says (see `Arrivals`), and packets of other streams (sound) are shifted by the same
    amount. Streams that the first connection did not have are left out. Frames of another size or
    format become as those of the first, as where they change within a source.

    Args:
        connect: opens the source within a time, None for as long as it takes [s].
        patience_s: how long to wait for a lost source [s].

    Attributes:
        lost: reconnections so far [1].

    Raises:
        InputError: it cannot be opened the first time.
    """

    def __init__(self, connect: Callable[[float | None], Source], patience_s: float) -> None:
        super().__init__(connect(None))
        self._opened_s = time.monotonic()  # the first frame of the connection has come
        self._connect = connect
        self._patience_s = patience_s
        self._closed = threading.Event()
        # from this connection's times to the output's [s], None before its first frame
        self._shift: Fraction | None = Fraction(0)
        self._waiting: list[Packet] = []  # for the shift
        self._packet_ends: dict[int, Fraction] = {}  # last time by stream [s]
        self._start: Fraction | None = None  # of the first frame [s]
        self._last = Fraction(0)  # time of the last frame in the output [s]
        self._conform: Conform | None = None
        self._arrivals: Arrivals | None = None  # of this connection, or the last before it
        self.lost = 0

    def close(self) -> None:
        """Close the connection and stop waiting for another."""
        self._closed.set()
        super().close()

    def __iter__(self) -> Iterator[SourceFrame]:
        index = 0
        while True:
            self._connection.packet_sink = self._forward
            begins = True
            for frame in self._connection:
                if begins:
                    shift, arrivals = self._begin(_seconds(frame))
                    begins = False
                moment = _seconds(frame) + shift
                arrivals.see(moment, time.monotonic())
                if self._start is None:
                    self._start = moment
                    self._conform = self._form_of(frame)
                yield self._retimed(frame, index, moment)
                self._last = moment
                index += 1
            if not self._reconnect():
                return

    def warnings(self) -> tuple[str, ...]:
        """Irregularities of the connections so far, other than damaged packets."""
        return (*super().warnings(), *(self._conform.notes() if self._conform else ()))

    def _form_of(self, first: SourceFrame) -> Conform:
        assert isinstance(first.picture, AvPicture)  # what can be reopened is read by FFmpeg
        return Conform(first.picture.frame, self.info, self.info.sample_aspect_ratio)

    def _conformed(self, picture: Picture, index: int) -> Picture:
        """A picture of a later connection in the form of the first one's."""
        assert isinstance(picture, AvPicture)
        assert self._conform is not None
        made = self._conform(picture.frame, index, self._connection.info.sample_aspect_ratio)
        if made is picture.frame:
            return picture
        return AvPicture(
            made, self.info.tags, orientation=self.info.orientation,
            chroma_siting=self.info.chroma_siting,
        )  # fmt: skip

    def _retimed(self, frame: SourceFrame, index: int, moment: Fraction) -> SourceFrame:
        """A frame as the output has it: its number, time and form."""
        if not self.lost:
            return frame
        pts = round(moment / self.info.time_base)
        duration = round(frame.duration * frame.time_base / self.info.time_base)
        return replace(
            frame, index=index, pts=pts, time_base=self.info.time_base, duration=duration,
            time_s=float(moment - (self._start or 0)),
            picture=self._conformed(frame.picture, index),
        )  # fmt: skip

    def _begin(self, first: Fraction) -> tuple[Fraction, Arrivals]:
        """Shift of a connection's times, at least a frame after the last before it; its arrivals.

        Args:
            first: time of its first frame [s].
        """
        if self._arrivals is not None:
            step = 1 / (self.info.average_rate or Fraction(25))
            by_clock = Fraction(self._arrivals.following(self._opened_s))
            moment = max(self._last + step, by_clock.limit_denominator(1_000_000))
            self._shift = moment - first
            for packet in self._waiting:
                self._forward(packet)
            self._waiting.clear()
        shift = self._shift or Fraction(0)
        self._arrivals = Arrivals(self._opened_s, first + shift)
        return shift, self._arrivals

    def _reconnect(self) -> bool:
        """Wait for the source and open it again; whether it came back."""
        self._connection.close()
        deadline = time.monotonic() + self._patience_s
        while not self._closed.wait(_RETRY_S):
            left_s = deadline - time.monotonic()
            try:
                again = self._connect(max(left_s, _RETRY_S))  # a listener, say, waits for good
            except InputError:
                if time.monotonic() > deadline:
                    return False
                continue
            self._opened_s = time.monotonic()
            self._switch_to(again)
            self._shift = None
            self.lost += 1
            return True
        return False

    def _forward(self, packet: Packet) -> None:
        """Pass on a packet in the output's time; drop those of new streams and of earlier times."""
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
        if self.lost and moment <= self._packet_ends.get(stream.index, moment - 1):
            return
        self._packet_ends[stream.index] = moment
        self.packet_sink(packet)


def _seconds(frame: SourceFrame) -> Fraction:
    return frame.pts * frame.time_base
