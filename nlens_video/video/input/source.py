"""Frames out of anything that FFmpeg reads, in their own samples and at their own time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from types import TracebackType
from typing import Protocol, Self, TypeAlias

import av
import av.container
import av.video.stream

from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import MOST_PIXELS, too_large
from nlens_video.video.info import Packet, SourceFrame, SourceInfo, is_cover
from nlens_video.video.input.completeness import Completeness
from nlens_video.video.input.conform import Conform
from nlens_video.video.input.exr_source import ExrSource
from nlens_video.video.input.open import (
    DECODER,
    InputHints,
    decoder_of,
    open_container,
    video_stream,
)
from nlens_video.video.input.probe import copied_streams, described
from nlens_video.video.input.source_clock import SourceClock
from nlens_video.video.pixels.picture import AvPicture

PacketSink: TypeAlias = Callable[[Packet], None]
_CENTRED_CHROMA = ("mjpeg", "mpeg1video")
"""Codecs whose 4:2:0 and 4:2:2 have chroma midway between luma columns (JFIF, ISO 11172-2)."""
_RETRIES = 8
"""Read errors in a row after which a source counts as ended."""
MOST_UNDECODABLE = 500
"""Packets in a row without a picture after which a source counts as ended."""


class Source(Protocol):
    """Frames in order, once. A context manager; closing it early is fine."""

    info: SourceInfo
    packet_sink: PacketSink | None

    @property
    def damaged(self) -> int:
        """Packets and frames that were damaged so far."""
        ...

    def warnings(self) -> tuple[str, ...]:
        """What happened so far that a person should know, beside the damaged packets."""
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
    input_transfer: str | None = None,
) -> Source:
    """Open a plate and read its first frame.

    Args:
        spec: video file, picture, `%04d` sequence, device, URL, or `-` for standard input.
        input_format: FFmpeg's name of a container or device, or a pixel format for raw video.
        input_size: `WIDTHxHEIGHT` of raw video or of a device.
        input_rate: frames per second of raw video, of a device or of a sequence.
        input_transfer: name in `color.TRANSFERS` to take instead of the tag.

    Raises:
        InputError: it cannot be read, or holds no picture.
        UsageError: raw video without a size, an unknown format, a size or a rate that the input
            says itself, a transfer function for OpenEXR.
    """
    hints = InputHints(
        format=input_format, size=input_size, rate=input_rate, transfer=input_transfer
    )
    if spec.lower().endswith(".exr") and input_format is None:
        for word, given in (("size", input_size), ("transfer", input_transfer)):
            if given is not None:
                raise UsageError(f"--input-{word} {given}: {spec} says that itself; leave it out")
        return ExrSource(spec, input_rate)
    return AvSource(spec, hints)


class AvSource:
    """Frames that FFmpeg decodes.

    Attributes:
        info: what is known about the source.
        hints: what the user says about it.
        damaged: packets and frames that were damaged so far.
        packet_sink: takes the packets of the streams in `info.copied`, in the order in which the
            source holds them, on the thread that iterates; set it before the first frame.
    """

    def __init__(self, spec: str, hints: InputHints) -> None:
        self.damaged = 0
        self.packet_sink: PacketSink | None = None
        self.hints = hints
        self._spec = spec
        self._early: deque[Packet] = deque()
        self._covers: dict[int, bytes] = {}
        self._started = False
        self._index = 0
        self._ended_early: tuple[str, ...] = ()
        self._container, kind = open_container(spec, hints)
        try:
            self._stream = video_stream(self._container, spec)
            self._copied = copied_streams(self._container, self._stream, kind)
            self._completeness = Completeness(self._container, (self._stream, *self._copied))
            self._is_file = kind == "video"
            self._decoder = decoder_of(self._stream)
            self._decoder.thread_type = "AUTO"
            self._decoder.options = DECODER
            declared = (self._stream.codec_context.width, self._stream.codec_context.height)
            self._decoded = self._decode()
            first = next(self._decoded, None)
            if first is None:
                raise InputError(_undecodable(spec, self._container, self._stream, declared))
            self._first = first
            self.info = described(
                spec, kind, self._container, self._stream, first, self._copied, hints.transfer,
                self._covers,
            )  # fmt: skip
            self._clock = SourceClock(self.info)
            self._conform = Conform(first)
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
        clock = self._clock
        frame: av.VideoFrame | None = self._first
        del self._first
        index, lost, seen_damage = self._index, 0, 0
        self._started = True
        self._flush_early()
        while frame is not None:
            frame = self._conform(frame, index)
            if self.damaged > seen_damage and frame.pts is not None:
                # where packets were damaged a gap in time is pictures that were lost
                missing = clock.missing_before(frame.pts)
                lost += missing
                seen_damage = self.damaged if missing else seen_damage
            pts = clock.tick(frame.pts)
            frame.pts = pts
            picture = AvPicture(
                frame, self.info.tags, rotation=self.info.rotation,
                centred_chroma=self.info.codec in _CENTRED_CHROMA,
            )  # fmt: skip
            yield SourceFrame(
                index=index, pts=pts, time_base=clock.time_base, time_s=clock.seconds(pts),
                duration=frame.duration or 0, picture=picture, lost=lost,
            )  # fmt: skip
            index += 1
            frame = next(self._decoded, None)

    def start_at(self, pts: Sequence[int], start: int, number: int) -> bool:
        """Seek, before the first frame is given, so that this is one further on.

        Args:
            pts: of the frames, as far as they are known [ticks].
            start: number of the frame from which to decode.
            number: of the frame to begin with.

        Returns:
            Whether what was decoded on the way came at those times, whole; else it is of no use.
        """
        try:
            self._container.seek(pts[start], stream=self._stream)
        except av.FFmpegError:
            return False
        self._decoded.close()
        self._early.clear()
        self._decoded = self._decode()
        for time in pts[start : number + 1]:
            frame = next(self._decoded, None)
            if frame is None or frame.pts != time or self.damaged:
                return False
            self._first = frame
        self._index = number
        for time in pts[:number]:
            self._clock.tick(time)
        return not self._clock.repaired

    def _decode(self) -> Generator[av.VideoFrame, None, None]:
        """The frames of the video stream; hands on the packets of the others."""
        failed = 0
        for packet in self._packets():
            if packet is not None and packet.stream is not self._stream:
                if is_cover(packet.stream):
                    self._covers.setdefault(packet.stream.index, bytes(packet))
                elif packet.dts is not None and packet.stream in self._copied:
                    self._hand_on(packet)
                continue
            try:
                frames = self._decoder.decode(packet)
            except av.FFmpegError:
                self.damaged += 1
                failed += 1
                if failed == MOST_UNDECODABLE:
                    self._ended_early = (f"given up after {failed} undecodable packets in a row",)
                    return
                continue
            for frame in frames:
                failed = 0
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
                    self._completeness.saw(packet)
                    yield packet
            except av.FFmpegError:
                self.damaged += 1
                errors += 1
            else:
                self._ended_early = self._completeness.notes() if self._is_file else ()
                return
        self._ended_early = (f"given up after {errors} failed reads in a row",)
        yield None

    def warnings(self) -> tuple[str, ...]:
        """What happened so far that a person should know, beside the damaged packets."""
        mended = self._clock.repaired
        frames = "frame" if mended == 1 else "frames"
        times = f"{mended} {frames} without a time stamp that makes sense: each follows the last"
        return (*self._conform.notes(), *((times,) if mended else ()), *self._ended_early)

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


def _undecodable(
    spec: str, container: av.container.InputContainer, stream: av.video.stream.VideoStream,
    declared: tuple[int, int],
) -> str:  # fmt: skip
    if spec == "-" and "mp4" in container.format.name:
        return (
            "standard input: an MP4 with its index at the end cannot be read from a pipe; "
            "make it with -movflags +faststart, or pipe NUT or Matroska"
        )
    if declared[0] * declared[1] > MOST_PIXELS:
        return too_large(spec, *declared)
    return (
        f"{spec}: no frame can be decoded ({stream.codec.name}); the file is damaged, not complete "
        f"or larger than {MOST_PIXELS // 10**6} megapixels"
    )
