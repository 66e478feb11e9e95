"""Pictures and numbered sequences, one file a frame, all of them appearing at the end."""

from __future__ import annotations

import contextlib
import shutil
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
from av.video.codeccontext import VideoCodecContext

from nlens_video.core.errors import OutputError
from nlens_video.video.atomic_files import partial_name, publish, remove_stale
from nlens_video.video.exr import write_layers
from nlens_video.video.info import Packet, SourceFrame, SourceInfo
from nlens_video.video.numbered import ImageSequence
from nlens_video.video.output.encoding import choose_encoding
from nlens_video.video.pixels.convert import picture_channels, picture_frame, upright_frame
from nlens_video.video.pixels.pixel_formats import converted, layout, working_format

EXTENSIONS = {
    ".png": "png", ".jpg": "mjpeg", ".jpeg": "mjpeg", ".tif": "tiff", ".tiff": "tiff",
    ".bmp": "bmp", ".webp": "libwebp", ".exr": "exr",
}  # fmt: skip
ANIMATED = (".webp",)
"""Of these, those whose files hold a video as well."""
_QUALITY = {
    "mjpeg": {"flags": "+qscale", "global_quality": str(2 * 118)},
    "libwebp": {"lossless": "1"},
}


class StillSink:
    """One picture, or a `%04d` sequence; a frame keeps its number, a video's count from 0.

    Files are written into a hidden folder beside the result and moved out on `commit`.

    Attributes:
        notes: what differs from the source, and why.
        kept: the folder that an aborted run has left, where that was asked for.
    """

    def __init__(
        self, spec: str, info: SourceInfo, *, pix_fmt: str | None = None, keep_partial: bool = False
    ) -> None:
        self.kept: Path | None = None
        self.notes: tuple[str, ...] = ()
        self._info = info
        self._path = Path(spec)
        self._numbered = ImageSequence(spec) if ImageSequence.matches(spec) else None
        self._first = _first_number(info.name)
        self._keep = keep_partial
        self._written: list[Path] = []
        self._codec = EXTENSIONS[self._path.suffix.lower()]
        self._format = "gbrpf32le"
        if self._codec != "exr":
            encoding = choose_encoding(
                info,
                lambda name, _: name == self._codec,
                self._path.suffix,
                codec=self._codec,
                pix_fmt=pix_fmt,
            )
            self._format, self.notes = encoding.pixel_format, encoding.reasons
        self.notes = (*self.notes, *remove_stale(self._path))
        self._folder = partial_name(self._path)
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{spec}: cannot be written ({error.strerror})") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        if self._folder.is_dir() and self._keep and self._written:
            self.kept = self._path.with_name(f"{self._path.stem}.partial")
            shutil.rmtree(self.kept, ignore_errors=True)  # of an earlier run
            with contextlib.suppress(OSError):
                self._folder.rename(self.kept)
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
            write_layers(target, picture_channels(frame.picture))
        else:
            try:
                target.write_bytes(self._encode(frame))
            except (av.FFmpegError, OSError, ValueError) as error:
                reason = getattr(error, "strerror", None) or str(error)
                raise OutputError(f"{self._path}: cannot be written ({reason})") from error
        self._written.append(path)

    def write_packet(self, packet: Packet) -> None:
        """Pictures carry no other streams."""

    def commit(self) -> None:
        """Give the files their names.

        Raises:
            OutputError: they cannot be written.
        """
        for path in self._written:
            publish(self._folder / path.name, path)
        shutil.rmtree(self._folder, ignore_errors=True)

    def _name(self, index: int) -> Path:
        return self._numbered.path(self._first + index) if self._numbered else self._path

    def _encode(self, frame: SourceFrame) -> bytes:
        jpeg = self._codec == "mjpeg" and self._info.codec != "mjpeg"
        if jpeg or self._info.rotation:  # JPEG has its own matrix, and turning wants whole pixels
            pixels = picture_frame(frame.picture, self._whole_format())
            if self._info.rotation:
                pixels = upright_frame(pixels, self._info.rotation)
            pixels = converted(pixels, self._format)
        else:
            pixels = picture_frame(frame.picture, self._format)
        context = av.CodecContext.create(self._codec, "w")
        if not isinstance(context, VideoCodecContext):
            raise OutputError(f"{self._codec} is no picture encoder")
        context.width, context.height, context.pix_fmt = pixels.width, pixels.height, self._format
        context.time_base = Fraction(1, 25)
        context.thread_count = 1
        context.color_range, context.colorspace = pixels.color_range, pixels.colorspace
        context.color_primaries, context.color_trc = pixels.color_primaries, pixels.color_trc
        context.options = dict(_QUALITY.get(self._codec, {}))
        pixels.pts, pixels.pict_type = 0, 0
        pixels.time_base = Fraction(1, 25)
        packets = [*context.encode(pixels), *context.encode(None)]
        return b"".join(bytes(packet) for packet in packets)

    def _whole_format(self) -> str:
        """A format that holds the encoder's without subsampling."""
        kind = layout(working_format(self._format))
        if kind is None or kind.family == "yuv":
            return "rgb24" if kind is None or kind.bits == 8 else "rgb48le"
        return working_format(self._format)


def _first_number(source: str) -> int:
    return ImageSequence(source).first() if ImageSequence.matches(source) else 0
