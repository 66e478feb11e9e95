"""Properties of an open source, from its headers and its first frame."""

from __future__ import annotations

import re
from fractions import Fraction

import av
import av.container
import av.video.stream
from av.stream import Discard, Stream

from nlens_video.core.errors import Note, NoteKind
from nlens_video.video.hdr_metadata import hdr_metadata
from nlens_video.video.info import CopiedStream, FrameTags, Kind, SourceInfo, is_cover
from nlens_video.video.input.camera_tags import camera_tags
from nlens_video.video.input.chroma_siting import chroma_siting
from nlens_video.video.input.lossless import is_lossless
from nlens_video.video.input.open import InputHints, videos
from nlens_video.video.input.packet_index import start_before_zero, stated_frames
from nlens_video.video.pixels.orientation import frame_slant
from nlens_video.video.pixels.picture import AvPicture
from nlens_video.video.pixels.samples import frame_tags
from nlens_video.video.pixels.side_data import side_data
from nlens_video.video.stills.stated_colour import take_stated_colour

_SRGB_TRC = 13
_BT601 = 5
"""FFmpeg's number of the matrix."""
_FIELD_ORDERS = {2: "tt", 3: "bb", 4: "tb", 5: "bt"}
"""Names of FFmpeg's field orders; others are progressive or unknown."""
_RATE_TOLERANCE = Fraction(1, 1000)
_CLOCK = re.compile(r"(\d+):(\d\d):(\d\d\.?\d*)")
_NO_TIME_STAMPS = 0x0080
"""FFmpeg's flag of formats without time stamps: elementary streams."""
_TS_DISCONT = 0x0200
"""FFmpeg's flag of formats whose clock may leap: MPEG-TS, MPEG program streams, HLS, Ogg."""


def describe(
    spec: str, kind: Kind, container: av.container.InputContainer,
    stream: av.video.stream.VideoStream, first: av.VideoFrame, copied: tuple[Stream, ...],
    hints: InputHints, covers: dict[int, bytes],
) -> SourceInfo:  # fmt: skip
    """Properties of a source.

    Args:
        spec: as the user named it.
        kind: of the source.
        container: of the source.
        stream: the one that is composited on.
        first: its first frame.
        copied: the streams that are carried over.
        hints: the user's options.
        covers: picture files of the covers (attached pictures), by the index of their stream.

    Raises:
        InputError: the pixel format is not supported.
    """
    picture = kind in ("still", "sequence")
    yuv = picture and first.format.name.startswith("yuv")
    if yuv and stream.codec.name == "tiff" and first.colorspace in (0, 2):
        first.colorspace = _BT601  # by the TIFF specification, whatever the size
    profile, not_followed = take_stated_colour(spec, kind, stream.codec.name, first, hints.transfer)
    worked = AvPicture(first)
    tags = frame_tags(worked.frame, assumed=_SRGB_TRC if yuv else 0, given=hints.transfer)
    untimed = bool(container.format.flags & _NO_TIME_STAMPS)
    rate = _rate(stream, states_average=not untimed or hints.rate is not None)
    if first.pts is None and kind == "video" and not untimed:
        first.pts = start_before_zero(spec, hints, rate or Fraction(25))
    duration = _duration(stream, container)
    order = _FIELD_ORDERS.get(stream.codec_context.field_order, "")
    length = _own_length(stream) or duration
    count = stated_frames(container, stream) or (round(length * rate) if length and rate else None)
    return SourceInfo(
        name=spec, kind=kind, width=worked.width, height=worked.height,
        orientation=worked.orientation, time_base=stream.time_base or Fraction(1, 1000),
        average_rate=rate,
        steady=(untimed and first.pts is None) or _is_steady(stream, rate),
        frame_count=1 if kind == "still" else count,
        duration_s=duration, start_s=(first.pts or 0) * Fraction(first.time_base or 0),
        clocked=kind == "stream" or bool(container.format.flags & _TS_DISCONT),
        pixel_format=first.format.name, tags=tags,
        frame_tags=FrameTags(
            colorspace=first.colorspace, color_range=first.color_range,
            color_primaries=first.color_primaries, color_trc=first.color_trc,
        ),
        icc_profile=profile,
        sample_aspect_ratio=stream.sample_aspect_ratio or None,
        codec=stream.codec.name, bit_rate=stream.bit_rate or None,
        interlaced=first.interlaced_frame or bool(order), field_order=order,
        lossless=is_lossless(stream.codec.name, stream.codec_context.extradata or b""),
        hdr=hdr_metadata(side_data(first)), chroma_siting=chroma_siting(stream),
        copied=tuple(_copied(one, covers) for one in copied),
        metadata=dict(container.metadata), chapters=tuple(container.chapters()),
        stream_metadata=dict(stream.metadata), disposition=int(stream.disposition),
        camera_tags=camera_tags(spec, container, stream, first),
        notes=(
            *_chosen(container, stream), *_left_out(container, stream, copied),
            *_untagged(stream, first, hints.transfer), *_slanted(first), *not_followed,
        ),
    )  # fmt: skip


def copied_streams(
    container: av.container.InputContainer, video: av.video.stream.VideoStream, kind: Kind
) -> tuple[Stream, ...]:
    """The other streams, which are carried over.

    Timecode and chapters are written anew. Of a live stream, which may come in several sizes, only
    one video is taken.
    """
    if kind == "still":
        return ()
    return tuple(
        one for one in container.streams
        if one is not video and one.type != "unknown" and not _is_written_anew(container, one)
        and (one.type != "video" or is_cover(one) or kind == "video")
    )  # fmt: skip


def _is_written_anew(container: av.container.InputContainer, stream: Stream) -> bool:
    if stream.type != "data":
        return False
    chapters = stream.discard == Discard.all and bool(container.chapters())
    return chapters or "timecode" in stream.metadata


def _rate(stream: av.video.stream.VideoStream, *, states_average: bool) -> Fraction | None:
    """Frames per second, None where unknown [1/s].

    Args:
        stream: of the source.
        states_average: whether the average is stated, or a default as of elementary streams.
    """
    average = stream.average_rate if states_average else None
    return average or stream.guessed_rate or stream.base_rate or None


def _is_steady(stream: av.video.stream.VideoStream, rate: Fraction | None) -> bool:
    """Whether the frame rate is constant, within the rounding of times to milliseconds."""
    base = stream.base_rate
    if not rate or not base:
        return False
    return abs(rate / base - 1) < _RATE_TOLERANCE


def _copied(stream: Stream, covers: dict[int, bytes]) -> CopiedStream:
    context = stream.codec_context
    return CopiedStream(
        index=stream.index, type=stream.type, codec="" if context is None else context.name,
        stream=stream, cover=covers.get(stream.index, b""),
        start_s=_start(stream) if stream.type == "audio" else None,
    )  # fmt: skip


def _start(stream: Stream) -> Fraction | None:
    """Time of a stream's first packet by the header [s], None where it is unknown."""
    if stream.start_time is None or stream.time_base is None:
        return None
    return stream.start_time * Fraction(stream.time_base)


def _untagged(
    stream: av.video.stream.VideoStream, first: av.VideoFrame, transfer: str | None
) -> tuple[str, ...]:
    """A note on raw samples that may be of HDR, of which nothing says so."""
    deep = max(component.bits for component in first.format.components) > 8
    told = transfer is not None or first.color_trc not in (0, 2) or first.color_primaries != 2
    if stream.codec.name != "rawvideo" or told or not deep or first.format.is_rgb:
        return ()
    return (
        Note(
            "the plate carries no colour tags: taken for BT.709; where it is HDR, pipe it as FFV1 "
            "in Matroska, which carries them, or give --input-transfer",
            NoteKind.UNCERTAIN,
        ),
    )


def _chosen(
    container: av.container.InputContainer, stream: av.video.stream.VideoStream
) -> tuple[str, ...]:
    """A note on which of several videos is composited on."""
    count = len(videos(container))
    if count < 2:
        return ()
    size = f"{stream.codec_context.width}x{stream.codec_context.height}"
    return (
        Note(
            f"stream {stream.index} ({size}) is the plate, as the default or largest of {count} "
            "videos; ffmpeg -i IN -map 0:NUMBER -c copy FILE gives another one alone",
            NoteKind.INFORMATION,
        ),
    )


def _slanted(first: av.VideoFrame) -> tuple[str, ...]:
    """A note on a display matrix that is not followed."""
    angle = frame_slant(first)
    if not angle:
        return ()
    return (
        Note(
            f"the plate is displayed turned by {angle:.3g} degrees, which is no multiple of 90: it "
            "is composited as it is stored, and so is the result; ffmpeg -i IN OUT turns it",
            NoteKind.UNCERTAIN,
        ),
    )


def _left_out(
    container: av.container.InputContainer, video: av.video.stream.VideoStream,
    copied: tuple[Stream, ...],
) -> tuple[str, ...]:  # fmt: skip
    return tuple(
        Note(
            f"stream {one.index} ({one.type}) is not carried over: of a stream one video is taken"
            if one.type == "video"
            else f"stream {one.index} is not carried over: FFmpeg does not know what it is",
            NoteKind.STREAM_LEFT_OUT,
        )
        for one in container.streams
        if one is not video and one not in copied and one.type in ("video", "unknown")
    )


def _duration(
    stream: av.video.stream.VideoStream, container: av.container.InputContainer
) -> float | None:
    """Length [s], None where it is unknown; in Matroska that of the longest stream."""
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    return container.duration / av.time_base if container.duration else None


def _own_length(stream: av.video.stream.VideoStream) -> float | None:
    """Length of the video alone by its tag in Matroska [s], None without one."""
    told = _CLOCK.fullmatch(stream.metadata.get("DURATION", ""))
    return None if told is None else 3600 * int(told[1]) + 60 * int(told[2]) + float(told[3])
