"""Where the chroma samples of a stream lie among its luma samples."""

from __future__ import annotations

import io
import re

import av
import av.video.stream

_CENTRED = ("mjpeg", "mpeg1video")
"""Codecs whose 4:2:0 and 4:2:2 have chroma midway between luma columns (JFIF, ISO 11172-2)."""
_MATROSKA = re.compile(rb"\x55\xb7\x81([\x01\x02])\x55\xb8\x81([\x01\x02])")
"""Matroska's ChromaSitingHorz and ChromaSitingVert: on the first of two samples, or between."""
_SITINGS = {(1, 1): "topleft", (1, 2): "left", (2, 1): "top", (2, 2): "center"}
_Y4M_SITINGS = {b"C420jpeg": "center", b"C420mpeg2": "left", b"C420paldv": "topleft"}


def chroma_siting(stream: av.video.stream.VideoStream) -> str:
    """FFmpeg's name of the chroma location of a stream; empty where it does not say.

    PyAV does not tell it: it is read from a header that FFmpeg's Matroska muxer makes in memory, or
    that of Y4M, whose frames Matroska does not hold.
    """
    if stream.codec.name in _CENTRED:
        return "center"
    if stream.container.format.name == "yuv4mpegpipe":
        words = _header(stream, "yuv4mpegpipe").split()
        return next((_Y4M_SITINGS[word] for word in words if word in _Y4M_SITINGS), "")
    found = _MATROSKA.search(_header(stream, "matroska"))
    return _SITINGS[found[1][0], found[2][0]] if found else ""


def _header(stream: av.video.stream.VideoStream, container: str) -> bytes:
    """Header of a file of the stream; empty where the container does not hold its codec."""
    file = io.BytesIO()
    try:
        with av.open(file, "w", format=container) as header:
            header.add_stream_from_template(stream, opaque=True)
            header.start_encoding()
    except (av.FFmpegError, ValueError, OSError):
        return b""
    return file.getvalue()
