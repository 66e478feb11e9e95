"""Repair of irregular sources: time stamps, damaged and truncated files."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from fractions import Fraction
from heapq import heappop, heappush

import av
import av.container
from av.stream import Stream
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from nlens_video.video.info import Packet, SourceInfo, is_cover
from nlens_video.video.input.open import DECODER

BACK_S = 1
"""Time stamps of frames that step back by more restart, as in concatenated recordings [s]."""
_AHEAD_S = 10
"""Time stamps further beyond the stated length are wrong [s]."""
_LONGEST_PAUSE_S = 24 * 3600
"""Between two frames of a source without a stated length [s]."""
_SHARE = Fraction(1, 20)
"""Part of the stated length that a complete file may lack: lengths are often rounded [1]."""
_SLACK_S = Fraction(1, 5)
_PARSED = 3
"""Packets that a demuxer parses at once: it may mark an earlier one than the last read [1]."""
_REORDERED = 16
"""Frames by which a picture may be shown later than it is decoded [1]."""


def begins_anew(packet: Packet, last: int | None) -> bool:
    """Whether another recording begins with a packet: its decoding time steps back by a frame.

    Args:
        packet: of the pictures.
        last: decoding time of the one before it, None where unknown [ticks].
    """
    if packet.dts is None or last is None or not packet.time_base:
        return False
    unit = Fraction(packet.time_base)
    return (packet.dts - last) * unit <= -min((packet.duration or 0) * unit or BACK_S, BACK_S)


class SourceClock:
    """Monotonic presentation times: a frame's own, or one frame after the last where that is wrong.

    Args:
        info: the source.

    Attributes:
        time_base: seconds per tick [s].
        repaired: frames whose time stamp was replaced [1].
        frames: so far [1].
        step: from a frame to the next [ticks].
        offsets: what is added since each step back in time that still holds [ticks].
        joined: whether times begin anew with the next frame that is not later than the last: what
            steps back by less than `BACK_S` else came out of turn.
    """

    def __init__(self, info: SourceInfo) -> None:
        self.time_base = info.time_base
        self.repaired = self.frames = 0
        self.offsets: list[int] = []
        self.joined = False
        self._exact_step = 1 / (info.average_rate or 25) / info.time_base
        self.step = max(1, round(self._exact_step))
        self._length_s = info.duration_s
        self._shift = self._surplus = 0
        self._first: int | None = None
        self._last = self._stamped = 0
        self._unstamped = 0  # frames since the last one with a time stamp

    def tick(self, pts: int | None) -> int:
        """The frame's pts, later than that of the frame before [ticks]."""
        self.frames += 1
        if self._first is None:
            self.repaired += pts is None
            self._first = self._last = pts or 0
        else:
            self._last = self._after(pts)
        if pts is not None:
            self._stamped, self._unstamped = self._last, 0
        return self._last

    def _after(self, pts: int | None) -> int:
        following = self._last + self.step
        if pts is None:
            self.repaired += 1
            self._unstamped += 1
            since = round(self._unstamped * self._exact_step)
            return max(self._stamped + since, self._last + 1)
        if self._fits_unshifted(pts):
            self._shift = 0
            self.offsets = []
        elif self._is_leap(pts + self._shift):
            # one wrong time stamp, or an offset of all that follow, until unshifted ones fit again
            back = pts + self._shift < self._last
            self._shift = following - pts
            self.offsets += [self._shift] if back else []
            self.joined = False
            self.repaired += 1
        if pts + self._shift <= self._last:
            self.repaired += 1
            self._surplus += 1
        return max(pts + self._shift, self._last + 1)

    def _fits_unshifted(self, pts: int) -> bool:
        """Whether a time stamp [ticks] follows the last frame at least as well as shifted.

        So one frame that is given again, with its old time, shifts none of those after it.
        """
        following = self._last + self.step
        shifted = abs(pts + self._shift - following)
        return not self._is_leap(pts) and abs(pts - following) <= shifted

    def _is_leap(self, pts: int) -> bool:
        """Whether a time stamp is implausibly far from the last frame's."""
        if self.joined and pts < self._last:
            return True
        distance_s = (pts - self._last) * self.time_base
        if self._length_s is None:
            return not -BACK_S < distance_s < _LONGEST_PAUSE_S
        beyond_s = (pts - (self._first or 0)) * self.time_base - Fraction(self._length_s)
        return distance_s <= -BACK_S or (distance_s > _AHEAD_S and beyond_s > _AHEAD_S)

    def missing_before(self, pts: int) -> int:
        """Number of frames that fit between the last frame and `pts`; call once, before `tick` [1].

        Frames that came out of turn, for which there was no time, take the places of missing ones.
        """
        if self._first is None:
            return 0
        shifted = pts if self._fits_unshifted(pts) else pts + self._shift
        if self._is_leap(shifted):
            return 0
        fit = max(0, round((shifted - self._last) / self.step) - 1)
        taken = min(fit, self._surplus)
        self._surplus -= taken
        return fit - taken

    def seconds(self, pts: int) -> float:
        """Time since the first frame [s]."""
        return float((pts - (self._first or 0)) * self.time_base)

    def notes(self) -> tuple[str, ...]:
        """A note on replaced time stamps."""
        if not self.repaired:
            return ()
        frames = "frame" if self.repaired == 1 else "frames"
        return (
            f"{self.repaired} {frames} without a time stamp that makes sense: "
            "each follows the last",
        )


class Durations:
    """How long frames last.

    MP4 states the time until the next picture is decoded, not shown: of pictures in another order
    a gap belongs to another one. A frame ends where one follows that was read, or with the stream.

    Args:
        stream: the source's video.
    """

    def __init__(self, stream: VideoStream) -> None:
        self._ahead: list[int] = []
        length = stream.duration
        self._end = None if length is None else (stream.start_time or 0) + length

    def read(self, packet: Packet) -> None:
        """Note a packet before it is decoded."""
        if packet.pts is not None and not packet.is_discard:
            heappush(self._ahead, packet.pts)

    def of(self, frame: av.VideoFrame) -> int:
        """Duration of a decoded frame, in the order of display; 0 where unknown [ticks]."""
        stated, pts = frame.duration or 0, frame.pts
        if pts is None:
            return stated
        while self._ahead and self._ahead[0] <= pts:
            heappop(self._ahead)
        ends = [self._end, *self._ahead[:1]]
        return min([stated, *(end - pts for end in ends if end is not None and end > pts)])


class Damage:
    """Where the packets of the pictures are damaged: gaps in time there are lost pictures.

    Attributes:
        count: damaged packets and frames so far [1].
    """

    def __init__(self) -> None:
        self.count = 0
        self._at: deque[int] = deque(maxlen=4 * _REORDERED)
        self._since_mark = _PARSED
        self._last: int | None = None

    def read(self, packet: Packet) -> None:
        """Note a packet before it is decoded; demuxers mark those of which something is missing.

        Where recordings are joined they mark one of the last before, of which nothing is.
        """
        if self._since_mark < _PARSED and begins_anew(packet, self._last):
            self.count -= 1
            self._at.pop()
        self._since_mark += 1
        self._last = packet.dts
        if packet.is_corrupt:
            self._since_mark = 0
            self.add(packet.pts)

    def add(self, pts: int | None = None) -> None:
        """Count what cannot be read or decoded, at its time or the last packet's [ticks]."""
        self.count += 1
        self._at.append((self._last or 0) if pts is None else pts)

    def see(self, frame: av.VideoFrame) -> None:
        """Count a decoded frame if it is damaged."""
        if frame.is_corrupt:
            self.add(frame.pts)

    def is_near(self, last: int | None, pts: int, step: int) -> bool:
        """Whether pictures between two others may be lost, and not only far apart.

        Args:
            last: time stamp of the first, None where unknown [ticks].
            pts: of the second [ticks].
            step: from a frame to the next [ticks].
        """
        first = (pts if last is None else last) - _REORDERED * step
        return any(first <= at <= pts + _REORDERED * step for at in self._at)


def salvaged(stream: VideoStream, packet: Packet | None) -> list[av.VideoFrame]:
    """What a lenient decoder makes of a damaged picture file, nothing where it refuses it too."""
    decoder = av.CodecContext.create(stream.codec_context.name, "r")
    assert isinstance(decoder, VideoCodecContext)
    decoder.options = DECODER
    try:
        return decoder.decode(packet)
    except av.FFmpegError:
        return []


class Completeness:
    """Detects truncated files: compares the stated duration with the times of the packets.

    Frame counts do not serve: edit lists, variable rates and a later start make counts differ in
    complete files. All streams count, as any of them may be the longest.

    Args:
        container: the file.
        streams: those whose packets are read.
    """

    def __init__(self, container: av.container.InputContainer, streams: Sequence[Stream]) -> None:
        timed = [one for one in streams if one.type != "attachment" and not is_cover(one)]
        known = [end for end in map(_end_s, timed) if end is not None]
        whole = container.duration
        self._stated_s = Fraction(whole, av.time_base) if whole else None
        if len(known) == len(timed):
            self._stated_s = max(known)
        self._last_s: dict[int, Fraction] = {}
        self._reached_s = self._longest_s = Fraction(0)

    def count(self, packet: Packet) -> None:
        """Count a packet."""
        if packet.pts is None or not packet.time_base:
            return
        start_s = packet.pts * Fraction(packet.time_base)
        last_s = self._last_s.get(packet.stream.index, start_s)
        self._longest_s = max(self._longest_s, start_s - last_s)
        self._last_s[packet.stream.index] = max(last_s, start_s)
        end_s = start_s + (packet.duration or 0) * Fraction(packet.time_base)
        self._reached_s = max(self._reached_s, end_s)

    def notes(self) -> tuple[str, ...]:
        """A note on a truncated file; call after its last packet."""
        if self._stated_s is None:
            return ()
        slack_s = max(self._stated_s * _SHARE, 2 * self._longest_s, _SLACK_S)
        if self._reached_s >= self._stated_s - slack_s:
            return ()
        return (
            f"the source says that it lasts {float(self._stated_s):.2f} s and ends after "
            f"{float(self._reached_s):.2f} s: it is cut short or damaged",
        )


def _end_s(stream: Stream) -> Fraction | None:
    """End of a stream by its header [s]."""
    if stream.duration is None or stream.time_base is None:
        return None
    return ((stream.start_time or 0) + stream.duration) * Fraction(stream.time_base)
