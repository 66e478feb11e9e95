"""The source's other streams on their way into a result: as they are, encoded anew, or left out."""

from __future__ import annotations

from fractions import Fraction

import av
import av.container
from av.stream import Disposition, Stream
from av.video.stream import VideoStream

from nlens_video.video.info import CopiedStream, Packet, SourceInfo
from nlens_video.video.output.audio import AudioEncoder
from nlens_video.video.output.containers import copy_of, holds_stream
from nlens_video.video.output.muxers import MP4_FAMILY
from nlens_video.video.output.subtitles import SubtitleEncoder

_SKIPPED_METADATA = ("major_brand", "minor_version", "compatible_brands", "encoder")
_OF_THE_OLD_PICTURES = (
    "encoder",
    "duration",
    "bps",
    "number_of_",
    "_statistics_",
    "rotate",
    "alpha_mode",
)
"""Beginnings of tags that no longer hold once pictures are encoded anew."""
_TIMECODE = ("mov", "mp4", "mxf", "matroska", "webm", "nut", "dv", "gxf")
"""Containers that hold the timecode of the first frame."""
_COVERS = {"mjpeg": ("jpg", "image/jpeg"), "png": ("png", "image/png")}


class Carried:
    """Streams that travel along.

    Args:
        container: the result, whose pictures have their stream already.
        info: the source.

    Attributes:
        notes: what becomes of those that cannot stay as they are.
        left_out: packets that were damaged so far [1].
    """

    def __init__(self, container: av.container.OutputContainer, info: SourceInfo) -> None:
        self.left_out = 0
        self._container = container
        self._name = container.format.name
        self._targets: dict[int, Stream | AudioEncoder | SubtitleEncoder] = {}
        self._covers: list[tuple[Stream, bytes]] = []
        added = [self._add(stream) for stream in info.copied]
        self.notes = tuple(note for note in added if note)
        if _has_timecode(info) and self._name not in _TIMECODE:
            self.notes += (f"the timecode is left out: {self._name} has no place for it",)
        for key, value in info.metadata.items():
            if key not in _SKIPPED_METADATA:
                container.metadata[key] = value
        if info.chapters:
            container.set_chapters(list(info.chapters))

    def begin(self) -> None:
        """Write what comes before all packets; the result's streams are complete."""
        for stream, picture in self._covers:
            packet = av.Packet(picture)
            packet.pts = packet.dts = 0
            packet.time_base, packet.stream = Fraction(1, 1000), stream
            packet.is_keyframe = True
            self._container.mux(packet)
        self._covers = []

    def write(self, packet: Packet) -> None:
        """Carry over a packet; one of a stream that is left out: nothing.

        One that is damaged, or whose time steps back, is left out and counted.

        Raises:
            av.FFmpegError: the disk is full, or the container refuses it.
        """
        target = self._targets.get(packet.stream.index)
        try:
            if isinstance(target, (AudioEncoder, SubtitleEncoder)):
                self._container.mux(target.encode(packet))
            elif target is not None:
                packet.stream = target
                self._container.mux(packet)
        except (av.InvalidDataError, av.ArgumentError):
            self.left_out += 1

    def finish(self) -> None:
        """Write what encoders still hold."""
        for target in self._targets.values():
            if isinstance(target, AudioEncoder):
                self._container.mux(target.encode(None))

    def _add(self, stream: CopiedStream) -> str:
        """Make room for a stream; a note where it does not stay as it is."""
        label = f"stream {stream.index} ({'cover' if stream.cover else stream.type})"
        if stream.cover:
            return self._add_cover(stream, label)
        if holds_stream(self._name, stream):
            self._targets[stream.index] = copy_of(self._container, stream.stream)
            return ""
        if stream.type not in ("audio", "subtitle"):
            return f"{label} is left out: {self._name} does not hold {stream.codec or 'it'}"
        try:
            encoder = self._encoder(stream)
        except ValueError as error:
            return f"{label} is left out: {error}"
        self._targets[stream.index] = encoder
        return f"{label} becomes {encoder.codec}: {self._name} does not hold its codec"

    def _encoder(self, stream: CopiedStream) -> AudioEncoder | SubtitleEncoder:
        if stream.type == "audio":
            return AudioEncoder(self._container, stream.stream)
        return SubtitleEncoder(self._container, stream.stream)

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


def _has_timecode(info: SourceInfo) -> bool:
    return "timecode" in map(str.lower, (*info.stream_metadata, *info.metadata))


def set_tags(stream: VideoStream, info: SourceInfo) -> None:
    """Give the new pictures the tags and dispositions of the old ones."""
    for key, value in info.stream_metadata.items():
        if not key.lower().startswith(_OF_THE_OLD_PICTURES):
            stream.metadata[key] = value
    if stream.pix_fmt == "yuva420p" and stream.name in ("libvpx", "libvpx-vp9"):
        stream.metadata["alpha_mode"] = "1"
    stream.disposition = Disposition(info.disposition)


def sample_entry(container: str, codec: str) -> str:
    """The name of a codec in a container where FFmpeg's own choice is not the best, else empty.

    Apple's players take HEVC as `hvc1` only, whose parameter sets are all in the header, as here.
    """
    return "hvc1" if container in MP4_FAMILY and codec == "libx265" else ""
