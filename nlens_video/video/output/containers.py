"""What a container holds, found by writing a trial in memory and reading it back.

FFmpeg's tables do not tell: some muxers (MPEG-TS, MXF, MPEG program streams) have none, others
write what no reader recognises. A container holds a codec if its muxer writes a trial and FFmpeg
reads the same codec out of it again.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from fractions import Fraction
from functools import cache

import av
import av.container
import numpy as np
from av.audio.stream import AudioStream
from av.stream import Disposition, Stream
from av.video.stream import VideoStream

from nlens_video.video.info import CopiedStream
from nlens_video.video.output.muxers import MP4_FAMILY, canonical, is_recent

_PROGRAM_STREAMS = ("mpeg", "vob", "svcd", "vcd", "dvd")
"""These name no codec: readers guess, and only MPEG-1 and MPEG-2 are guessed by all of them."""
_RTSP = ("libx264", "libx265", "libvpx", "libvpx-vp9", "mpeg4", "mpeg2video", "mpeg1video", "mjpeg")
"""Encoders of what RTP has a form for; a trial would need a server."""
_PICTURES_FIRST = ("mxf", "gxf", "dv")
"""These take sound beside pictures only."""
_SIZE = (352, 288)  # one that H.263 and DNxHR have, too [px]
_SIZES = {"dvvideo": (720, 576)}
_BLOCK = 1152
"""Samples of sound in a block of a trial, where the encoder does not say [1]."""
_OPTIONS = {
    "libx265": {"x265-params": "log-level=none"},
    "dnxhd": {"profile": "dnxhr_hq"},
    "libvpx": {"auto-alt-ref": "0"},  # with which it refuses transparency
}
_ALPHA_BESIDE = ("libvpx", "libvpx-vp9")
"""Encoders that put alpha beside the pictures, where Matroska alone has a place for it."""
_KNOWN_BY_PACKETS = {("mpegts", "dts")}  # empty ones of a trial do not do
_SPECIAL = ("vorbis", "dts", "truehd")  # FFmpeg's encoders of these are experiments
_Write = Callable[[av.container.OutputContainer], None]


@cache
def holds_video(container: str, encoder: str, pixel_format: str) -> bool:
    """Whether pictures of an encoder can be read again from a container.

    Args:
        container: FFmpeg's name of the muxer.
        encoder: FFmpeg's name of it.
        pixel_format: FFmpeg's name of the one that the encoder is given.
    """
    if container == "rtsp":
        return encoder in _RTSP
    if container in _PROGRAM_STREAMS and encoder not in ("mpeg1video", "mpeg2video"):
        return False
    beside = encoder in _ALPHA_BESIDE and pixel_format == "yuva420p"
    if beside and container not in ("matroska", "webm"):
        return False

    def write(out: av.container.OutputContainer) -> None:
        _fill(out, _pictures(out, encoder, pixel_format))

    return _is_found_again(container, encoder, write, pixel_format)


@cache
def holds_audio(container: str, encoder: str) -> bool:
    """Whether sound of an encoder can be read again from a container.

    Args:
        container: FFmpeg's name of the muxer.
        encoder: FFmpeg's name of it.
    """
    codec = av.Codec(encoder, "w")
    rates = codec.audio_rates or (48000,)
    rate = 48000 if 48000 in rates else rates[0]

    def write(out: av.container.OutputContainer) -> None:
        pictures = _pictures_beside(out)
        stream = out.add_stream(encoder, rate, layout="mono" if "amr" in encoder else "stereo")
        if not isinstance(stream, AudioStream):
            raise ValueError(f"{encoder} is no audio encoder")
        context = stream.codec_context
        context.open()
        _fill(out, pictures)
        size = context.frame_size or _BLOCK
        for index in range(12):
            block = av.AudioFrame(context.format.name, context.layout.name, size)
            for plane in block.planes:
                plane.update(bytes(plane.buffer_size))
            block.sample_rate, block.time_base = rate, Fraction(1, rate)
            block.pts = index * size
            out.mux(stream.encode(block))
        out.mux(stream.encode(None))

    return _is_found_again(container, encoder, write)


def holds_stream(container: str, stream: CopiedStream) -> bool:
    """Whether a container takes a stream undecoded.

    Args:
        container: FFmpeg's name of the muxer.
        stream: of an open source.
    """
    if stream.type == "attachment":
        return container == "matroska"  # files that hold nothing else cannot be read
    if is_recent(container, stream.codec) or not _takes_header(container, stream.stream):
        return False
    if av.ContainerFormat(container, "w").no_file:
        return True
    if (container, canonical(stream.codec)) in _KNOWN_BY_PACKETS:
        return True
    if encoder := _encoder_of(stream):
        if stream.type == "audio":
            return holds_audio(container, encoder)
        formats = av.Codec(encoder, "w").video_formats
        return holds_video(container, encoder, formats[0].name if formats else "yuv420p")
    return _comes_back(container, stream.stream)


def copy_of(container: av.container.OutputContainer, template: Stream) -> Stream:
    """Add a stream that takes another's packets undecoded; with its tags and dispositions.

    Raises:
        ValueError: the container does not hold it.
    """
    stream = container.add_stream_from_template(template, opaque=True)
    stream.metadata.update(template.metadata)
    stream.disposition = template.disposition
    return stream


def _encoder_of(stream: CopiedStream) -> str:
    """An encoder of a copied stream's codec, empty where there is none to make a trial with."""
    if stream.type not in ("audio", "video"):
        return ""
    try:
        codec = av.Codec(stream.codec, "r").canonical_name
        return "" if codec in _SPECIAL else av.Codec(codec, "w").name
    except ValueError:
        return ""


def _takes_header(container: str, template: Stream) -> bool:
    # The MP4 family writes what it knows of a stream at the end, unless the file is fragmented; of
    # AC-3 it knows nothing before the first packet.
    context = template.codec_context
    late = context is not None and context.name in ("ac3", "eac3")
    picture = bool(template.disposition & Disposition.attached_pic)
    early = container in MP4_FAMILY and not late and not picture
    options = {"movflags": "empty_moov"} if early else {}
    try:
        with av.open(_target(container), "w", format=container, container_options=options) as trial:
            _pictures_beside(trial)
            copy_of(trial, template)
            if not trial.format.no_file:
                trial.start_encoding()
    except (av.FFmpegError, ValueError, OSError):
        return False
    return True


def _target(container: str) -> io.BytesIO | str:
    """What to open for a trial: a muxer of many files (HLS) makes none before its header."""
    return "nowhere" if av.ContainerFormat(container, "w").no_file else io.BytesIO()


def _is_found_again(container: str, encoder: str, write: _Write, pixel_format: str = "") -> bool:
    """Write a trial; see whether its codec, for raw video with its format, can be read from it."""
    if av.ContainerFormat(container, "w").no_file:
        with av.open("nowhere", "w", format=container) as out:
            return encoder in out.supported_codecs
    file = io.BytesIO()
    try:
        with av.open(file, "w", format=container) as out:
            write(out)
    except (av.FFmpegError, ValueError, OSError):
        return False
    kind, name = _named(av.Codec(encoder, "w"))
    return (kind, _raw(name, pixel_format)) in _found(file)


def _comes_back(container: str, template: Stream) -> bool:
    """Whether a stream is of its own kind again in a trial whose packets are empty."""
    file = io.BytesIO()
    try:
        with av.open(file, "w", format=container) as out:
            pictures = _pictures_beside(out)
            stream = copy_of(out, template)
            _fill(out, pictures)
            for index in range(8):
                packet = av.Packet(bytes(64))
                packet.pts = packet.dts = index
                packet.time_base, packet.stream = Fraction(1, 25), stream
                out.mux(packet)
    except (av.FFmpegError, ValueError, OSError):
        return False
    return _kind(template) in _found(file)


def _found(file: io.BytesIO) -> set[tuple[str, str]]:
    """Types and codecs of the streams that FFmpeg finds in a trial."""
    file.seek(0)
    try:
        with av.open(file, "r") as container:
            return {_kind(stream) for stream in container.streams}
    except (av.FFmpegError, ValueError, OSError):
        return set()


def _kind(stream: Stream) -> tuple[str, str]:
    """Type and codec, as `_named` has it."""
    context = stream.codec_context
    if context is None:
        return stream.type, getattr(stream, "name", None) or ""
    kind, name = _named(context.codec)
    return kind, _raw(name, getattr(context, "pix_fmt", None) or "")


def _raw(codec: str, pixel_format: str) -> str:
    """Codec of a stream, for raw video with its format: some muxers give bytes a wrong name."""
    return f"rawvideo {pixel_format.replace('yuvj', 'yuv')}" if codec == "rawvideo" else codec


def _named(codec: av.Codec) -> tuple[str, str]:
    """Type and codec; the layers of MPEG audio are one, readers tell them by the packets."""
    name = codec.canonical_name
    return codec.type, "mpegaudio" if name in ("mp1", "mp2", "mp3") else name


def _pictures(out: av.container.OutputContainer, encoder: str, pixel_format: str) -> VideoStream:
    stream = out.add_stream(encoder, 25, dict(_OPTIONS.get(encoder, {})))
    if not isinstance(stream, VideoStream):
        raise ValueError(f"{encoder} is no video encoder")
    stream.width, stream.height = _SIZES.get(encoder, _SIZE)
    stream.pix_fmt = pixel_format
    stream.time_base = stream.codec_context.time_base = Fraction(1, 25)
    return stream


def _pictures_beside(out: av.container.OutputContainer) -> VideoStream | None:
    """Pictures before the sound of a trial, where the container wants them."""
    if out.format.name not in _PICTURES_FIRST:
        return None
    return _pictures(out, out.default_video_codec, "yuv420p")


def _fill(out: av.container.OutputContainer, pictures: VideoStream | None) -> None:
    if pictures is None:
        return
    for index in range(3):
        out.mux(pictures.encode(_noise(pictures, index)))
    out.mux(pictures.encode(None))


def _noise(stream: VideoStream, index: int) -> av.VideoFrame:
    """A frame of a trial: of noise, for plain ones make streams too short to be recognised."""
    frame = av.VideoFrame(stream.width, stream.height, stream.pix_fmt or "yuv420p")
    for plane in frame.planes:
        random = np.random.default_rng(index)
        plane.update(random.integers(0, 256, plane.buffer_size, np.uint8).tobytes())
    frame.pts, frame.time_base = index, Fraction(1, 25)
    return frame
