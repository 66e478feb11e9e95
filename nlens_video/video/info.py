"""Properties of a source, and its frames."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Literal, TypeAlias

import av
import av.container
from av.stream import Disposition, Stream
from msgspec import Struct, field
from msgspec.structs import replace

from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Picture
from nlens_video.video.hdr_metadata import HdrMetadata
from nlens_video.video.pixels.orientation import UPRIGHT, Orientation

Packet: TypeAlias = "av.Packet[av.stream.Stream]"
Kind = Literal["video", "still", "sequence", "stream"]


class FrameTags(Struct, frozen=True, kw_only=True):
    """A stream's colour in FFmpeg's numbers, copied to the output; 0 or 2: unspecified."""

    colorspace: int = 2
    color_range: int = 0
    color_primaries: int = 2
    color_trc: int = 2

    @classmethod
    def of(cls, frame: av.VideoFrame) -> FrameTags:
        """Those of a frame."""
        return cls(
            colorspace=frame.colorspace, color_range=frame.color_range,
            color_primaries=frame.color_primaries, color_trc=frame.color_trc,
        )  # fmt: skip


class CopiedStream(Struct, frozen=True, kw_only=True):
    """A stream that is carried over to the result.

    Attributes:
        index: in the source.
        type: `audio`, `subtitle`, `data`, `attachment`, or `video`: a further one or a cover.
        codec: FFmpeg's name, empty where FFmpeg knows none.
        stream: FFmpeg's own; invalid once the source is closed.
        cover: picture file of a cover (attached picture), else empty.
        start_s: time of its first packet by the source's header; of sound alone, None where it is
            unknown [s].
        cut: whether it runs already where a part of the source begins, so that packets before the
            part are left out.
    """

    index: int
    type: str
    codec: str
    stream: Stream
    cover: bytes = b""
    start_s: Fraction | None = None
    cut: bool = False


class SourceInfo(Struct, frozen=True, kw_only=True):
    """Properties of a source, read before its frames.

    Attributes:
        name: as the user gave it.
        kind: a `stream` can be read only once and may be endless.
        width: columns as displayed [px].
        height: rows as displayed [px].
        orientation: the way from stored to displayed samples.
        time_base: seconds per tick of a pts [s].
        average_rate: frames per second, None where unknown [1/s].
        steady: whether the frame rate is constant.
        frame_time: gives the time of the frame of a number [s], or None where the file does not
            tell it; None for sources that are no files.
        frame_count: estimate, None where unknown [1].
        duration_s: length, None where unknown [s].
        start_s: time of the first frame [s].
        clocked: whether its times are those of a clock that runs on, as in broadcasts and streams.
        ends_s: end of a part of a source with subtitles, on its own clock; None where it is open
            or unknown [s].
        pixel_format: FFmpeg's name of the decoded format; `gbrpf32le` for OpenEXR.
        half: whether the samples of OpenEXR are half float.
        tags: colour tags, those that are assumed included.
        frame_tags: the same in FFmpeg's numbers, for the output.
        icc_profile: of the file of a picture, empty where it has none.
        sample_aspect_ratio: width of a stored pixel by its height, None where unknown [1].
        codec: FFmpeg's name of the codec; `exr` for OpenEXR.
        bit_rate: of the video stream, None where unknown [bit/s].
        interlaced: whether frames consist of two fields, by the header or the first frame.
        field_order: `tt` or `tb` where the header says that the top field is shown first, `bb` or
            `bt` where it says the bottom one (QuickTime tells fields that lie line by line apart);
            else empty.
        lossless: whether H.264 or HEVC says that it is coded without loss.
        hdr: HDR metadata of the first frame.
        chroma_siting: FFmpeg's name of where chroma lies, empty where unknown.
        copied: the other streams, which are carried over.
        metadata: of the container.
        stream_metadata: of the video stream, such as language and timecode.
        camera_tags: what it says of its camera: tags of the file, EXIF, tags of a QuickTime track.
        disposition: FFmpeg's flags of the video stream.
        chapters: of the container.
        notes: streams that are left out, and why.
    """

    name: str
    kind: Kind
    width: int
    height: int
    orientation: Orientation = UPRIGHT
    time_base: Fraction
    average_rate: Fraction | None
    steady: bool = True
    frame_time: Callable[[int], Fraction | None] | None = None
    frame_count: int | None
    duration_s: float | None
    start_s: Fraction = Fraction(0)
    clocked: bool = False
    ends_s: Fraction | None = None
    pixel_format: str
    half: bool = False
    tags: ColorTags
    frame_tags: FrameTags = FrameTags()
    icc_profile: bytes = b""
    sample_aspect_ratio: Fraction | None = None
    codec: str
    bit_rate: int | None = None
    interlaced: bool = False
    field_order: str = ""
    lossless: bool = False
    hdr: HdrMetadata = HdrMetadata()
    chroma_siting: str = ""
    copied: tuple[CopiedStream, ...] = ()
    metadata: dict[str, str] = field(default_factory=dict)
    stream_metadata: dict[str, str] = field(default_factory=dict)
    camera_tags: dict[str, str] = field(default_factory=dict)
    disposition: int = 1
    chapters: tuple[av.container.Chapter, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def stored_size(self) -> tuple[int, int]:
        """Width and height as stored, before they are turned upright [px]."""
        sideways = self.orientation.sideways
        return (self.height, self.width) if sideways else (self.width, self.height)

    @property
    def uneven_aspect(self) -> Fraction | None:
        """Width of a stored pixel by its height, None where it is square or unknown [1]."""
        ratio = self.sample_aspect_ratio
        return None if ratio == 1 else ratio

    @property
    def pixel_aspect(self) -> float:
        """Width of a displayed pixel by its height [1]."""
        ratio = float(self.sample_aspect_ratio or 1)
        return 1.0 / ratio if self.orientation.sideways else ratio


class SourceFrame(Struct, frozen=True, kw_only=True, eq=False):
    """One frame of a source; of a caller's own loop with index, time and picture alone.

    Attributes:
        index: position in the source, from 0.
        pts: presentation time [ticks of `time_base`].
        time_base: seconds per tick [s].
        time_s: time of the animation, since the first frame [s].
        duration: of the frame, 0 where unknown [ticks].
        picture: its samples, on which the object is composited in place.
        lost: undecodable pictures before it, estimated from the times [1].
    """

    index: int
    picture: Picture
    time_s: float = 0.0
    pts: int = 0
    time_base: Fraction = Fraction(1)
    duration: int = 0
    lost: int = 0

    @property
    def number(self) -> int:
        """Position in the source, lost pictures included; numbered files use it."""
        return self.index + self.lost


def is_cover(stream: Stream) -> bool:
    """Whether a stream is a cover (attached picture)."""
    return bool(stream.disposition & Disposition.attached_pic)


def upright(info: SourceInfo) -> SourceInfo:
    """Properties of a source whose frames are stored as they are displayed."""
    sideways, ratio = info.orientation.sideways, info.sample_aspect_ratio
    return replace(
        info,
        orientation=UPRIGHT,
        sample_aspect_ratio=1 / ratio if sideways and ratio else ratio,
        interlaced=info.interlaced and not sideways,
        field_order="",
        chroma_siting=info.chroma_siting if info.orientation.upright else "",
    )
