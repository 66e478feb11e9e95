"""Sources that FFmpeg reads: frames in their own samples, at their own times."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial

import av
import av.container
from msgspec.structs import replace

from nlens_video.core.errors import InputError, UsageError
from nlens_video.kernels.thread_pool import processors
from nlens_video.video.exr import ExrSource
from nlens_video.video.info import Packet, SourceFrame, is_cover
from nlens_video.video.input.changed_frames import Conform, LateFields
from nlens_video.video.input.last_frames import Delivery, frames_after
from nlens_video.video.input.lost_connections import Reads, explain_lost, why_lost
from nlens_video.video.input.open import (
    DECODER,
    STRICT,
    InputHints,
    decoder_of,
    explain_undecodable,
    open_container,
    video_stream,
)
from nlens_video.video.input.packet_index import frame_time
from nlens_video.video.input.passed_packets import PassedPackets
from nlens_video.video.input.probe import copied_streams, describe
from nlens_video.video.input.repair import Completeness, Damage, Durations, SourceClock, salvaged
from nlens_video.video.interfaces import Source
from nlens_video.video.pixels.picture import AvPicture

_RETRIES = 8
"""Read errors in a row after which a source counts as ended."""
MOST_UNDECODABLE = 500
"""Packets in a row without a picture after which a source counts as ended."""
_MOST_THREADS = 16  # of a decoder: FFmpeg warns of more


def open_source(
    spec: str,
    within_s: float | None = None,
    *,
    input_format: str | None = None,
    input_size: str | None = None,
    input_rate: str | None = None,
    input_transfer: str | None = None,
    sparse: bool = False,
) -> Source:
    """Open a plate and read its first frame.

    Args:
        spec: video file, picture, `%04d` sequence, device, URL, or `-` for standard input.
        within_s: how long opening may wait, None for as long as it takes [s].
        input_format: FFmpeg's name of a container or device, or a pixel format for raw video.
        input_size: `WIDTHxHEIGHT` of raw video or of a device.
        input_rate: frames per second of raw video, of a device or of a sequence.
        input_transfer: name in `color.TRANSFERS`, overrides the tag.
        sparse: read as quickly as can be: frames may be left out that no other frame is predicted
            from. The others are exact; their numbers do not count.

    Raises:
        InputError: it cannot be read, or holds no picture.
        UsageError: raw video without a size, an unknown format, a size or a rate that the input
            states itself, a transfer function for OpenEXR.
    """
    hints = InputHints(
        format=input_format, size=input_size, rate=input_rate, transfer=input_transfer,
        within_s=within_s,
    )  # fmt: skip
    if spec.lower().endswith(".exr") and input_format is None:
        for word, given in (("size", input_size), ("transfer", input_transfer)):
            if given is not None:
                raise UsageError(f"--input-{word} {given}: {spec} says that itself; leave it out")
        return ExrSource(spec, input_rate)
    return AvSource(spec, hints, sparse=sparse)


class AvSource(Source):
    """Frames that FFmpeg decodes.

    Args:
        spec: as in `open_source`.
        hints: the user's options.
        sparse: as of `open_source`.

    Raises:
        InputError: it cannot be read, or holds no picture.
        UsageError: the hints do not suit the input.
    """

    def __init__(self, spec: str, hints: InputHints, *, sparse: bool = False) -> None:
        self.hints = hints
        self._spec = spec
        self._passed = PassedPackets()
        self._damage = Damage()
        self._covers: dict[int, bytes] = {}
        self._started = False
        self._index = 0
        self._ended_early: tuple[str, ...] = ()
        self._lost: str | None = None
        self._reads = Reads()
        self._container, kind = open_container(spec, hints)
        try:
            self._stream = stream = video_stream(self._container, spec)
            self._copied = copied_streams(self._container, stream, kind)
            self._completeness = Completeness(self._container, (stream, *self._copied))
            self._is_file = kind == "video"
            self._readable_again = not sparse and kind in ("video", "sequence")
            self._decoder = decoder_of(stream)
            self._decoder.thread_type = "AUTO"
            # the lanes need the other processors, and a single thread hands no pictures to others
            self._decoder.thread_count = min(_MOST_THREADS, max(1, processors() // 2))
            if sparse:
                self._decoder.skip_frame = "NONREF"
                # each frame waits for one before it: with as many threads as processors some idle
                self._decoder.thread_count = min(_MOST_THREADS, 2 * processors() + 2)
            # other decoders refuse damaged pictures, or (TIFF) are strict about whole ones
            self._salvages = kind in ("still", "sequence") and stream.codec.name == "mjpeg"
            self._decoder.options = STRICT if self._salvages else DECODER
            self._durations = Durations(stream)
            declared = (stream.codec_context.width, stream.codec_context.height)
            self._decoded = self._decode()
            first = next(self._decoded, None)
            if first is None:
                if self._lost:
                    raise InputError(explain_lost(spec, self._lost))
                codec = stream.codec.name
                raise InputError(explain_undecodable(spec, self._container, kind, codec, *declared))
            self._first = first
            info = describe(
                spec, kind, self._container, stream, first, self._copied, hints,
                self._covers,
            )  # fmt: skip
            # files whose rate varies may state a constant one
            known = partial(frame_time, spec, hints, info.time_base) if self._is_file else None
            self.info = replace(info, frame_time=known)
            self._clock = SourceClock(self.info)
            self._conform = Conform(first, self.info, self._decoder.sample_aspect_ratio)
            self._late_fields = LateFields(self.info)
        except BaseException:
            self._container.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._decoded.close()
        self._container.close()

    def __iter__(self) -> Iterator[SourceFrame]:
        clock = self._clock
        frame: av.VideoFrame | None = self._first
        del self._first
        index, lost = self._index, 0
        last: int | None = None
        self._started = True
        self._pass_on()
        while frame is not None:
            self._late_fields.see(frame, index)
            duration = self._durations.of(frame)
            frame = self._conform(frame, index, self._decoder.sample_aspect_ratio)
            if frame.pts is not None:
                if self._damage.is_near(last, frame.pts, clock.step):
                    lost += clock.missing_before(frame.pts)
                last = frame.pts
            pts = clock.tick(frame.pts)
            frame.pts = pts
            picture = AvPicture(
                frame, self.info.tags, orientation=self.info.orientation,
                chroma_siting=self.info.chroma_siting,
            )  # fmt: skip
            yield SourceFrame(
                index=index, pts=pts, time_base=clock.time_base, time_s=clock.seconds(pts),
                duration=duration, picture=picture, lost=lost,
            )  # fmt: skip
            index += 1
            frame = next(self._decoded, None)
        self._pass_on(ended=True)

    def start_at(self, pts: Sequence[int], start: int, number: int) -> bool:
        """Seek so that iteration begins with a later frame; call before it.

        Args:
            pts: of the frames, as far as they are known [ticks].
            start: number of the frame from which to decode.
            number: of the frame to begin with.

        Returns:
            Whether the frames from `start` on were decoded undamaged at those times; if not, this
            source is unusable.
        """
        try:
            self._container.seek(pts[start], stream=self._stream)
        except av.FFmpegError:
            return False
        self._decoded.close()
        self._passed = PassedPackets()
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
        """The frames of the video stream; packets of the others go to `packet_sink`."""
        delivery = Delivery()
        failed = yield from self._decode_packets(delivery)
        if failed < MOST_UNDECODABLE and self._readable_again and not delivery.complete:
            self._damage.count -= failed  # they are found again
            for frame in frames_after(self._spec, self.hints, delivery.shown, self._damage.add):
                self._damage.see(frame)
                yield frame

    def _decode_packets(self, delivery: Delivery) -> Generator[av.VideoFrame, None, int]:
        """The frames as the decoder gives them; returns the failures since the last."""
        failed = 0
        for packet in self._packets():
            if packet is not None and packet.stream is not self._stream:
                self._pass(packet)
                continue
            if packet is not None:
                if self._passed.see(packet) and self._started:
                    self._clock.joined = True
                self._durations.read(packet)
                self._damage.read(packet)
                delivery.send(packet)
            try:
                frames = self._decoder.decode(packet)
            except av.FFmpegError:
                if self._readable_again and (packet is None or packet.size == 0):
                    continue  # the last frames are decoded anew
                if packet is None or not packet.is_corrupt:  # else it is counted already
                    self._damage.add()
                frames = salvaged(self._stream, packet) if self._salvages else []
                failed += not frames
                if failed == MOST_UNDECODABLE:
                    self._ended_early = (f"given up after {failed} undecodable packets in a row",)
                    break
            for frame in frames:
                failed = 0
                delivery.show(frame)
                self._damage.see(frame)
                yield frame
        return failed

    def _pass(self, packet: Packet) -> None:
        """Take a packet of another stream."""
        if is_cover(packet.stream):
            self._covers.setdefault(packet.stream.index, bytes(packet))
        elif packet.stream in self._copied and (packet.size or packet.dts is not None):
            self._passed.add(packet)
            if self._started:
                self._pass_on()

    def _packets(self) -> Iterator[Packet | None]:
        """Packets in the source's order, past read errors; the last one flushes the decoder."""
        errors = 0
        while errors < _RETRIES:
            try:
                packets = self._container.demux(self._stream, *self._copied)
                for packet in self._reads.timed(packets):
                    errors = 0
                    self._completeness.count(packet)
                    yield packet
            except av.FFmpegError as error:
                self._lost = why_lost(self._spec, error, self._reads.longest_s)
                if self._lost:
                    self._ended_early = (f"the source ended: {self._lost}",)
                    break
                self._damage.add()
                errors += 1
            else:
                self._ended_early = self._completeness.notes() if self._is_file else ()
                return
        else:
            self._ended_early = (f"given up after {errors} failed reads in a row",)
        yield None

    @property
    def damaged(self) -> int:
        """Packets and frames so far that were damaged [1]."""
        return self._damage.count

    def warnings(self) -> tuple[str, ...]:
        """Irregularities so far, other than damaged packets."""
        late = self._late_fields.notes()
        return (*self._conform.notes(), *late, *self._clock.notes(), *self._ended_early)

    def _pass_on(self, *, ended: bool = False) -> None:
        """Hand over packets whose time is known; without a `packet_sink`, drop them."""
        for packet in self._passed.due(self._clock, ended=ended):
            if self.packet_sink is not None:
                self.packet_sink(packet)
