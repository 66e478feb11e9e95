"""What a source says of itself before its frames are read."""

from __future__ import annotations

from fractions import Fraction

import av
import av.container
import av.video.stream
from av.sidedata.sidedata import Type as SideDataType
from av.stream import Stream

from nlens_video.video.info import CopiedStream, FrameTags, Kind, SourceInfo
from nlens_video.video.picture import AvPicture
from nlens_video.video.samples import frame_tags

_SRGB_TRC = 13
_HDR_METADATA = (
    SideDataType.MASTERING_DISPLAY_METADATA, SideDataType.CONTENT_LIGHT_LEVEL,
    SideDataType.DYNAMIC_HDR_PLUS, SideDataType.DOVI_METADATA,
)  # fmt: skip


def described(
    spec: str, kind: Kind, container: av.container.InputContainer,
    stream: av.video.stream.VideoStream, first: av.VideoFrame, copied: tuple[Stream, ...],
    transfer: str | None = None,
) -> SourceInfo:  # fmt: skip
    """What is known of a source.

    Args:
        spec: as the user named it.
        kind: of source.
        container: it.
        stream: the one to work on.
        first: its first frame.
        copied: the streams that travel along.
        transfer: name of the transfer function to take instead of what the frame says.

    Raises:
        InputError: the pixel format is one that nothing is known about.
    """
    picture = kind in ("still", "sequence")
    jpeg = picture and first.format.name.startswith("yuv")
    rotation = first.rotation if first.rotation % 90 == 0 and abs(first.rotation) < 360 else 0
    worked = AvPicture(first, rotation=rotation)
    tags = frame_tags(worked.frame, assumed=_SRGB_TRC if jpeg else 0, given=transfer)
    rate = stream.average_rate or stream.guessed_rate or stream.base_rate
    duration = _duration(stream, container)
    count = stream.frames or (round(duration * rate) if duration and rate else None)
    return SourceInfo(
        name=spec, kind=kind, width=worked.width, height=worked.height,
        rotation=rotation, time_base=stream.time_base or Fraction(1, 1000),
        average_rate=rate or None, frame_count=1 if kind == "still" else count,
        duration_s=duration, pixel_format=first.format.name, tags=tags,
        frame_tags=FrameTags(
            colorspace=first.colorspace, color_range=first.color_range,
            color_primaries=first.color_primaries, color_trc=first.color_trc,
        ),
        sample_aspect_ratio=stream.sample_aspect_ratio or None,
        codec=stream.codec.name, bit_rate=stream.bit_rate or None,
        interlaced=first.interlaced_frame,
        hdr_metadata=_tells_hdr(first),
        copied=tuple(map(_described, copied)),
        metadata=dict(container.metadata), chapters=tuple(container.chapters()),
        notes=_left_out(container, stream, copied),
    )  # fmt: skip


def copied_streams(container: av.container.InputContainer) -> tuple[Stream, ...]:
    """The audio, subtitle and data streams, which travel along."""
    return tuple(one for one in container.streams if one.type in ("audio", "subtitle", "data"))


def _tells_hdr(frame: av.VideoFrame) -> bool:
    """Whether a frame says how it was mastered or how bright it gets."""
    try:
        return any(one in frame.side_data for one in _HDR_METADATA)
    except ValueError:
        return False  # PyAV has no name for something else that lies beside it, such as EXIF


def _described(stream: Stream) -> CopiedStream:
    context = stream.codec_context
    name = "" if context is None else context.name
    return CopiedStream(index=stream.index, type=stream.type, codec=name, stream=stream)


def _left_out(
    container: av.container.InputContainer, video: av.video.stream.VideoStream,
    copied: tuple[Stream, ...],
) -> tuple[str, ...]:  # fmt: skip
    return tuple(
        f"stream {one.index} ({one.type}) is not carried over: only one video stream is rendered"
        for one in container.streams
        if one is not video and one not in copied
    )


def _duration(
    stream: av.video.stream.VideoStream, container: av.container.InputContainer
) -> float | None:
    """Length [s], None where it is unknown."""
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    return container.duration / av.time_base if container.duration else None
