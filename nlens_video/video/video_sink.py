"""Encoding into a container: exact timing, tags and the source's other streams carried over."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import av.container
from av.codec.context import Flags
from av.stream import Stream
from av.video.stream import VideoStream

from nlens_video.color import FULL_RANGE
from nlens_video.errors import InputError, OutputError, ReaderGone
from nlens_video.video.atomic import kept_name, left_over, partial_name, publish, sweep
from nlens_video.video.audio import AudioEncoder
from nlens_video.video.encoder_clock import encoder_clock
from nlens_video.video.encoding import Encoding, choose_encoding
from nlens_video.video.info import CopiedStream, Packet, SourceFrame, SourceInfo
from nlens_video.video.rendered import picture_frame

_MP4_FAMILY = ("mp4", "mov", "ipod")
_PLAYABLE = {
    "flush_packets": "1",
    # MP4 and MOV: the first index waits for the first part, else it cannot say where time begins
    "movflags": "hybrid_fragmented+delay_moov", "frag_duration": "500000",
    "cluster_time_limit": "500",  # Matroska
}  # fmt: skip
"""Options of containers that can be played as far as they are written: parts of half a second."""
_SKIPPED_METADATA = ("major_brand", "minor_version", "compatible_brands", "encoder")


class VideoSink:
    """A video file, or a NUT stream of raw frames on standard output.

    Attributes:
        encoding: encoder, pixel format, options.
        kept: the partial file that an aborted run has left, where that was asked for.
    """

    def __init__(
        self, spec: str, info: SourceInfo, *, codec: str | None = None, crf: float | None = None,
        pix_fmt: str | None = None, keep_partial: bool = False,
    ) -> None:  # fmt: skip
        self.kept: Path | None = None
        self._info = info
        self._spec = spec
        self._path = None if spec == "-" or "://" in spec else Path(spec)
        self._partial = partial_name(self._path) if self._path else None
        self._keep = keep_partial and self._path is not None
        self._open = True
        self._committed = False
        self._left_out = 0
        found = self._rescued()
        self._container = self._open_container()
        try:
            if self._path is None and codec is None:
                codec = "rawvideo"
            self.encoding = choose_encoding(
                info, self._container.supported_codecs, self._container.format.name,
                codec=codec, crf=crf, pix_fmt=pix_fmt,
            )  # fmt: skip
            self._stream = self._add_video(self.encoding)
            notes = self._add_copied()
        except BaseException:
            self._discard()
            raise
        self._notes = (*self.encoding.reasons, *notes, *found)

    @property
    def notes(self) -> tuple[str, ...]:
        """What differs from the source so far, and why."""
        count = self._left_out
        lost = f"{count} damaged packets of sound or other streams were left out"
        return (*self._notes, *((lost,) if count else ()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        if self._committed:
            return
        if self._keep and self._open and self._path is not None and self._partial is not None:
            with contextlib.suppress(OutputError):
                self._finish()
                self.kept = kept_name(self._path)
                publish(self._partial, self.kept)
        self._discard()

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame at its own time.

        Raises:
            OutputError: the disk is full, the encoder refuses.
        """
        encoded = picture_frame(frame.picture, self.encoding.pixel_format)
        self._clock.stamp(encoded, frame)
        encoded.pict_type = 0  # else the encoder repeats the source's choice of key frames
        with self._writing():
            self._container.mux(self._clock.retimed(self._stream.encode(encoded)))

    def write_packet(self, packet: Packet) -> None:
        """Carry over a packet of another stream; one that was dropped, or after the end: nothing.

        One that is damaged, or whose time steps back, is left out and counted.

        Raises:
            OutputError: the disk is full, or the container refuses it.
        """
        with self._writing():
            target = self._targets.get(packet.stream.index) if self._open else None
            try:
                if isinstance(target, AudioEncoder):
                    self._container.mux(target.encode(packet))
                elif target is not None:
                    packet.stream = target
                    self._container.mux(packet)
            except (av.InvalidDataError, av.ArgumentError):
                self._left_out += 1

    def commit(self) -> None:
        """Finish the file and give it its name.

        Raises:
            OutputError: it cannot be written.
        """
        self._finish()
        if self._path is not None and self._partial is not None:
            publish(self._partial, self._path)
        self._committed = True

    def _finish(self) -> None:
        with self._writing():
            self._container.mux(self._clock.retimed(self._stream.encode(None)))
            for target in self._targets.values():
                if isinstance(target, AudioEncoder):
                    self._container.mux(target.encode(None))
            self._open = False
            self._container.close()

    def _rescued(self) -> tuple[str, ...]:
        """What killed runs have left: the last of it is kept where that is asked for."""
        if self._path is None:
            return ()
        notes: tuple[str, ...] = ()
        if self._keep:
            found = [one for one in left_over(self._path) if one.stat().st_size]
            if found:
                kept = kept_name(self._path)
                max(found, key=lambda one: one.stat().st_mtime).replace(kept)
                notes = (f"what a killed run has left is now {kept}",)
        return (*notes, *sweep(self._path))

    def _discard(self) -> None:
        if self._open:
            self._open = False
            with contextlib.suppress(av.FFmpegError, OSError, ValueError):
                self._container.close()
        if self._partial is not None:
            with contextlib.suppress(OSError):
                self._partial.unlink(missing_ok=True)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError as error:
            raise ReaderGone(f"{self._spec}: nobody reads it any more") from error
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise OutputError(
                f"{self._spec}: cannot be written ({reason}); check the disk, --codec and --pix-fmt"
            ) from error

    def _open_container(self) -> av.container.OutputContainer:
        if self._spec == "-":
            if sys.stdout is None:
                raise OutputError("standard output: is closed; give OUT a name, or pipe it on")
            return av.open(sys.stdout.buffer, "w", format="nut")
        options = {}
        if self._path is not None and self._path.suffix in (".mkv", ".webm", ".mka"):
            # Audio that starts before zero must not push the pictures off their own times.
            options["avoid_negative_ts"] = "disabled"
        if self._keep:
            options |= _PLAYABLE
        # a name with a colon in it is no protocol
        target = f"file:{self._partial}" if self._partial else self._spec
        try:
            return av.open(target, "w", container_options=options)
        except ValueError as error:
            raise OutputError(
                f"{self._spec}: nothing writes this extension; try .mp4, .mov, .mkv, .webm, .png"
            ) from error
        except (av.FFmpegError, OSError) as error:
            raise OutputError(f"{self._spec}: cannot be written ({error.strerror})") from error

    def _add_video(self, encoding: Encoding) -> VideoStream:
        info = self._info
        rate = info.average_rate or Fraction(25)
        stream = self._container.add_stream(encoding.codec, rate, dict(encoding.options))
        if not isinstance(stream, VideoStream):
            raise InputError(f"{encoding.codec} is no video encoder")
        context = stream.codec_context
        stream.width, stream.height = info.stored_size
        stream.pix_fmt = encoding.pixel_format
        self._clock = encoder_clock(encoding.codec, self._container.format.name, info)
        stream.time_base = context.time_base = self._clock.time_base
        context.flags |= Flags.frame_duration
        context.thread_type = "AUTO"
        if info.sample_aspect_ratio:
            context.sample_aspect_ratio = info.sample_aspect_ratio
        if info.rotation:
            stream.set_display_rotation(info.rotation)
        self._set_colour(stream)
        return stream

    def _set_colour(self, stream: VideoStream) -> None:
        """The source's own tags; where RGB becomes YUV, those that `converted` writes."""
        tags, context = self._info.frame_tags, stream.codec_context
        was = self._info.tags.matrix == "gbr"
        becomes = av.VideoFormat(self.encoding.pixel_format).is_rgb
        context.color_primaries, context.color_trc = tags.color_primaries, tags.color_trc
        context.colorspace, context.color_range = tags.colorspace, tags.color_range
        if was and not becomes and "gray" not in self.encoding.pixel_format:
            full = self.encoding.pixel_format.startswith("yuvj")
            context.colorspace, context.color_range = (5, FULL_RANGE) if full else (1, 1)
            context.color_primaries, context.color_trc = 1, 13
        elif becomes:
            context.colorspace, context.color_range = 0, FULL_RANGE

    def _add_copied(self) -> list[str]:
        """Streams that travel along, and what becomes of those that cannot."""
        self._targets: dict[int, Stream | AudioEncoder] = {}
        notes = []
        name = self._container.format.name
        for stream in self._info.copied:
            label = f"stream {stream.index} ({stream.type})"
            if _holds(self._container, stream):
                target = self._container.add_stream_from_template(stream.stream)
                target.metadata.update(stream.stream.metadata)
                self._targets[stream.index] = target
            elif stream.type == "audio" and self._container.default_audio_codec != "none":
                notes.append(self._encode_anew(stream, label))
            else:
                notes.append(f"{label} is left out: {name} does not hold it")
        for key, value in self._info.metadata.items():
            if key not in _SKIPPED_METADATA:
                self._container.metadata[key] = value
        if self._info.chapters:
            self._container.set_chapters(list(self._info.chapters))
        return notes

    def _encode_anew(self, stream: CopiedStream, label: str) -> str:
        try:
            encoder = AudioEncoder(self._container, stream.stream)
        except ValueError as error:
            return f"{label} is left out: {error}"
        self._targets[stream.index] = encoder
        name = self._container.format.name
        return f"{label} becomes {encoder.codec}: {name} does not hold its codec"


def _holds(container: av.container.OutputContainer, stream: CopiedStream) -> bool:
    """Whether a container takes a stream as it is: only writing a header tells for certain."""
    if stream.codec and stream.codec not in container.supported_codecs:
        return False
    name = container.format.name
    # The MP4 family writes what it knows of a stream at the end, unless the file is fragmented; of
    # AC-3 it knows nothing before the first packet.
    early = name in _MP4_FAMILY and stream.codec not in ("ac3", "eac3")
    options = {"movflags": "empty_moov"} if early else {}
    try:
        with av.open(io.BytesIO(), "w", format=name, container_options=options) as trial:
            trial.add_stream_from_template(stream.stream)
            trial.start_encoding()
    except (av.FFmpegError, ValueError, OSError):
        return False
    return True
