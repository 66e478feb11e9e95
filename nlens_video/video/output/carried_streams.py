"""The source's other streams in a result: copied, encoded anew, or left out."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import av
import av.container
from av.bitstream import BitStreamFilterContext
from av.stream import Stream

from nlens_video.video.info import CopiedStream, Packet, SourceInfo
from nlens_video.video.output.audio import AudioEncoder, SubtitleEncoder
from nlens_video.video.output.containers import MP4_FAMILY, copy_of, holds_stream, start_codes
from nlens_video.video.output.tags import set_file_tags, set_languages
from nlens_video.video.times.start import begins_at_zero, moved_sound

_PAIRED = ("mxf", "dv")
"""Containers whose muxers hold pictures until the streams of sound reach them, or drop them."""
_LATEST_SOUND_S = 10
"""How long such a container waits for sound before there is silence, as FFmpeg's other muxers do:
the pictures wait in memory."""
_MISSED_S = Fraction(1, 4)
"""Sound after the pictures that is missed [s]; packets at the end reach as far as 0.1 s."""
_COVERS = {"mjpeg": ("jpg", "image/jpeg"), "png": ("png", "image/png")}


class _Written(NamedTuple):
    """A packet that was copied.

    Attributes:
        packet: with the times that the muxer got.
        at_s: its own decoding time, None where unknown [s].
    """

    packet: Packet
    at_s: Fraction | None


class CarriedStreams:
    """The other streams of a result, and its tags.

    Args:
        container: the result, whose video stream exists.
        info: the source.

    Attributes:
        notes: on streams that are encoded anew or left out.
    """

    def __init__(self, container: av.container.OutputContainer, info: SourceInfo) -> None:
        self._refused = 0
        self._ends_s = info.ends_s
        self._frame_s = 1 / (info.average_rate or Fraction(25))
        self._container = container
        self._name = container.format.name
        self._types = {one.index: one.type for one in info.copied}
        self._filters: dict[int, BitStreamFilterContext] = {}
        self._targets: dict[int, Stream | AudioEncoder | SubtitleEncoder] = {}
        self._covers: list[tuple[Stream, bytes]] = []
        self._hidden: dict[int, Packet] = {}  # the last packet of each sound that is not shown
        self._last: dict[int, _Written] = {}
        # videos whose first key frame has not come, and whether other packets have
        self._awaited: dict[int, bool] = {}
        self._found: list[str] = []
        added = [self._add(stream) for stream in info.copied]
        self.notes = (
            *(note for note in added if note), *set_languages(container),
            *set_file_tags(container, info),
        )  # fmt: skip

    @property
    def later_notes(self) -> tuple[str, ...]:
        """On what has been found so far: videos of a range, sound that changes, damaged packets."""
        empty = (
            f"stream {index} (video) has no pictures: the range holds none of its key frames"
            for index, skipped in self._awaited.items() if skipped
        )  # fmt: skip
        changed = (
            f"stream {index} (audio) {encoder.changed}"
            for index, encoder in self._encoders.items() if encoder.changed
        )  # fmt: skip
        count = self._refused + sum(encoder.damaged for encoder in self._encoders.values())
        lost = f"{count} damaged packets of sound or other streams were left out"
        return (*self._found, *empty, *changed, *((lost,) if count else ()))

    def begin(self) -> None:
        """Write the covers, which come before all packets; call once all streams are added."""
        for stream, picture in self._covers:
            packet = av.Packet(picture)
            packet.pts = packet.dts = 0
            packet.time_base, packet.stream = Fraction(1, 1000), stream
            packet.is_keyframe = True
            self._container.mux(packet)
        self._covers = []

    def keep_up(self, pictures: int) -> None:
        """Put silence where a container has waited for sound too long.

        Args:
            pictures: how many are written so far [1].
        """
        if self._name in _PAIRED:
            for encoder in self._encoders.values():
                self._container.mux(encoder.fill(pictures * self._frame_s - _LATEST_SOUND_S))

    def write(self, packet: Packet) -> None:
        """Write a packet, unless its stream is left out.

        Damaged packets, and those whose time steps back, are left out and counted. What an edit
        list hides is left out too. A video of a range begins with a key frame, since nothing
        before one can be decoded.

        Raises:
            av.FFmpegError: the disk is full, or the container refuses it.
        """
        index = packet.stream_index  # a lost connection is closed, and its streams are gone
        if index in self._awaited and not self._begins(packet):
            return
        target = self._targets.get(index)
        if self._ends_s is not None and self._types.get(index) == "subtitle":
            _end_by(packet, self._ends_s)
        try:
            if isinstance(target, SubtitleEncoder) and packet.is_discard:
                return
            if isinstance(target, (AudioEncoder, SubtitleEncoder)):
                self._container.mux(target.encode(packet))
            elif target is not None:
                for shown in self._shown(packet):
                    self._copy(shown, target)
        except (av.InvalidDataError, av.ArgumentError):
            self._refused += 1

    def finish(self, pictures: int) -> None:
        """Flush the encoders; call after all pictures.

        Args:
            pictures: how many there are [1].
        """
        paired = self._name in _PAIRED
        until_s = pictures * self._frame_s if paired else Fraction(0)
        for index, encoder in self._encoders.items():
            self._container.mux(encoder.finish(until_s))
            if paired and (cut_s := encoder.end_s - until_s) >= _MISSED_S:
                self._found.append(
                    f"stream {index} (audio) loses its last {float(cut_s):.2f} s: {self._name} "
                    "holds no sound after the pictures; .mov, .mkv and .mp4 files do"
                )

    @property
    def _encoders(self) -> dict[int, AudioEncoder]:
        """Those of sound, by the stream's number."""
        found = self._targets.items()
        return {index: one for index, one in found if isinstance(one, AudioEncoder)}

    def _add(self, stream: CopiedStream) -> str:
        """Add a stream; a note where it is not copied."""
        label = f"stream {stream.index} ({'cover' if stream.cover else stream.type})"
        if stream.cover:
            return self._add_cover(stream, label)
        moved = moved_sound(self._name, stream)
        paired = stream.type == "audio" and self._name in _PAIRED
        if not moved and not paired and holds_stream(self._name, stream):
            self._targets[stream.index] = target = copy_of(self._container, stream.stream)
            if found := start_codes(self._name, stream.stream, target):
                self._filters[stream.index] = found
            if stream.cut and stream.type == "video":
                self._awaited[stream.index] = False
            return ""
        if stream.type not in ("audio", "subtitle"):
            return f"{label} is left out: {self._name} does not hold {stream.codec or 'it'}"
        try:
            encoder: AudioEncoder | SubtitleEncoder
            if stream.type == "audio":
                zero = begins_at_zero(self._name)
                encoder = AudioEncoder(self._container, stream.stream, from_zero=zero)
            else:
                encoder = SubtitleEncoder(self._container, stream.stream)
        except ValueError as error:
            return f"{label} is left out: {error}"
        self._targets[stream.index] = encoder
        lost = ""
        if isinstance(encoder, AudioEncoder):
            if encoder.exact and not moved:
                return ""
            lost = f"; {encoder.fewer}" if encoder.fewer else ""
        why = moved or f"{self._name} does not hold its codec"
        return f"{label} becomes {encoder.codec}: {why}{lost}"

    def _shown(self, packet: Packet) -> list[Packet]:
        """Packets to copy for one of the source's, which an edit list may hide.

        A video is decoded from its hidden packets on, sound from the last one of them on: its first
        samples overlap. Where there are no times that one would delay the sound.
        """
        index = packet.stream_index
        kind = self._types[index]
        if self._name in MP4_FAMILY or kind == "video":
            return [packet]
        if packet.is_discard:
            if kind == "audio" and not begins_at_zero(self._name):
                self._hidden[index] = packet
            return []
        before = self._hidden.pop(index, None)
        return [packet] if before is None else [before, packet]

    def _copy(self, packet: Packet, target: Stream) -> None:
        """Write a packet; most muxers refuse one at the time of the packet before it.

        Some recorders write such sound, and rounding to a muxer's ticks makes it.
        """
        index = packet.stream_index
        if index in self._filters:
            base = packet.time_base
            (packet,) = self._filters[index].filter(packet)
            packet.time_base = base
        dts, last = packet.dts, self._last.get(index)
        at_s = None if dts is None else dts * Fraction(packet.time_base or 1)
        packet.stream = target
        try:
            self._container.mux(packet)
        except av.ArgumentError:
            if packet.is_corrupt or last is None or last.packet.dts is None:
                raise
            if at_s is None or last.at_s is None or at_s < last.at_s:
                raise
            packet.dts = last.packet.dts + 1
            packet.pts = packet.dts if packet.pts is None else max(packet.pts, packet.dts)
            self._container.mux(packet)
        self._last[index] = _Written(packet, at_s)

    def _begins(self, packet: Packet) -> bool:
        """Whether a packet is the first key frame of a video; notes how late it is."""
        index = packet.stream_index
        if not packet.is_keyframe:
            self._awaited[index] = True
            return False
        if self._awaited.pop(index) and packet.pts is not None and packet.time_base:
            late_s = float(packet.pts * packet.time_base)
            self._found.append(
                f"stream {index} (video) begins {late_s:.3f} s later, at its first key frame in "
                "the range"
            )
        return True

    def _add_cover(self, stream: CopiedStream, label: str) -> str:
        if self._name == "matroska" and stream.codec in _COVERS:
            ending, kind = _COVERS[stream.codec]
            name = stream.stream.metadata.get("filename", f"cover.{ending}")
            self._container.add_attachment(name, kind, stream.cover)
        elif self._name in ("mp4", "ipod") and stream.codec in (*_COVERS, "bmp"):
            self._covers.append((copy_of(self._container, stream.stream), stream.cover))
        else:
            return f"{label} is left out: {self._name} has no place for it"
        return ""


def _end_by(packet: Packet, end_s: Fraction) -> None:
    """Let a packet end no later than at a time [s]."""
    begun = packet.pts if packet.pts is not None else packet.dts
    if begun is not None and packet.time_base and packet.duration:
        packet.duration = min(packet.duration, max(0, round(end_s / packet.time_base) - begun))
