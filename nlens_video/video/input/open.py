"""Opening of FFmpeg's inputs: files, devices, addresses and standard input."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import av
import av.container
import av.video.stream
from av.codec.context import Flags
from av.stream import Disposition
from av.video.codeccontext import VideoCodecContext
from msgspec import Struct

from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import MOST_PIXELS, too_large
from nlens_video.core.stdio import StandardInput
from nlens_video.video.info import Kind, is_cover
from nlens_video.video.input.lost_connections import explain_lost, why_lost
from nlens_video.video.named_files import DEFAULT_RATE, ImageSequence, exists, is_file

_TIMELESS = (
    "rawvideo", "h264", "hevc", "vvc", "obu", "m4v", "mjpeg", "mpegvideo", "vc1", "dnxhd",
    "image2pipe",
)  # fmt: skip
"""Formats without time stamps, besides image files and devices."""
_NO_DEVICES = ("image2", "rtp", "rtsp", "sap", "alsa", "oss")
"""FFmpeg's inputs without a file of their own that are no video devices."""

_WITH_ALPHA = {"vp8": "libvpx", "vp9": "libvpx-vp9"}
"""Decoders that read alpha, for FFmpeg's default ones, which drop it."""

DECODER = {"max_pixels": str(MOST_PIXELS)}
"""FFmpeg's options of all decoders: larger pictures are refused, wherever they come."""


STRICT = DECODER | {"err_detect": "explode"}
"""Options with which a decoder fails on damage that it would conceal without a word."""


class InputHints(Struct, frozen=True, kw_only=True):
    """How to open an input, and what it does not say of itself.

    Attributes:
        format: FFmpeg's name of a container or device, or of a pixel format: then raw video.
        size: `WIDTHxHEIGHT`.
        rate: frames per second, `25` or `30000/1001`.
        transfer: name in `color.TRANSFERS`, overrides the tag.
        within_s: how long opening may wait, None for as long as it takes [s].
    """

    format: str | None = None
    size: str | None = None
    rate: str | None = None
    transfer: str | None = None
    within_s: float | None = None


def can_be_read_again(spec: str) -> bool:
    """Whether a source is a file or a sequence of files, not a pipe, a device or an address."""
    if spec == "-" or "://" in spec or spec.startswith("/dev/"):
        return False
    return is_file(Path(spec)) or ImageSequence.matches(spec)


def open_container(spec: str, hints: InputHints) -> tuple[av.container.InputContainer, Kind]:
    """Open an input and tell its kind.

    Raises:
        InputError: it cannot be opened or is no media.
        UsageError: raw video without a size; a size or a rate that the input states itself.
    """
    file: object = spec
    kind: Kind = "video"
    format_, options = _format(hints)
    if spec == "-":
        file, kind = _standard_input(), "stream"
    elif "://" in spec or spec.startswith("/dev/"):
        kind = "stream"
        if spec.startswith("/dev/video"):
            format_ = format_ or "v4l2"
    elif format_ and format_ != "image2" and _is_device(format_):
        kind = "stream"
    elif is_file(Path(spec)):
        # an existing file: no pattern although it has a %d, no protocol although it has a colon
        check_file(spec)
        file = f"file:{spec}"
    elif ImageSequence.matches(spec):
        first = ImageSequence(spec).span().start
        format_, kind = "image2", "sequence"
        options |= {"start_number": str(first), "framerate": hints.rate or DEFAULT_RATE}
    else:
        check_file(spec)
        kind = "stream" if Path(spec).is_fifo() else kind
    options |= DECODER  # for what probing decodes
    began = time.monotonic()
    try:
        limits = (hints.within_s, None)  # of opening, and none of later reads
        container = av.open(file, "r", format=format_, options=options, timeout=limits)
    except (av.FFmpegError, OSError, ValueError) as error:
        lost = why_lost(spec, error, time.monotonic() - began)
        raise InputError(explain_lost(spec, lost) if lost else _explain(spec, error)) from error
    if kind == "video" and _is_picture(container.format):
        kind = "still"
    try:
        _check_hints(spec, hints, container.format, kind)
    except UsageError:
        container.close()
        raise
    return container, kind


def _standard_input() -> StandardInput:
    if sys.stdin is None:  # closed from the start
        raise InputError("standard input: it is closed; pipe a stream in or name a file")
    return StandardInput()


def videos(container: av.container.InputContainer) -> list[av.video.stream.VideoStream]:
    """The videos of a container, covers left out."""
    return [one for one in container.streams.video if not is_cover(one)]


def video_stream(container: av.container.InputContainer, spec: str) -> av.video.stream.VideoStream:
    """The stream that is composited on: the largest of the default videos, else of all.

    Raises:
        InputError: there is none.
    """
    stream = max(videos(container), key=_standing, default=None)
    if stream is None:
        kinds = ", ".join(sorted({one.type for one in container.streams})) or "nothing"
        raise InputError(f"{spec}: has no video stream (found: {kinds}); give a video or a picture")
    if stream.codec_context is None:
        raise InputError(f"{spec}: nothing here decodes its video stream; convert it first")
    return stream


def _standing(stream: av.video.stream.VideoStream) -> tuple[bool, int]:
    """Whether a video is called the default one, and how many pixels it has."""
    context = stream.codec_context
    pixels = 0 if context is None else context.width * context.height
    return bool(stream.disposition & Disposition.default), pixels


def decoder_of(stream: av.video.stream.VideoStream) -> VideoCodecContext:
    """Decoder of a stream: FFmpeg's default, or for VP8 and VP9 with alpha one that reads it."""
    context = _decoder(stream)
    context.flags |= Flags.unaligned  # else cropping at the left leaves some hidden columns
    return context


def _decoder(stream: av.video.stream.VideoStream) -> VideoCodecContext:
    own = stream.codec_context
    alpha = "1" in (value for key, value in stream.metadata.items() if key.lower() == "alpha_mode")
    if not alpha or own.name not in _WITH_ALPHA:
        return own
    context = av.CodecContext.create(_WITH_ALPHA[own.name], "r")
    if not isinstance(context, VideoCodecContext):
        return own
    context.extradata = own.extradata
    for name in ("colorspace", "color_range", "color_primaries", "color_trc"):
        setattr(context, name, getattr(own, name))  # as the container states them
    return context


def _format(hints: InputHints) -> tuple[str | None, dict[str, str]]:
    """FFmpeg's input format and its options."""
    options: dict[str, str] = {}
    if hints.size is not None:
        options["video_size"] = hints.size
    if hints.rate is not None:
        options["framerate"] = hints.rate
    name = hints.format
    if name is None or name != "rawvideo" and _is_container(name):
        return name, options
    if name != "rawvideo":
        try:
            av.VideoFormat(name)
        except ValueError as error:
            raise UsageError(
                f"--input-format {name}: FFmpeg has no such container, device or pixel format here;"
                f" its devices are {', '.join(_devices())}; for raw video give a pixel format such "
                "as yuv420p or bgr24"
            ) from error
        options["pixel_format"] = name
    if hints.size is None:
        raise UsageError("raw video does not say its size; give --input-size WIDTHxHEIGHT")
    return "rawvideo", options


def _is_device(name: str) -> bool:
    """Whether an input format opens no file: its names are no paths."""
    return av.ContainerFormat(name, "r").no_file


def _is_container(name: str) -> bool:
    """Whether FFmpeg has an input format (container or device) of that name."""
    try:
        return av.ContainerFormat(name, "r").is_input
    except ValueError:
        return False


def _devices() -> list[str]:
    """Names of the video devices that FFmpeg was built with."""
    return [
        name.split(",")[-1]
        for name in sorted(av.formats_available)
        if name not in _NO_DEVICES and _is_container(name) and _is_device(name)
    ]


def check_file(spec: str) -> None:
    """Check that a plate is a file or a named pipe, and is not empty.

    Raises:
        InputError: it is none.
    """
    path = Path(spec)
    if not exists(path):
        raise InputError(f"{spec}: no such file; give a video, a picture or a %04d sequence")
    if not path.is_file() and not path.is_fifo():
        raise InputError(f"{spec}: is no file; give a video, a picture or a %04d sequence")
    if path.is_file() and path.stat().st_size == 0:
        raise InputError(f"{spec}: is empty; give a video or a picture")


def _check_hints(spec: str, hints: InputHints, format_: av.ContainerFormat, kind: Kind) -> None:
    """Refuse options that a container ignores, as most do."""
    device = format_.no_file and kind == "stream" and format_.name != "lavfi"
    for option, value, used in (
        ("--input-size", hints.size, device or format_.name == "rawvideo"),
        ("--input-rate", hints.rate, device or _is_picture(format_) or format_.name in _TIMELESS),
    ):
        if value is not None and not used:
            raise UsageError(
                f"{option} {value}: {spec} ({format_.name}) says that itself; leave it out"
            )


def _is_picture(format_: av.ContainerFormat) -> bool:
    return format_.name == "image2" or format_.name.endswith("_pipe")


def _explain(spec: str, error: Exception) -> str:
    if spec == "-":
        return (
            "standard input: no stream that can be read from a pipe; pipe NUT, Matroska or "
            "yuv4mpeg, or an MP4 made with -movflags +faststart; raw video needs --input-format "
            "and --input-size"
        )
    reason = getattr(error, "strerror", None) or str(error)
    if spec.startswith("/dev/video"):
        return (
            f"{spec}: no camera can be opened there ({reason}); v4l2-ctl --list-devices tells "
            "where there is one"
        )
    return (
        f"{spec}: cannot be opened ({reason}); expected a video, a picture, a %04d sequence "
        f"or a stream that FFmpeg reads, of at most {MOST_PIXELS // 10**6} megapixels"
    )


def explain_undecodable(
    spec: str,
    container: av.container.InputContainer,
    kind: Kind,
    codec: str,
    width: int,
    height: int,
) -> str:
    """Error message for a stream without a decodable frame.

    Args:
        spec: as the user gives it.
        container: of the stream.
        kind: of the source.
        codec: FFmpeg's name.
        width: columns as the header states them [px].
        height: rows as the header states them [px].
    """
    if spec == "-" and "mp4" in container.format.name:
        return (
            "standard input: an MP4 with its index at the end cannot be read from a pipe; "
            "make it with -movflags +faststart, or pipe NUT or Matroska"
        )
    if width * height > MOST_PIXELS:
        return too_large(spec, width, height)
    subject = "the stream" if kind == "stream" else "the file"
    floats = ", of floating point (write OpenEXR, or 16 bits)" if codec == "tiff" else ""
    return (
        f"{spec}: no frame can be decoded ({codec}); {subject} is damaged, not complete{floats} "
        f"or larger than {MOST_PIXELS // 10**6} megapixels"
    )
