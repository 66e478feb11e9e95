"""Opening of results: whatever FFmpeg writes, pictures, sequences and OpenEXR."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from nlens_video.core.errors import OutputError, UsageError
from nlens_video.video.atomic_files import check_folder
from nlens_video.video.info import SourceInfo
from nlens_video.video.interfaces import Sink
from nlens_video.video.named_files import ImageSequence, NamedFiles, local_path
from nlens_video.video.output.containers import holds_video
from nlens_video.video.output.encoders import (
    check_crf,
    check_pixel_format,
    encoder_called,
    not_held,
    some_format,
)
from nlens_video.video.output.encoding import choose_encoding
from nlens_video.video.output.picture_files import ANIMATED, EXTENSIONS, picture_encoding
from nlens_video.video.output.still_sink import StillSink
from nlens_video.video.output.stream_output import NUT, is_stream, muxer
from nlens_video.video.output.video_sink import VideoSink


def open_sink(
    spec: str, info: SourceInfo, *, codec: str | None = None, crf: float | None = None,
    pix_fmt: str | None = None, keep_partial: bool = False, one_frame: bool = False,
) -> Sink:  # fmt: skip
    """Open a result; nothing of that name exists before `commit`.

    Args:
        spec: video file by its extension, picture, `%04d` sequence, `-` for standard output, a
            named pipe or an address.
        info: the source whose timing, tags and other streams are carried over.
        codec: encoder or codec family; default: the source's family.
        crf: quality; default: visually lossless.
        pix_fmt: pixel format; default: the source's.
        keep_partial: whether an aborted run leaves a playable file.
        one_frame: whether the result has only one frame.

    Raises:
        OutputError: it cannot be written there, or nothing writes that extension.
        UsageError: codec, quality or pixel format do not exist, do not go together, or are given
            for pictures.
    """
    if not is_stream(spec):
        path = Path(spec)
        check_folder(path)
        plate = local_path(info.name)
        if plate is not None and NamedFiles(path).meets(NamedFiles(plate)):
            raise OutputError(f"{spec}: is the input as well; give the result another name")
        if _is_animated(spec, info, one_frame=one_frame):
            return VideoSink(spec, info, codec=codec, crf=crf, pix_fmt=pix_fmt)
        if path.suffix.lower() in EXTENSIONS:
            _check_one_picture(spec, info, one_frame=one_frame)
            _check_pictures(spec, codec, crf, pix_fmt)
            return StillSink(spec, info, pix_fmt=pix_fmt, keep_partial=keep_partial)
    return VideoSink(
        spec, info, codec=codec, crf=crf, pix_fmt=pix_fmt, keep_partial=keep_partial
    )  # fmt: skip


def notes_on_encoding(
    spec: str, info: SourceInfo, *, codec: str | None = None, crf: float | None = None,
    pix_fmt: str | None = None, one_frame: bool = False,
) -> tuple[str, ...]:  # fmt: skip
    """What pictures lose by the encoder and the pixel format of a result, which is not opened.

    Nothing is told of addresses, devices and named pipes, and of what is no picture.

    Args:
        spec: as `open_sink`.
        info: as `open_sink`.
        codec: as `open_sink`.
        crf: as `open_sink`.
        pix_fmt: as `open_sink`.
        one_frame: as `open_sink`.

    Raises:
        OutputError: nothing writes that extension, its container holds no such pictures, or it is
            one picture and the source is not.
        UsageError: as `open_sink`.
    """
    if spec != "-" and is_stream(spec):
        return ()
    container, suffix = NUT, Path(spec).suffix.lower()
    if spec == "-":
        codec = codec or container.video_codec
    elif suffix in EXTENSIONS and not _is_animated(spec, info, one_frame=one_frame):
        _check_one_picture(spec, info, one_frame=one_frame)
        return () if suffix == ".exr" else picture_encoding(info, suffix, pix_fmt).reasons
    else:
        container = muxer(spec)
    name = container.name
    return choose_encoding(
        info, partial(holds_video, name), name, default=container.video_codec,
        codec=codec, crf=crf, pix_fmt=pix_fmt,
    ).reasons  # fmt: skip


def _check_one_picture(spec: str, info: SourceInfo, *, one_frame: bool) -> None:
    """Refuse one picture as the result of many frames."""
    if not (info.kind == "still" or one_frame or ImageSequence.matches(spec)):
        raise OutputError(
            f"{spec}: is one picture, the plate is a {info.kind}; give --frame N, a video "
            "or a sequence such as out_%04d.png"
        )


def _is_animated(spec: str, info: SourceInfo, *, one_frame: bool) -> bool:
    """Whether a file of a kind that holds pictures and videos is to hold a video."""
    kind = Path(spec).suffix.lower() in ANIMATED and not ImageSequence.matches(spec)
    return kind and info.kind != "still" and not one_frame


def check_output(
    spec: str, *, codec: str | None = None, crf: float | None = None, pix_fmt: str | None = None
) -> None:
    """Check a result's name and options before its source is opened.

    Fast where `codec` is None; else the codec is tried in the container, in memory. Not checked is
    what depends on the source: its size, its rate, whether it is a still.

    Args:
        spec: video file by its extension, picture, `%04d` sequence, or `-` for standard output.
        codec: as `open_sink`.
        crf: as `open_sink`.
        pix_fmt: as `open_sink`.

    Raises:
        OutputError: the folder is missing or read-only, nothing writes that extension, or its
            container holds no pictures.
        UsageError: codec, quality or pixel format do not exist, do not go together, or are given
            for pictures.
    """
    encoder = None if codec is None else encoder_called(codec)
    if pix_fmt is not None:
        check_pixel_format(pix_fmt, encoder)
    if crf is not None and encoder is not None:
        check_crf(crf, encoder)
    if spec != "-" and is_stream(spec):
        return
    container = NUT
    if spec != "-":
        path = Path(spec)
        check_folder(path)
        if path.suffix.lower() in EXTENSIONS:
            _check_pictures(spec, codec, crf, pix_fmt)
            return
        container = muxer(spec)
    container.check_video(spec)
    if encoder is not None and not holds_video(container.name, encoder, some_format(encoder)):
        raise UsageError(not_held(str(codec), container.name))


def _check_pictures(spec: str, codec: str | None, crf: float | None, pix_fmt: str | None) -> None:
    """Refuse encoder options for pictures."""
    suffix = Path(spec).suffix.lower()
    given = {"--codec": codec, "--crf": crf, "--pix-fmt": pix_fmt if suffix == ".exr" else None}
    for option, value in given.items():
        if value is not None:
            raise UsageError(
                f"{option} {value}: {spec} is written as {suffix[1:]}, which has no such choice; "
                f"leave {option} out or give a video"
            )
