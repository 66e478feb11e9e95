"""Encoding of video into a container, with exact times, tags and the source's other streams."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import av.container
from av.codec.context import Flags
from av.video.stream import VideoStream
from msgspec.structs import replace

from nlens_video.core import signals
from nlens_video.core.errors import OutputError, ReaderGone
from nlens_video.video.atomic_files import keep_last, kept_name, partial_name, publish, remove_stale
from nlens_video.video.info import Packet, SourceFrame, SourceInfo, upright
from nlens_video.video.interfaces import Sink
from nlens_video.video.matroska_aspect import CONTAINERS as HEADERS
from nlens_video.video.matroska_aspect import write_display_size
from nlens_video.video.output.carried_streams import CarriedStreams
from nlens_video.video.output.containers import holds_aspect, holds_video, read_tags
from nlens_video.video.output.encoder_threads import (
    open_in_background,
    ordinary_priority,
    thread_type,
)
from nlens_video.video.output.encoding import Encoding, choose_encoding, encoder_clock
from nlens_video.video.output.stream_output import Muxer, StreamOutput, is_stream, muxer
from nlens_video.video.output.tags import holds_rotation, sample_entry, set_tags
from nlens_video.video.output.trials import UNOFFICIAL, plays
from nlens_video.video.pixels.display_codes import display_coded
from nlens_video.video.pixels.picture import picture_frame
from nlens_video.video.pixels.upright import upright_frame
from nlens_video.video.stored_colour import set_colour, siting_option, stored_colour
from nlens_video.video.times.start import Start

_PLAYABLE = {
    "flush_packets": "1",
    # MP4 and MOV: the first index waits for the first part, else it cannot say where time begins
    "movflags": "hybrid_fragmented+delay_moov", "frag_duration": "500000",
    "cluster_time_limit": "500",  # Matroska
}  # fmt: skip
"""Options of containers that are playable while they are written: fragments of half a second."""


class VideoSink(Sink):
    """A video file, or a stream that is written sequentially; arguments as `open_sink`.

    Attributes:
        encoding: encoder, pixel format, options.
    """

    def __init__(
        self, spec: str, info: SourceInfo, *, codec: str | None = None, crf: float | None = None,
        pix_fmt: str | None = None, keep_partial: bool = False,
    ) -> None:  # fmt: skip
        self._spec = spec
        self._path = None if is_stream(spec) else Path(spec)
        self._direct: StreamOutput | None = None
        self._partial = partial_name(self._path) if self._path else None
        self._keep = keep_partial and self._path is not None
        self._open = True
        self._committed = False
        self._written = 0
        rescue = keep_last if keep_partial else remove_stale
        rescued = rescue(self._path) if self._path else ()
        self._container = self._open_container()
        try:
            if self._direct is not None and self._container.format.name == "nut" and codec is None:
                codec = "rawvideo"
            name, default = self._container.format.name, self._container.default_video_codec
            Muxer(name, default).check_video(spec)
            self._turns = not (info.orientation.upright or holds_rotation(name))
            self._start = start = Start.of(info, name)
            self._info = info = start.info(upright(info) if self._turns else info)
            encoding = choose_encoding(
                info, partial(holds_video, name), name, default=default,
                codec=codec, crf=crf, pix_fmt=pix_fmt,
            )  # fmt: skip
            self._colour = colour = stored_colour(
                info, encoding.pixel_format,
                partial(read_tags, name, encoding.codec, encoding.pixel_format),
            )  # fmt: skip
            self.encoding = replace(encoding, pixel_format=colour.pixel_format)
            self._stream = self._add_video(self.encoding)
            self._carried = CarriedStreams(self._container, info)
        except BaseException:
            self._discard()
            raise
        turned = (f"the pictures are turned upright: {name} has no place for their orientation",)
        self._says_shape = bool(self._path and info.uneven_aspect and name in HEADERS)
        self._notes = (
            *self.encoding.reasons, *self._colour.notes(name, self.encoding.codec),
            *self._carried.notes, *start.notes, *(turned if self._turns else ()),
            *self._lost_aspect(said=self._says_shape), *rescued,
        )  # fmt: skip

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences from the source so far, with reasons."""
        return (*self._notes, *self._clock.notes, *self._carried.later_notes)

    def close(self) -> None:
        """Discard the result, or keep what is written where that was requested."""
        if self._committed:
            return
        if self._keep and self._path and self._partial:
            if self._open and self._written:
                with contextlib.suppress(OutputError):
                    self._finish()
            self._close_files()
            if plays(self._partial):  # on a full disk, what fitted on it
                with contextlib.suppress(OutputError):
                    publish(self._partial, kept_name(self._path))
                    self.kept = kept_name(self._path)
            self.keeps_nothing = self.kept is None
        self.cut_off = self._path is None
        self._discard()

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame at its own time.

        Raises:
            OutputError: the disk is full, or the encoder refuses the frame.
        """
        stored = upright_frame if self._turns else picture_frame
        name, limited = self.encoding.pixel_format, self._colour.limited
        encoded = stored(display_coded(frame.picture, name), name, limited=limited)
        encoded.pict_type = 0  # else the encoder repeats the source's choice of key frames
        placed = self._start.frame(frame)
        for picture in self._clock.missed(placed):
            self._encode(picture)
        self._clock.stamp(encoded, placed)
        self._encode(encoded)

    def _encode(self, encoded: av.VideoFrame) -> None:
        self._written += 1
        with self._writing():
            self._carried.begin()
            self._container.mux(self._clock.retimed(self._stream.encode(encoded)))
            self._carried.keep_up(self._written)
        signals.check()  # FFmpeg loses an interrupt that arrives while it writes

    def write_packet(self, packet: Packet) -> None:
        """Write a packet of another stream, unless the stream is left out or has ended.

        Damaged packets, and those whose time steps back, are left out and counted.

        Raises:
            OutputError: the disk is full, or the container refuses it.
        """
        with self._writing():
            if self._open:
                self._carried.begin()
                self._start.shift(packet)
                self._carried.write(packet)
        signals.check()

    def commit(self) -> None:
        """Finish the file and rename it to its final name.

        Raises:
            OutputError: it cannot be written.
        """
        self._finish()
        signals.check()
        if self._path and self._partial:
            publish(self._partial, self._path)
        self._committed = True

    def _finish(self) -> None:
        with self._writing():
            self._container.mux(self._clock.retimed(self._stream.encode(None)))
            self._carried.finish(self._written)
            self._open = False
            self._container.close()
            if self._direct is not None:
                self._direct.close()
            if self._says_shape and self._partial and not self._said_shape(self._partial):
                self._notes += self._lost_aspect(said=False)

    def _said_shape(self, path: Path) -> bool:
        """Say in a finished file how large it is shown; whether there was room for it."""
        ratio = self._info.uneven_aspect or Fraction(1)
        return write_display_size(path, self._info.stored_size, ratio)

    def _lost_aspect(self, *, said: bool) -> tuple[str, ...]:
        """A note where the result does not say the shape of its pixels.

        Args:
            said: whether its header will.
        """
        ratio, name = self._info.uneven_aspect, self._container.format.name
        encoder, pixel_format = self.encoding.codec, self.encoding.pixel_format
        if ratio is None or said or holds_aspect(name, encoder, pixel_format):
            return ()
        shape = f"{ratio.numerator}:{ratio.denominator}"
        return (
            f"pixels of {shape} become square: {name} does not hold their shape for {encoder}; "
            ".mkv, .mov and .mp4 files do",
        )

    def _close_files(self) -> None:
        if self._open:
            self._open = False
            with contextlib.suppress(av.FFmpegError, OSError, ValueError):
                self._container.close()
        if self._direct is not None:
            with contextlib.suppress(OSError):
                self._direct.close()

    def _discard(self) -> None:
        self._close_files()
        if self._partial is not None:
            with contextlib.suppress(OSError):
                self._partial.unlink(missing_ok=True)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (BrokenPipeError, ConnectionResetError) as error:
            if "://" in self._spec:  # a server that goes away is no reader that has seen enough
                raise OutputError(
                    f"{self._spec}: the other side closed the connection; see what it says"
                ) from error
            raise ReaderGone(f"{self._spec}: nobody reads it any more") from error
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            remedy = "the disk, --codec and --pix-fmt"
            if "://" in self._spec:
                network = isinstance(error, OSError)  # what does not suit a muxer is another error
                remedy = "the address and what listens there" if network else "--codec, --pix-fmt"
            raise OutputError(
                f"{self._spec}: cannot be written ({reason}); check {remedy}"
            ) from error

    def _open_container(self) -> av.container.OutputContainer:
        if self._path is None:
            self._direct = StreamOutput(self._spec)
            return self._direct.container
        options = dict(UNOFFICIAL.get(muxer(self._spec).name, {}))
        if self._path.suffix.lower() in (".mkv", ".webm", ".mka", ".avi"):
            # Audio that starts before zero must not push the pictures off their own times.
            options["avoid_negative_ts"] = "disabled"
        if self._keep:
            options |= _PLAYABLE
        # file: a name with a colon is no protocol
        try:
            return av.open(f"file:{self._partial}", "w", container_options=options)
        except (av.FFmpegError, OSError) as error:
            raise OutputError(f"{self._spec}: cannot be written ({error.strerror})") from error

    def _add_video(self, encoding: Encoding) -> VideoStream:
        info = self._info
        rate = info.average_rate or Fraction(25)
        name = self._container.format.name
        options = encoding.options | siting_option(info, encoding.pixel_format, name)
        stream = self._container.add_stream(encoding.codec, rate, options)
        assert isinstance(stream, VideoStream)
        context = stream.codec_context
        stream.width, stream.height = info.stored_size
        stream.pix_fmt = encoding.pixel_format
        self._clock = encoder_clock(encoding.codec, name, info)
        stream.time_base = context.time_base = self._clock.time_base
        context.flags |= Flags.frame_duration
        context.thread_type = thread_type(encoding.codec, live=info.kind == "stream")
        if info.sample_aspect_ratio:
            context.sample_aspect_ratio = info.sample_aspect_ratio
        if not info.orientation.upright:
            shown = info.orientation
            stream.set_display_rotation(shown.rotation, hflip=shown.mirrored)
        if entry := sample_entry(name, encoding.codec):
            context.codec_tag = entry
        set_tags(stream, info)
        set_colour(context, self._colour.tags)
        if self._direct is not None:
            self._direct.limit_wait(context.codec, rate)
        try:
            with ordinary_priority():
                open_in_background(context.open)
        except av.FFmpegError as error:
            width, height = info.stored_size
            raise OutputError(
                f"{self._spec}: {encoding.codec} refuses pictures of {width}x{height} in "
                f"{encoding.pixel_format} ({error.strerror}); give another --codec"
            ) from error
        return stream
