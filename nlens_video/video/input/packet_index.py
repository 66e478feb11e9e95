"""Count, times and random access points of a file's frames, by its packets; nothing is decoded."""

from __future__ import annotations

from fractions import Fraction
from itertools import accumulate
from typing import TypeAlias

import av
from av.container import InputContainer
from av.video.stream import VideoStream
from msgspec import Struct

from nlens_video.core.errors import InputError
from nlens_video.video.input.open import InputHints, open_container, video_stream

_ONE_FRAME_A_PACKET = frozenset((
    "h264", "hevc", "vp9", "av1", "mpeg1video", "mpeg2video", "mpeg4", "prores", "dnxhd", "mjpeg",
    "ffv1", "ffvhuff", "huffyuv", "utvideo", "magicyuv", "v210", "rawvideo", "png", "qtrle", "cfhd",
    "jpeg2000",
))  # fmt: skip
"""Codecs whose key frames reset the decoder; not VP8, some of whose packets show no frame."""
_REORDERED = 64
"""Generous limit of the reordering delay: packets from decoding to display order [1]."""
Packet: TypeAlias = "av.Packet[VideoStream]"
_MOST_UNSTAMPED = 4096
"""Packets without a time stamp after which no stamped one is looked for [1]."""
_IDR, _SLICES = 5, range(1, 6)
"""H.264 NAL unit types: IDR slice, slices of any kind."""


class PacketIndex(Struct, frozen=True):
    """Frame times and random access points of a file.

    Attributes:
        pts: of the frames in display order [ticks].
        starts: numbers of the frames from which all later ones can be decoded, ascending [1].
    """

    pts: tuple[int, ...]
    starts: tuple[int, ...]

    def start_before(self, number: int, ticks: int = 0) -> int:
        """Last but one random access point before a frame: frames in between confirm the index.

        Args:
            number: of the frame.
            ticks: least distance, for packets of other streams [ticks].
        """
        limit = self.pts[number] - ticks
        early = [at for at in self.starts if at <= number and self.pts[at] <= limit]
        return early[-2] if len(early) > 1 else 0


def stated_frames(container: InputContainer, stream: VideoStream) -> int | None:
    """Number of frames that are shown, as a file states it; None where it does not [1].

    The header of an MP4 counts what is stored before the first fragment. FFmpeg's index of it has
    the fragments as well, and marks what its edit list leaves out.

    Args:
        container: an open file.
        stream: its video.
    """
    if stream.frames and "mp4" in container.format.name:
        return sum(not entry.is_discard for entry in stream.index_entries) or None
    return stream.frames or None


def index_until(spec: str, hints: InputHints, number: int) -> PacketIndex | None:
    """Read the packets up to a frame.

    Args:
        spec: a file.
        hints: the user's options.
        number: of the frame.

    Returns:
        None where packets are ambiguous (without times, damaged, to be discarded, of a codec that
        does not store one frame a packet) or where there are fewer.

    Raises:
        InputError: the file cannot be read.
    """
    container, _ = open_container(spec, hints)
    with container:
        stream = video_stream(container, spec)
        if stream.codec.name not in _ONE_FRAME_A_PACKET:
            return None
        times: list[int] = []
        keys: list[int] = []
        try:
            for packet in container.demux(stream):
                if not packet.size:
                    break
                if packet.pts is None or packet.is_corrupt or packet.is_discard:
                    return None
                if packet.is_keyframe and _is_start(packet, stream):
                    keys.append(len(times))
                times.append(packet.pts)
                if len(times) > number + _REORDERED:
                    break
        except av.FFmpegError as error:
            raise InputError(f"{spec}: cannot be read ({error.strerror})") from error
    return _checked(times, keys, number)


def start_before_zero(spec: str, hints: InputHints, rate: Fraction) -> int | None:
    """Time of the first frame of Matroska whose first packets have no time stamps [ticks].

    FFmpeg leaves out those before 0. None where there is no later one to count back from, and in
    other containers.

    Args:
        spec: a file.
        hints: the user's options.
        rate: of the frames [1/s].

    Raises:
        InputError: the file cannot be opened.
    """
    container, _ = open_container(spec, hints)
    with container:
        stream = video_stream(container, spec)
        if "matroska" not in container.format.name or stream.codec.name not in _ONE_FRAME_A_PACKET:
            return None
        times: list[int] = []
        unstamped = 0
        try:
            for packet in container.demux(stream):
                if not packet.size or len(times) > _REORDERED or unstamped > _MOST_UNSTAMPED:
                    break
                unstamped += packet.pts is None
                times += [] if packet.pts is None else [packet.pts]
        except av.FFmpegError:
            return None
        ticks = stream.time_base or Fraction(1, 1000)
        return min(times) - round(unstamped / rate / ticks) if times else None


def frame_time(spec: str, hints: InputHints, time_base: Fraction, number: int) -> Fraction | None:
    """Time of a frame by the packets up to it [s]; None where these do not tell it.

    Args:
        spec: a file.
        hints: the user's options.
        time_base: of the file's video stream [s].
        number: of the frame.

    Raises:
        InputError: the file cannot be read.
    """
    index = index_until(spec, hints, number)
    return None if index is None else index.pts[number] * time_base


def _checked(times: list[int], keys: list[int], number: int) -> PacketIndex | None:
    """The index; key frames count that no later packet precedes in display order."""
    if len(set(times)) < len(times) or len(times) <= number or keys[:1] != [0]:
        return None
    latest = list(accumulate(times, max))
    earliest = list(accumulate(reversed(times), min))[::-1]
    starts = tuple(
        at for at in keys if times[at] == earliest[at] and (at == 0 or latest[at - 1] < times[at])
    )
    return PacketIndex(tuple(sorted(times)), starts)


def _is_start(packet: Packet, stream: VideoStream) -> bool:
    """Whether no later frame refers to one before a key frame.

    H.264 also flags recovery points of gradual decoder refresh as key frames; these do not count.
    """
    if stream.codec.name != "h264":
        return True
    return _first_slice(bytes(packet), stream.codec_context.extradata or b"") == _IDR


def _first_slice(data: bytes, extradata: bytes) -> int:
    """Type of the first H.264 NAL unit that is a slice, 0 without one."""
    if extradata[:1] != b"\x01":  # start codes
        at = data.find(b"\x00\x00\x01")
        while 0 <= at < len(data) - 3:
            if data[at + 3] & 31 in _SLICES:
                return data[at + 3] & 31
            at = data.find(b"\x00\x00\x01", at + 3)
        return 0
    at, width = 0, (extradata[4] & 3) + 1
    while at + width < len(data):
        if data[at + width] & 31 in _SLICES:
            return data[at + width] & 31
        at += width + int.from_bytes(data[at : at + width], "big")
    return 0
