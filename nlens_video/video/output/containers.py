"""What a container holds, found by writing a trial in memory and reading it back.

FFmpeg's tables do not tell: some muxers (MPEG-TS, MXF, MPEG program streams) have none, others
write what no reader recognises. A container holds a codec if its muxer writes a trial and FFmpeg
reads the same codec out of it again.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from fractions import Fraction
from functools import cache, partial
from itertools import product
from random import Random
from typing import TypeVar

import av
import av.container
import numpy as np
from av.audio.stream import AudioStream
from av.stream import Stream
from av.video.stream import VideoStream

from nlens_video.video.info import CopiedStream, is_cover
from nlens_video.video.output.encoder_threads import ordinary_priority
from nlens_video.video.output.encoders import encoder_options
from nlens_video.video.output.recent_codecs import canonical, is_recent

MP4_FAMILY = ("mp4", "mov", "ipod", "3gp", "3g2", "ismv", "f4v")
"""FFmpeg's muxers of ISO base media files."""
_PROGRAM_STREAMS = ("mpeg", "vob", "svcd", "vcd", "dvd")
"""These name no codec: readers guess, and only MPEG-1 and MPEG-2 are guessed by all of them."""
_UNTRIED = {
    "rtsp": (
        "libx264", "libx265", "libvpx", "libvpx-vp9", "mpeg4", "mpeg2video", "mpeg1video", "mjpeg",
    ),
    "rawvideo": ("rawvideo",),
}  # fmt: skip
"""Encoders where no trial tells: it would need a server, or the file does not say what it is."""
_PICTURES_FIRST = ("mxf", "gxf", "dv")
"""These hold sound only beside pictures."""
_SIZE = (352, 288)  # one that H.263 and DNxHR have, too [px]
_SIZES = {"dvvideo": (720, 576)}
_BLOCK = 1152
"""Samples of sound in a block of a trial, where the encoder does not say [1]."""
_OPTIONS = {
    "libx264": {"preset": "ultrafast"},
    "libx265": {"preset": "ultrafast", "x265-params": "log-level=none"},
    "libvpx": {"auto-alt-ref": "0"},  # with which it refuses transparency
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8"},
}
"""Of an encoder in a trial, where those of results are slow or fail on it."""
_ALPHA_BESIDE = ("libvpx", "libvpx-vp9")
"""Encoders whose alpha is a second stream, which only Matroska can store."""
_USUAL = frozenset(product(("mp4", "mov", "matroska"), ("libx264", "libx265", "aac")))
"""Muxers that hold what encoders make, known without a trial, which takes 30 ms of a start."""
_KNOWN_BY_PACKETS = {("mpegts", "dts")}  # the empty packets of a trial are not recognised
_SPECIAL = ("vorbis", "dts", "truehd")  # FFmpeg's encoders of these are experimental
_Seen = TypeVar("_Seen")


@cache
def holds_video(container: str, encoder: str, pixel_format: str) -> bool:
    """Whether a container holds pictures of an encoder.

    Args:
        container: FFmpeg's name of the muxer.
        encoder: FFmpeg's name of it.
        pixel_format: FFmpeg's name of the encoder's input format.
    """
    if container in _UNTRIED:
        return encoder in _UNTRIED[container]
    if (container, encoder) in _USUAL and pixel_format == "yuv420p":
        return True
    if container in _PROGRAM_STREAMS and encoder not in ("mpeg1video", "mpeg2video"):
        return False
    beside = encoder in _ALPHA_BESIDE and pixel_format == "yuva420p"
    if beside and container not in ("matroska", "webm"):
        return False

    def write(out: av.container.OutputContainer) -> None:
        _write_video(out, _add_video(out, encoder, pixel_format))

    return _is_found_again(container, encoder, write, pixel_format)


@cache
def holds_audio(container: str, encoder: str) -> bool:
    """Whether a container holds sound of an encoder.

    Args:
        container: FFmpeg's name of the muxer.
        encoder: FFmpeg's name of it.
    """
    if (container, encoder) in _USUAL:
        return True
    return _is_found_again(container, encoder, partial(_write_sound, encoder=encoder))


def read_language(container: str, encoder: str, language: str) -> str:
    """The language that FFmpeg reads of sound that was written with one; empty for none.

    Args:
        container: FFmpeg's name of the muxer.
        encoder: one that it holds.
        language: as the sound's tag has it.
    """
    write = partial(_write_sound, encoder=encoder, language=language)
    return max(_trial(container, write, lambda one: one.metadata.get("language", "")), default="")


def _write_sound(out: av.container.OutputContainer, encoder: str, language: str = "") -> None:
    """Silence, beside pictures where the container requires them."""
    rates = av.Codec(encoder, "w").audio_rates or (48000,)
    rate = 48000 if 48000 in rates else rates[0]
    pictures = _add_needed_video(out)
    stream = out.add_stream(encoder, rate, layout="mono" if "amr" in encoder else "stereo")
    if not isinstance(stream, AudioStream):
        raise ValueError(f"{encoder} is no audio encoder")
    if language:
        stream.metadata["language"] = language
    context = stream.codec_context
    context.open()
    _write_video(out, pictures)
    size = context.frame_size or _BLOCK
    for index in range(12):
        block = av.AudioFrame(context.format.name, context.layout.name, size)
        for plane in block.planes:
            plane.update(bytes(plane.buffer_size))
        block.sample_rate, block.time_base = rate, Fraction(1, rate)
        block.pts = index * size
        out.mux(stream.encode(block))
    out.mux(stream.encode(None))


def holds_stream(container: str, stream: CopiedStream) -> bool:
    """Whether a container holds the packets of a stream.

    Args:
        container: FFmpeg's name of the muxer.
        stream: of an open source.
    """
    if stream.type == "attachment":
        return container == "matroska"  # a file without other streams cannot be read
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

    def write(out: av.container.OutputContainer) -> None:
        pictures = _add_needed_video(out)
        copy = copy_of(out, stream.stream)
        _write_video(out, pictures)
        for index in range(8):
            packet = av.Packet(bytes(64))
            packet.pts = packet.dts = index
            packet.time_base, packet.stream = Fraction(1, 25), copy
            out.mux(packet)

    return _kind(stream.stream) in _trial(container, write, _kind)


def copy_of(container: av.container.OutputContainer, template: Stream) -> Stream:
    """Add a stream for another's packets, with its tags and dispositions.

    Raises:
        ValueError: the container does not hold it.
    """
    stream = container.add_stream_from_template(template, opaque=True)
    stream.metadata.update(template.metadata)
    stream.disposition = template.disposition
    return stream


def _encoder_of(stream: CopiedStream) -> str:
    """An encoder of a copied stream's codec, for a trial; empty without one."""
    if stream.type not in ("audio", "video"):
        return ""
    try:
        codec = av.Codec(stream.codec, "r").canonical_name
        return "" if codec in _SPECIAL else av.Codec(codec, "w").name
    except ValueError:
        return ""


def _takes_header(container: str, template: Stream) -> bool:
    # The MP4 family writes a stream's description at the end, unless the file is fragmented; that
    # of AC-3 needs the first packet.
    context = template.codec_context
    late = context is not None and context.name in ("ac3", "eac3")
    early = container in MP4_FAMILY and not late and not is_cover(template)
    options = {"movflags": "empty_moov"} if early else {}
    # a muxer of many files (HLS) makes none before its header
    no_file = av.ContainerFormat(container, "w").no_file
    file = "nowhere" if no_file else io.BytesIO()
    try:
        with av.open(file, "w", format=container, container_options=options) as trial:
            _add_needed_video(trial)
            copy_of(trial, template)
            if not no_file:
                trial.start_encoding()
    except (av.FFmpegError, ValueError, OSError):
        return False
    return True


def _is_found_again(
    container: str, encoder: str, write: Callable[[av.container.OutputContainer], None],
    pixel_format: str = "",
) -> bool:  # fmt: skip
    """Whether the codec of a trial, for raw video with its format, can be read from it."""
    if av.ContainerFormat(container, "w").no_file:
        with av.open("nowhere", "w", format=container) as out:
            return encoder in out.supported_codecs
    return _named(av.Codec(encoder, "w"), pixel_format) in _trial(container, write, _kind)


def _trial(
    container: str, write: Callable[[av.container.OutputContainer], None],
    look: Callable[[Stream], _Seen],
) -> set[_Seen]:  # fmt: skip
    """What is seen of the streams that FFmpeg finds in a trial; none where it fails."""
    file = io.BytesIO()
    try:
        with ordinary_priority(), av.open(file, "w", format=container) as out:
            write(out)
        file.seek(0)
        with av.open(file, "r") as found:
            return {look(stream) for stream in found.streams}
    except (av.FFmpegError, ValueError, OSError):
        return set()


def _kind(stream: Stream) -> tuple[str, str]:
    """Type and codec of a stream."""
    context = stream.codec_context
    if context is None:
        return stream.type, getattr(stream, "name", None) or ""
    return _named(context.codec, getattr(context, "pix_fmt", None) or "")


def _named(codec: av.Codec, pixel_format: str) -> tuple[str, str]:
    """Type and codec; the layers of MPEG audio are one, readers tell them by the packets.

    Raw video has its pixel format: some muxers give bytes a wrong name.
    """
    name = codec.canonical_name
    if name == "rawvideo":
        name += f" {pixel_format.replace('yuvj', 'yuv')}"
    return codec.type, "mpegaudio" if name in ("mp1", "mp2", "mp3") else name


def _add_video(out: av.container.OutputContainer, encoder: str, pixel_format: str) -> VideoStream:
    usual = encoder_options(encoder, pixel_format, None, interlaced=False)
    stream = out.add_stream(encoder, 25, dict(_OPTIONS.get(encoder, usual)))
    if not isinstance(stream, VideoStream):
        raise ValueError(f"{encoder} is no video encoder")
    stream.width, stream.height = _SIZES.get(encoder, _SIZE)
    stream.pix_fmt = pixel_format
    stream.time_base = stream.codec_context.time_base = Fraction(1, 25)
    return stream


def _add_needed_video(out: av.container.OutputContainer) -> VideoStream | None:
    """Pictures before the sound of a trial, where the container requires them."""
    if out.format.name not in _PICTURES_FIRST:
        return None
    return _add_video(out, out.default_video_codec, "yuv420p")


def _write_video(out: av.container.OutputContainer, stream: VideoStream | None) -> None:
    """Frames of noise: plain ones make streams too short to be recognised."""
    if stream is None:
        return
    for index in range(3):
        frame = av.VideoFrame(stream.width, stream.height, stream.pix_fmt or "yuv420p")
        for plane in frame.planes:
            plane.update(_noise(index, plane.buffer_size, frame.format))
        frame.pts, frame.time_base = index, Fraction(1, 25)
        out.mux(stream.encode(frame))
    out.mux(stream.encode(None))


def _noise(seed: int, size: int, pixels: av.VideoFormat) -> bytes:
    """Bytes of a plane, of codes that its bits allow: x264 ends the process on larger ones."""
    noise = np.frombuffer(bytearray(Random(seed).randbytes(size)), np.uint8)
    bits = max(component.bits for component in pixels.components)
    if 8 < bits < 16:
        noise[0 if pixels.is_big_endian else 1 :: 2] &= (1 << (bits - 8)) - 1
    return noise.tobytes()
