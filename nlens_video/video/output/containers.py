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

import av
import av.container
from av.bitstream import BitStreamFilterContext
from av.stream import Stream
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from nlens_video.video.info import CopiedStream, FrameTags, is_cover
from nlens_video.video.output.encoders import some_format
from nlens_video.video.output.recent_codecs import canonical, is_recent
from nlens_video.video.output.trials import (
    add_needed_video,
    add_video,
    trial,
    write_sound,
    write_video,
)
from nlens_video.video.stored_colour import set_colour

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
_ALPHA_BESIDE = ("libvpx", "libvpx-vp9")
"""Encoders whose alpha is a second stream, which only Matroska can store."""
_USUAL = frozenset(product(("mp4", "mov", "matroska"), ("libx264", "libx265", "aac")))
"""Muxers that hold what encoders make, known without a trial, which takes 30 ms of a start."""
_DESCRIBED = ("mp4", "mov", "matroska", "webm", "nut")
"""Muxers that hold title and chapters, known without a trial."""
_CHAPTER: av.container.Chapter = {
    "id": 0, "start": 0, "end": 40, "time_base": Fraction(1, 1000), "metadata": {},
}  # fmt: skip
_TELLING = ("libx264", "libx264rgb", "libx265")
"""Encoders whose pictures say their colour themselves, known without a trial."""
_KNOWN_BY_PACKETS = {("mpegts", "dts")}  # the empty packets of a trial are not recognised
_SPECIAL = ("vorbis", "dts", "truehd")  # FFmpeg's encoders of these are experimental


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
        write_video(out, add_video(out, encoder, pixel_format))

    return _is_found_again(container, encoder, write, pixel_format)


@cache
def holds_aspect(container: str, encoder: str, pixel_format: str) -> bool:
    """Whether FFmpeg reads the shape of pixels that are not square from pictures of an encoder.

    Arguments as `holds_video`.
    """
    ratio = Fraction(16, 11)

    def write(out: av.container.OutputContainer) -> None:
        stream = add_video(out, encoder, pixel_format)
        stream.codec_context.sample_aspect_ratio = ratio
        write_video(out, stream)

    if av.ContainerFormat(container, "w").no_file:
        return True  # nothing tells
    return ratio in trial(container, write, lambda one: getattr(one, "sample_aspect_ratio", None))


@cache
def read_tags(container: str, encoder: str, pixel_format: str, tags: FrameTags) -> FrameTags:
    """The colour tags of pictures of an encoder that FFmpeg reads where `tags` are written.

    Other arguments as `holds_video`.
    """

    def write(out: av.container.OutputContainer) -> None:
        stream = add_video(out, encoder, pixel_format)
        set_colour(stream.codec_context, tags)
        write_video(out, stream, tags)

    def look(stream: Stream) -> FrameTags:
        found = stream.container
        assert isinstance(found, av.container.InputContainer) and isinstance(stream, VideoStream)
        return next(map(FrameTags.of, found.decode(stream)), FrameTags())

    if encoder in _TELLING or av.ContainerFormat(container, "w").no_file:
        return tags
    if (container, encoder) == ("nut", "rawvideo"):
        return FrameTags()
    return next(iter(trial(container, write, look)), FrameTags())


@cache
def holds_audio(container: str, encoder: str) -> bool:
    """Whether a container holds sound of an encoder.

    Args:
        container: FFmpeg's name of the muxer.
        encoder: FFmpeg's name of it.
    """
    if (container, encoder) in _USUAL:
        return True
    return _is_found_again(container, encoder, partial(write_sound, encoder=encoder))


def read_language(container: str, encoder: str, language: str) -> str:
    """The language that FFmpeg reads of sound that was written with one; empty for none.

    Args:
        container: FFmpeg's name of the muxer.
        encoder: one that it holds.
        language: as the sound's tag has it.
    """
    write = partial(write_sound, encoder=encoder, language=language)
    return max(trial(container, write, lambda one: one.metadata.get("language", "")), default="")


@cache
def holds_title_and_chapters(container: str) -> tuple[bool, bool]:
    """Whether FFmpeg reads a file's title, and its chapters, again; yes where no trial tells.

    Args:
        container: FFmpeg's name of the muxer.
    """
    if container in _DESCRIBED or av.ContainerFormat(container, "w").no_file:
        return True, True

    def write(out: av.container.OutputContainer) -> None:
        encoder = out.default_video_codec
        pictures = add_video(out, encoder, some_format(encoder))
        out.metadata["title"] = "title"
        out.set_chapters([_CHAPTER])
        write_video(out, pictures)

    def look(stream: Stream) -> tuple[bool, bool]:
        whole = stream.container
        return whole.metadata.get("title") == "title", bool(whole.chapters())

    return max(trial(container, write, look), default=(True, True))


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
        pictures = add_needed_video(out)
        copy = copy_of(out, stream.stream)
        write_video(out, pictures)
        for index in range(8):
            packet = av.Packet(bytes(64))
            packet.pts = packet.dts = index
            packet.time_base, packet.stream = Fraction(1, 25), copy
            out.mux(packet)

    return _kind(stream.stream) in trial(container, write, _kind)


def copy_of(container: av.container.OutputContainer, template: Stream) -> Stream:
    """Add a stream for another's packets, with its tags and dispositions.

    Raises:
        ValueError: the container does not hold it.
    """
    stream = container.add_stream_from_template(template, opaque=True)
    stream.metadata.update(template.metadata)
    stream.disposition = template.disposition
    return stream


def start_codes(container: str, template: Stream, stream: Stream) -> BitStreamFilterContext | None:
    """A filter that gives packets of H.264 start codes, without which AVI refuses them.

    None where they are not needed, or are there.

    Args:
        container: FFmpeg's name of the muxer.
        template: of the source.
        stream: its copy by `copy_of`.
    """
    context = template.codec_context
    if container != "avi" or not isinstance(context, VideoCodecContext) or context.name != "h264":
        return None
    lengths = (context.extradata or b"").startswith(b"\1")  # the header of ISO media files
    return BitStreamFilterContext("h264_mp4toannexb", template, stream) if lengths else None


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
        with av.open(file, "w", format=container, container_options=options) as out:
            add_needed_video(out)
            copy_of(out, template)
            if not no_file:
                out.start_encoding()
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
    return _named(av.Codec(encoder, "w"), pixel_format) in trial(container, write, _kind)


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
