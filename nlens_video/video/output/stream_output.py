"""Results written as they come, under no temporary name: standard output, named pipes, URLs."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import BinaryIO
from urllib.parse import urlsplit

import av
import av.container

from nlens_video.core.errors import OutputError
from nlens_video.video.output.muxers import Muxer, muxer, nothing_writes
from nlens_video.video.output.still_sink import EXTENSIONS

_BY_SCHEME = {"rtmp": "flv", "rtsp": "rtsp", "tcp": "mpegts", "udp": "mpegts"}
"""Containers of protocols whose addresses have no extension."""
_CAMERAS = "/dev/video"
_MP4_FAMILY = (".mp4", ".mov", ".m4v", ".3gp")
_UNSOUGHT = {"movflags": "frag_keyframe+delay_moov+default_base_moof"}
"""MP4 and MOV in parts: nothing can be written into their beginning later."""


def is_stream(spec: str) -> bool:
    """Whether a result is written as it comes: it is no regular file, nor will it be one."""
    if spec == "-" or "://" in spec or spec.startswith(_CAMERAS):
        return True
    path = Path(spec)
    picture = path.suffix.lower() in EXTENSIONS
    return not picture and (path.is_fifo() or path.is_char_device())


class StreamOutput:
    """A container that is written as it comes.

    Args:
        spec: for which `is_stream` holds.

    Attributes:
        container: FFmpeg's.

    Raises:
        OutputError: it cannot be written there, or its container is not known.
    """

    def __init__(self, spec: str) -> None:
        self._file: BinaryIO | None = None
        try:
            self.container = self._opened(spec)
        except ValueError as error:
            raise OutputError(
                f"{spec}: nothing says which container to write; end it in .mkv, .ts or .flv, or "
                f"give one of {', '.join(_BY_SCHEME)}://"
            ) from error
        except (av.FFmpegError, OSError) as error:
            raise OutputError(f"{spec}: cannot be written ({error.strerror})") from error

    def close(self) -> None:
        """Let go of a pipe, so that its reader sees the end."""
        if self._file is not None:
            self._file.close()

    def _opened(self, spec: str) -> av.container.OutputContainer:
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
        options = _UNSOUGHT if suffix in _MP4_FAMILY else {}
        found = muxer(spec) if suffix else Muxer("nut", "rawvideo")
        if found is None:
            raise OutputError(nothing_writes(spec))
        # opened here: waiting for the reader of a named pipe must not keep Ctrl-C from being heard
        self._file = Path(spec).open("wb")
        return av.open(_Pipe(self._file), "w", format=found.name, container_options=options)


class _Pipe:
    """What FFmpeg writes to: an interrupt ends a write that a stalled reader blocks.

    PyAV loses what is raised here, so the interrupt is left for `signals.check` to raise.
    """

    def __init__(self, pipe: BinaryIO) -> None:
        self._pipe = pipe

    def write(self, data: bytes) -> int:
        """Write all of it, nowhere once the run is interrupted."""
        try:
            self._pipe.write(data)
        except KeyboardInterrupt:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._pipe.fileno())
            os.close(nowhere)
        return len(data)
