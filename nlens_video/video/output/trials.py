"""Trials of containers: noise or silence written in memory and read back; files read back."""

from __future__ import annotations

import io
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import TypeVar

import av
import av.container
import numpy as np
from av.audio.stream import AudioStream
from av.stream import Stream
from av.video.stream import VideoStream

from nlens_video.video.info import FrameTags
from nlens_video.video.output.encoder_threads import ordinary_priority
from nlens_video.video.output.encoders import encoder_options
from nlens_video.video.stored_colour import set_colour

_PICTURES_FIRST = ("mxf", "gxf", "dv")
"""These hold sound only beside pictures."""
_SIZE = (352, 288)  # one that H.263 and DNxHR have, too [px]
_SIZES = {"dvvideo": (720, 576)}
_BLOCK = 1152
"""Samples of sound in a block of a trial, where the encoder does not say [1]."""
_OPTIONS = {
    "prores_ks": {"bits_per_mb": "8192"},  # as many as noise takes, else it searches long
    "libx264": {"preset": "ultrafast"},
    "libx265": {"preset": "ultrafast", "x265-params": "log-level=none"},
    "libvpx": {"auto-alt-ref": "0"},  # with which it refuses transparency
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8"},
}
"""Of an encoder in a trial, where those of results are slow or fail on it."""
UNOFFICIAL = {"yuv4mpegpipe": {"strict": "-1"}}
"""Options of muxers that write pictures of more than 8 bits in a form that all readers know, but
which is not in the container's own definition."""
_UNTAGGED = FrameTags()
_Seen = TypeVar("_Seen")


def trial(
    container: str, write: Callable[[av.container.OutputContainer], None],
    look: Callable[[Stream], _Seen],
) -> set[_Seen]:  # fmt: skip
    """What is seen of the streams that FFmpeg finds in a trial; none where it fails."""
    file = io.BytesIO()
    try:
        options = UNOFFICIAL.get(container, {})
        with (
            ordinary_priority(),
            av.open(file, "w", format=container, container_options=options) as out,
        ):
            write(out)
        file.seek(0)
        with av.open(file, "r") as found:
            return {look(stream) for stream in found.streams}
    except (av.FFmpegError, ValueError, OSError):
        return set()


def plays(path: Path) -> bool:
    """Whether a file, which need not be complete, begins with a picture that can be decoded."""
    try:
        with av.open(f"file:{path}", "r") as found:
            first = next(found.decode(video=0), None)
            return first is not None and not first.is_corrupt
    except (av.FFmpegError, IndexError, OSError):
        return False


def write_sound(out: av.container.OutputContainer, encoder: str, language: str = "") -> None:
    """Silence, beside pictures where the container requires them."""
    rates = av.Codec(encoder, "w").audio_rates or (48000,)
    rate = 48000 if 48000 in rates else rates[0]
    pictures = add_needed_video(out)
    stream = out.add_stream(encoder, rate, layout="mono" if "amr" in encoder else "stereo")
    if not isinstance(stream, AudioStream):
        raise ValueError(f"{encoder} is no audio encoder")
    if language:
        stream.metadata["language"] = language
    context = stream.codec_context
    context.open()
    write_video(out, pictures)
    size = context.frame_size or _BLOCK
    for index in range(12):
        block = av.AudioFrame(context.format.name, context.layout.name, size)
        for plane in block.planes:
            plane.update(bytes(plane.buffer_size))
        block.sample_rate, block.time_base = rate, Fraction(1, rate)
        block.pts = index * size
        out.mux(stream.encode(block))
    out.mux(stream.encode(None))


def add_video(out: av.container.OutputContainer, encoder: str, pixel_format: str) -> VideoStream:
    """Pictures of an encoder.

    Raises:
        ValueError: it is none of pictures, or the container refuses it.
    """
    usual = encoder_options(encoder, pixel_format, None, interlaced=False)
    stream = out.add_stream(encoder, 25, dict(_OPTIONS.get(encoder, usual)))
    if not isinstance(stream, VideoStream):
        raise ValueError(f"{encoder} is no video encoder")
    stream.width, stream.height = _SIZES.get(encoder, _SIZE)
    stream.pix_fmt = pixel_format
    stream.time_base = stream.codec_context.time_base = Fraction(1, 25)
    return stream


def add_needed_video(out: av.container.OutputContainer) -> VideoStream | None:
    """Pictures before the sound of a trial, where the container requires them."""
    if out.format.name not in _PICTURES_FIRST:
        return None
    return add_video(out, out.default_video_codec, "yuv420p")


def write_video(
    out: av.container.OutputContainer, stream: VideoStream | None, tags: FrameTags = _UNTAGGED
) -> None:
    """Frames of noise: plain ones make streams too short to be recognised."""
    if stream is None:
        return
    for index in range(3):
        frame = av.VideoFrame(stream.width, stream.height, stream.pix_fmt or "yuv420p")
        for plane in frame.planes:
            plane.update(_noise(index, plane.buffer_size, frame.format))
        set_colour(frame, tags)  # ProRes asks the frames
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
