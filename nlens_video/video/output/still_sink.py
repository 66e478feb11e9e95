"""Pictures and numbered sequences: one file a frame, renamed to their final names at the end."""

from __future__ import annotations

import contextlib
import shutil
from fractions import Fraction
from pathlib import Path

import av
from av.video.codeccontext import VideoCodecContext

from nlens_video.core.errors import OutputError
from nlens_video.video.atomic_files import kept_name, partial_name, remove_stale
from nlens_video.video.atomic_sequences import publish_all
from nlens_video.video.exr import not_carried, write_layers, write_over
from nlens_video.video.info import Packet, SourceFrame, SourceInfo, upright
from nlens_video.video.interfaces import Sink
from nlens_video.video.named_files import ImageSequence
from nlens_video.video.output.encoder_threads import ordinary_priority
from nlens_video.video.output.picture_files import (
    EXTENSIONS,
    READ_AS_BT601,
    lost_aspect,
    lost_colour,
    picture_encoding,
    picture_options,
    whole_format,
)
from nlens_video.video.pixels.conversion import converted
from nlens_video.video.pixels.display_codes import display_coded
from nlens_video.video.pixels.light_channels import channel_primaries, picture_channels
from nlens_video.video.pixels.picture import picture_frame
from nlens_video.video.pixels.pixel_formats import layout, working_format
from nlens_video.video.pixels.upright import turned
from nlens_video.video.stills.embedded import with_profile


class StillSink(Sink):
    """One picture, or a `%04d` sequence; a frame keeps its number, a video's count from 0.

    Files are written into a hidden folder beside the result and moved out on `commit`.
    """

    def __init__(
        self, spec: str, info: SourceInfo, *, pix_fmt: str | None = None, keep_partial: bool = False
    ) -> None:
        self._info = info
        self._path = Path(spec)
        self._numbered = ImageSequence(spec) if ImageSequence.matches(spec) else None
        self._plates = ImageSequence.of_input(info.name)
        self._first = self._plates.first() if self._plates else 0
        self._keep = keep_partial
        self._written: list[Path] = []
        self._codec = EXTENSIONS[self._path.suffix.lower()]
        self._over = self._codec == info.codec == "exr"
        if self._over:
            self._notes += not_carried(self._plate(0))
        self._format = "gbrpf32le"
        if self._codec != "exr":
            encoding = picture_encoding(info, self._path.suffix.lower(), pix_fmt)
            self._format, self._notes = encoding.pixel_format, encoding.reasons
            self._notes += lost_colour(info, self._path.suffix.lower(), self._format)
        kind = layout(working_format(self._format))
        yuv = kind is not None and kind.family == "yuv"
        limited = yuv and not self._format.startswith("yuvj")
        self._limited = limited and info.tags.matrix != "gbr" and info.tags.full_range
        jpeg_again = self._codec == info.codec == "mjpeg"
        self._bt601 = yuv and self._codec in READ_AS_BT601 and not jpeg_again
        if self._limited:
            self._notes += (f"full range becomes limited: {self._path.suffix} is read as limited",)
        self._notes += lost_aspect(info, self._path.suffix.lower())
        self._notes += remove_stale(self._path)
        self._folder = partial_name(self._path)
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{spec}: cannot be written ({error.strerror})") from error

    def close(self) -> None:
        """Discard the files, or keep them where that was requested."""
        left = self._folder.is_dir() and any(self._folder.iterdir())
        if self._keep and left:
            kept = kept_name(self._path).with_suffix("")
            shutil.rmtree(kept, ignore_errors=True)  # of an earlier run
            with contextlib.suppress(OSError):
                self.kept = self._folder.rename(kept)
        self.keeps_nothing = self._keep and self.kept is None and (left or not self._written)
        shutil.rmtree(self._folder, ignore_errors=True)

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame into its file.

        Raises:
            OutputError: the disk is full, or a single picture gets a second frame.
        """
        if self._numbered is None and self._written:
            raise OutputError(f"{self._path}: is one picture; give a sequence such as out_%04d.png")
        path = self._name(frame.number)
        target = self._folder / path.name
        if self._codec == "exr":
            self._write_exr(target, frame)
        else:
            try:
                target.write_bytes(self._encode(frame))
            except (av.FFmpegError, OSError, ValueError) as error:
                target.unlink(missing_ok=True)  # of which a full disk took a part
                reason = getattr(error, "strerror", None) or str(error)
                raise OutputError(f"{self._path}: cannot be written ({reason})") from error
        self._written.append(path)

    def write_packet(self, packet: Packet) -> None:
        """Nothing: pictures have no other streams."""

    def commit(self) -> None:
        """Give the files their names: all, or in a run that is interrupted or fails none.

        Raises:
            OutputError: they cannot be written.
        """
        files = [(self._folder / path.name, path) for path in self._written]
        publish_all(files, str(self._path))
        shutil.rmtree(self._folder, ignore_errors=True)

    def _write_exr(self, target: Path, frame: SourceFrame) -> None:
        channels, half = picture_channels(frame.picture), self._info.half
        if self._over:
            write_over(target, channels, self._plate(frame.number), half=half)
        else:
            primaries = channel_primaries(frame.picture)
            write_layers(target, channels, half=half, primaries=primaries)

    def _plate(self, number: int) -> Path:
        """The plate's file of a frame."""
        plates = self._plates
        return plates.path(self._first + number) if plates else Path(self._info.name)

    def _name(self, index: int) -> Path:
        return self._numbered.path(self._first + index) if self._numbered else self._path

    def _encode(self, frame: SourceFrame) -> bytes:
        picture = display_coded(frame.picture, self._format)
        turns = not self._info.orientation.upright
        if self._bt601 or turns:  # another matrix and turning want whole pixels
            pixels = picture_frame(picture, whole_format(self._format))
            if turns:
                pixels = turned(pixels, self._info.orientation)
            pixels = converted(pixels, self._format, bt601=self._bt601)
        else:
            pixels = picture_frame(picture, self._format, limited=self._limited)
        context = av.CodecContext.create(self._codec, "w")
        assert isinstance(context, VideoCodecContext)
        context.width, context.height, context.pix_fmt = pixels.width, pixels.height, self._format
        context.time_base = Fraction(1, 25)
        context.thread_count = 1
        if ratio := upright(self._info).uneven_aspect:
            context.sample_aspect_ratio = ratio
        context.color_range, context.colorspace = pixels.color_range, pixels.colorspace
        context.color_primaries, context.color_trc = pixels.color_primaries, pixels.color_trc
        context.options = picture_options(self._codec, self._format)
        pixels.pts, pixels.pict_type = 0, 0
        pixels.time_base = Fraction(1, 25)
        with ordinary_priority():
            packets = [*context.encode(pixels), *context.encode(None)]
        made = b"".join(bytes(packet) for packet in packets)
        # frames that are turned lose the profile that FFmpeg writes of others
        profile = self._info.icc_profile if turns and self._codec == "mjpeg" else b""
        return with_profile(made, profile) if profile else made
