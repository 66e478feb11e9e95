"""Frames out of anything that FFmpeg reads, in their own samples and at their own time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from fractions import Fraction
from types import TracebackType
from typing import Protocol, Self, TypeAlias

import av
import av.container
import av.video.stream
from av.sidedata.sidedata import Type as SideDataType
from av.stream import Stream

from nlens_video.errors import InputError, UsageError
from nlens_video.video.exr_source import ExrSource
from nlens_video.video.info import CopiedStream, FrameTags, Kind, Packet, SourceFrame, SourceInfo
from nlens_video.video.opening import InputHints, open_container, video_stream
from nlens_video.video.picture import AvPicture
from nlens_video.video.samples import frame_tags

PacketSink: TypeAlias = Callable[[Packet], None]
_SRGB_TRC = 13
_CENTRED_CHROMA = ("mjpeg", "mpeg1video")
"""Codecs whose 4:2:0 and 4:2:2 have chroma midway between luma columns (JFIF, ISO 11172-2)."""
_HDR_METADATA = (
    SideDataType.MASTERING_DISPLAY_METADATA, SideDataType.CONTENT_LIGHT_LEVEL,
    SideDataType.DYNAMIC_HDR_PLUS, SideDataType.DOVI_METADATA,
)  # fmt: skip
_RETRIES = 8
"""Read errors in a row after which a source counts as ended."""


class Source(Protocol):
    """Frames in order, once. A context manager; closing it early is fine."""

    info: SourceInfo
    packet_sink: PacketSink | None

    @property
    def damaged(self) -> int:
        """Packets and frames that were damaged so far."""
        ...

    def __iter__(self) -> Iterator[SourceFrame]:
        """The frames; other streams' packets go to `packet_sink` as they are met."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...  # fmt: skip


def open_source(
    spec: str,
    *,
    input_format: str | None = None,
    input_size: str | None = None,
    input_rate: str | None = None,
) -> Source:
    """Open a plate and read its first frame.

    Args:
        spec: video file, picture, `%04d` sequence, device, URL, or `-` for standard input.
        input_format: FFmpeg's name of a container or device, or a pixel format for raw video.
        input_size: `WIDTHxHEIGHT` of raw video or of a device.
        input_rate: frames per second of raw video, of a device or of a sequence.

    Raises:
        InputError: it cannot be read, or holds no picture.
        UsageError: raw video without a size, an unknown format, a size or a rate that the input
            says itself.
    """
    hints = InputHints(format=input_format, size=input_size, rate=input_rate)
    if spec.lower().endswith(".exr") and input_format is None:
        if input_size is not None:
            raise UsageError(f"--input-size {input_size}: {spec} says that itself; leave it out")
        return ExrSource(spec, input_rate)
    return AvSource(spec, hints)


class AvSource:
    """Frames that FFmpeg decodes.

    Attributes:
        info: what is known about the source.
        damaged: packets and frames that were damaged so far.
        packet_sink: takes the packets of the streams in `info.copied`, in the order in which the
            source holds them, on the thread that iterates; set it before the first frame.
    """

    def __init__(self, spec: str, hints: InputHints) -> None:
        self.damaged = 0
        self.packet_sink: PacketSink | None = None
        self._spec = spec
        self._early: deque[Packet] = deque()
        self._started = False
        self._container, kind = open_container(spec, hints)
        try:
            self._stream = video_stream(self._container, spec)
            self._copied = _copied(self._container) if kind != "still" else ()
            self._stream.codec_context.thread_type = "AUTO"
            self._decoded = self._decode()
            first = next(self._decoded, None)
            if first is None:
                raise InputError(_undecodable(spec, self._container, self._stream))
            self._first = first
            self.info = self._describe(first, kind)
        except BaseException:
            self._container.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._decoded.close()
        self._container.close()

    def __iter__(self) -> Iterator[SourceFrame]:
        clock = _Clock(self.info)
        size = self.info.stored_size
        frame: av.VideoFrame | None = self._first
        del self._first
        index = 0
        self._started = True
        self._flush_early()
        while frame is not None:
            if (frame.width, frame.height) != size:
                raise InputError(
                    f"{self._spec}: frame {index} has {frame.width}x{frame.height} pixels, the "
                    f"first has {size[0]}x{size[1]}; convert it to one size first"
                )
            pts = clock.tick(frame.pts)
            frame.pts = pts
            picture = AvPicture(
                frame, self.info.tags, rotation=self.info.rotation,
                centred_chroma=self.info.codec in _CENTRED_CHROMA,
            )  # fmt: skip
            yield SourceFrame(
                index=index, pts=pts, time_base=clock.time_base, time_s=clock.seconds(pts),
                duration=frame.duration or 0, picture=picture,
            )  # fmt: skip
            index += 1
            frame = next(self._decoded, None)

    def _decode(self) -> Generator[av.VideoFrame, None, None]:
        """The frames of the video stream; hands on the packets of the others."""
        for packet in self._packets():
            if packet is not None and packet.stream is not self._stream:
                if packet.dts is not None and packet.stream in self._copied:
                    self._hand_on(packet)
                continue
            try:
                frames = self._stream.decode(packet)
            except av.FFmpegError:
                self.damaged += 1
                continue
            for frame in frames:
                self.damaged += frame.is_corrupt
                yield frame

    def _packets(self) -> Iterator[Packet | None]:
        """Packets in the source's order, past what is damaged; the last one flushes the decoder."""
        streams = (self._stream, *self._copied)
        errors = 0
        while errors < _RETRIES:
            try:
                for packet in self._container.demux(*streams):
                    errors = 0
                    yield packet
            except av.FFmpegError:
                self.damaged += 1
                errors += 1
            else:
                return
        yield None

    def _hand_on(self, packet: Packet) -> None:
        self._early.append(packet)
        if self._started:
            self._flush_early()

    def _flush_early(self) -> None:
        """Hand on what came before anyone could listen; what nobody listens to is dropped."""
        while self._early:
            packet = self._early.popleft()
            if self.packet_sink is not None:
                self.packet_sink(packet)

    def _describe(self, first: av.VideoFrame, kind: Kind) -> SourceInfo:
        stream, container = self._stream, self._container
        picture = kind in ("still", "sequence")
        jpeg = picture and first.format.name.startswith("yuv")
        rotation = first.rotation if first.rotation % 90 == 0 and abs(first.rotation) < 360 else 0
        worked = AvPicture(first, rotation=rotation)
        tags = frame_tags(worked.frame, transfer=_SRGB_TRC if jpeg else 0)
        rate = stream.average_rate or stream.guessed_rate or stream.base_rate
        duration = _duration(stream, container)
        count = stream.frames or (round(duration * rate) if duration and rate else None)
        return SourceInfo(
            name=self._spec, kind=kind, width=worked.width, height=worked.height,
            rotation=rotation, time_base=stream.time_base or Fraction(1, 1000),
            average_rate=rate or None, frame_count=1 if kind == "still" else count,
            duration_s=duration, pixel_format=first.format.name, tags=tags,
            frame_tags=FrameTags(
                colorspace=first.colorspace, color_range=first.color_range,
                color_primaries=first.color_primaries, color_trc=first.color_trc,
            ),
            sample_aspect_ratio=stream.sample_aspect_ratio or None,
            codec=stream.codec.name, bit_rate=stream.bit_rate or None,
            interlaced=first.interlaced_frame,
            hdr_metadata=any(one in first.side_data for one in _HDR_METADATA),
            copied=tuple(map(_described, self._copied)),
            metadata=dict(container.metadata), chapters=tuple(container.chapters()),
            notes=_left_out(container, stream, self._copied),
        )  # fmt: skip


class _Clock:
    """Gives every frame a pts: its own, or where that is missing or not later, the next one."""

    def __init__(self, info: SourceInfo) -> None:
        self.time_base = info.time_base
        self._step = max(1, round(1 / (info.average_rate or 25) / info.time_base))
        self._first: int | None = None
        self._last: int | None = None

    def tick(self, pts: int | None) -> int:
        """The frame's pts [ticks], later than the one before."""
        if pts is None:
            pts = 0 if self._last is None else self._last + self._step
        if self._last is not None:
            pts = max(pts, self._last + 1)
        if self._first is None:
            self._first = pts
        self._last = pts
        return pts

    def seconds(self, pts: int) -> float:
        """Since the first frame [s]."""
        return float((pts - (self._first or 0)) * self.time_base)


def _described(stream: Stream) -> CopiedStream:
    context = stream.codec_context
    name = "" if context is None else context.name
    return CopiedStream(index=stream.index, type=stream.type, codec=name, stream=stream)


def _copied(container: av.container.InputContainer) -> tuple[Stream, ...]:
    return tuple(one for one in container.streams if one.type in ("audio", "subtitle", "data"))


def _undecodable(
    spec: str, container: av.container.InputContainer, stream: av.video.stream.VideoStream
) -> str:
    if spec == "-" and "mp4" in container.format.name:
        return (
            "standard input: an MP4 with its index at the end cannot be read from a pipe; "
            "make it with -movflags +faststart, or pipe NUT or Matroska"
        )
    return (
        f"{spec}: no frame can be decoded ({stream.codec.name}); "
        "the file is damaged or not complete"
    )


def _left_out(
    container: av.container.InputContainer, video: av.video.stream.VideoStream,
    copied: tuple[Stream, ...],
) -> tuple[str, ...]:  # fmt: skip
    return tuple(
        f"stream {one.index} ({one.type}) is not carried over: only one video stream is rendered"
        for one in container.streams
        if one is not video and one not in copied
    )


def _duration(
    stream: av.video.stream.VideoStream, container: av.container.InputContainer
) -> float | None:
    """Length [s], None where it is unknown."""
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    return container.duration / av.time_base if container.duration else None
