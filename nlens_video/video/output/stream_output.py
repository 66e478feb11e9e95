"""Destinations of results: muxers by file names; standard output, named pipes and URLs."""

from __future__ import annotations

import os
import sys
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO
from urllib.parse import urlsplit

import av
import av.container
from msgspec import Struct

from nlens_video.core.errors import OutputError
from nlens_video.video.named_files import ImageSequence
from nlens_video.video.output.picture_files import EXTENSIONS, check_kind
from nlens_video.video.output.trials import UNOFFICIAL

_BY_SCHEME = {"rtmp": "flv", "rtsp": "rtsp", "tcp": "mpegts", "udp": "mpegts"}
"""Containers of protocols whose URLs have no extension."""
_CAMERAS = "/dev/video"
_SOUND_ONLY = ("mp3", "flac")
"""Muxers whose default video codec is for covers only."""
_MP4_FAMILY = (".mp4", ".mov", ".m4v", ".3gp")
_WAIT_S = Fraction(1, 5)
"""Time for which pictures of a stream wait for its sound, which may pause; FFmpeg's is 10 s [s]."""
_HELD = 80
"""Frames that encoders hold back, and sound must wait for: SVT-AV1 74, x264 41 [1]."""
_FRAGMENTED = {"movflags": "frag_keyframe+delay_moov+default_base_moof"}
"""Fragmented MP4 and MOV: a pipe cannot be rewound to write the index."""


class Muxer(Struct, frozen=True):
    """A muxer.

    Attributes:
        name: FFmpeg's.
        video_codec: its default codec of pictures; `none` where it holds none.
    """

    name: str
    video_codec: str

    def check_video(self, spec: str) -> None:
        """Refuse a container that is no single file, or is without pictures, for a result.

        Raises:
            OutputError: it is several files, which cannot be replaced at once, holds sound only, or
                is for pictures of a kind that is not written.
        """
        check_kind(spec, self.name, numbered=ImageSequence.matches(spec))
        if av.ContainerFormat(self.name, "w").no_file and "://" not in spec:
            raise OutputError(
                f"{spec}: {self.name} writes several files; give - as OUT, then "
                f"| ffmpeg -i - {spec}"
            )
        if self.video_codec == "none" or self.name in _SOUND_ONLY:
            kind = f"{Path(spec).suffix} files hold"
            raise OutputError(f"{spec}: {kind} no video; try .mp4, .mov, .mkv, .webm, .png")


NUT = Muxer("nut", "rawvideo")
"""Muxer of standard output."""


def muxer(spec: str) -> Muxer:
    """The muxer of a file's name; no file is made.

    Raises:
        OutputError: nothing writes such files.
    """
    try:
        with av.open(f"file:{spec}", "w") as container:
            return Muxer(container.format.name, container.default_video_codec)
    except ValueError as error:
        raise nothing_writes(spec) from error


def nothing_writes(spec: str) -> OutputError:
    """Error of a file's name without a muxer."""
    return OutputError(f"{spec}: nothing writes this extension; try .mp4, .mov, .mkv, .webm, .png")


def is_stream(spec: str) -> bool:
    """Whether a result is a standard stream, a URL, a device or a pipe, not a regular file."""
    if spec == "-" or "://" in spec or spec.startswith(_CAMERAS):
        return True
    path = Path(spec)
    picture = path.suffix.lower() in EXTENSIONS
    return not picture and (path.is_fifo() or path.is_char_device())


class StreamOutput:
    """A container that is written sequentially.

    Args:
        spec: a name for which `is_stream` is true.

    Attributes:
        container: FFmpeg's.

    Raises:
        OutputError: it cannot be written there, or its container is not known.
    """

    def __init__(self, spec: str) -> None:
        self._file: BinaryIO | None = None
        try:
            self.container = self._open(spec)
        except ValueError as error:
            raise OutputError(
                f"{spec}: nothing says which container to write; end it in .mkv, .ts or .flv, or "
                f"give one of {', '.join(_BY_SCHEME)}://"
            ) from error
        except (av.FFmpegError, OSError) as error:
            raise OutputError(f"{spec}: cannot be written ({error.strerror})") from error

    def limit_wait(self, codec: av.Codec, rate: Fraction) -> None:
        """Set how long a packet waits for those of other streams; call before the first one.

        Args:
            codec: the encoder of the pictures.
            rate: of these [1/s].
        """
        wait_s = _WAIT_S + (_HELD / rate if codec.delay else 0)
        ticks = round(wait_s * av.time_base)
        self.container.container_options["max_interleave_delta"] = str(ticks)

    def close(self) -> None:
        """Close a pipe, so that its reader sees the end."""
        if self._file is not None:
            self._file.close()

    def _open(self, spec: str) -> av.container.OutputContainer:
        if spec == "-":
            if sys.stdout is None:
                raise OutputError("standard output: is closed; give OUT a name, or pipe it on")
            return av.open(_Pipe(sys.stdout.buffer), "w", format="nut")
        if "://" in spec:
            return av.open(spec, "w", format=_BY_SCHEME.get(urlsplit(spec).scheme))
        if spec.startswith(_CAMERAS):
            raise OutputError(
                f"{spec}: devices are written by FFmpeg; give - as OUT, then "
                f"| ffmpeg -i - -pix_fmt yuv420p -f v4l2 {spec}"
            )
        suffix = Path(spec).suffix.lower()
        found = muxer(spec) if suffix else NUT
        options = _FRAGMENTED if suffix in _MP4_FAMILY else UNOFFICIAL.get(found.name, {})
        # opened here, where Ctrl-C interrupts the wait for the reader of a named pipe
        self._file = Path(spec).open("wb")
        return av.open(_Pipe(self._file), "w", format=found.name, container_options=options)


class _Pipe:
    """File that FFmpeg writes to; an interrupt ends a write that a stalled reader blocks.

    PyAV loses exceptions that are raised here: `signals.check` raises the interrupt.
    """

    def __init__(self, pipe: BinaryIO) -> None:
        self._pipe = pipe

    def write(self, data: bytes) -> int:
        """Write all bytes; after an interrupt, discard them."""
        try:
            self._pipe.write(data)
        except KeyboardInterrupt:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._pipe.fileno())
            os.close(nowhere)
        return len(data)
