"""What is known about a source, and the frames that it gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal, TypeAlias

import av
import av.container
from av.stream import Disposition, Stream

from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Picture

Packet: TypeAlias = "av.Packet[av.stream.Stream]"
Kind = Literal["video", "still", "sequence", "stream"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTags:
    """FFmpeg's own numbers for a stream's colour, passed on unchanged; 0 or 2: unspecified."""

    colorspace: int = 2
    color_range: int = 0
    color_primaries: int = 2
    color_trc: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class CopiedStream:
    """A stream that travels along undecoded.

    Attributes:
        index: in the source.
        type: `audio`, `subtitle`, `data`, `attachment`, or `video`: a further one or a cover.
        codec: FFmpeg's name, empty where FFmpeg knows none.
        stream: FFmpeg's own; not to be touched once the source is closed.
        cover: a cover's picture file, empty for all other streams.
    """

    index: int
    type: str
    codec: str
    stream: Stream = field(repr=False, compare=False)
    cover: bytes = field(default=b"", repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceInfo:
    """What is known about a source before its frames are read.

    Attributes:
        name: as the user gave it.
        kind: a `stream` can be read once and may never end.
        width: columns as displayed [px].
        height: rows as displayed [px].
        rotation: counter-clockwise turn from stored to displayed samples [deg].
        time_base: seconds per tick of a pts [s].
        average_rate: frames per second, None where the source does not say [1/s].
        steady: whether all frames are as far apart as the average rate has it.
        frame_count: estimate, None where the source does not say.
        duration_s: length, None where the source does not say [s].
        pixel_format: FFmpeg's name of the format the frames come in; `gbrpf32le` for OpenEXR.
        tags: what the samples mean, and which of that is assumed.
        frame_tags: FFmpeg's own numbers, for the output.
        sample_aspect_ratio: width of a stored pixel by its height, None where unknown [1].
        codec: FFmpeg's name of the codec; `exr` for OpenEXR.
        bit_rate: of the pictures, None where unknown [bit/s].
        interlaced: whether the first frame is two fields.
        hdr_metadata: whether the first frame says how it was mastered or how bright it gets.
        copied: the other streams, which travel along.
        metadata: of the container.
        stream_metadata: of the pictures, such as their language and timecode.
        disposition: of the pictures, FFmpeg's flags.
        chapters: of the container.
        notes: what was left out, and why.
    """

    name: str
    kind: Kind
    width: int
    height: int
    rotation: int = 0
    time_base: Fraction
    average_rate: Fraction | None
    steady: bool = True
    frame_count: int | None
    duration_s: float | None
    pixel_format: str
    tags: ColorTags
    frame_tags: FrameTags = field(default_factory=FrameTags)
    sample_aspect_ratio: Fraction | None = None
    codec: str
    bit_rate: int | None = None
    interlaced: bool = False
    hdr_metadata: bool = False
    copied: tuple[CopiedStream, ...] = ()
    metadata: dict[str, str] = field(default_factory=dict)
    stream_metadata: dict[str, str] = field(default_factory=dict)
    disposition: int = 1
    chapters: tuple[av.container.Chapter, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def stored_size(self) -> tuple[int, int]:
        """Width and height of the stored samples, before they are turned upright [px]."""
        sideways = self.rotation % 180 != 0
        return (self.height, self.width) if sideways else (self.width, self.height)

    @property
    def pixel_aspect(self) -> float:
        """Width of a displayed pixel by its height [1]."""
        ratio = float(self.sample_aspect_ratio or 1)
        return 1.0 / ratio if self.rotation % 180 else ratio


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SourceFrame:
    """One frame of a source.

    Attributes:
        index: position in the source, from 0.
        pts: presentation time [ticks of `time_base`].
        time_base: seconds per tick [s].
        time_s: moment of the animation: seconds since the first frame [s].
        duration: of the frame, 0 where the source does not say [ticks].
        picture: its samples, composited in place.
        lost: pictures before it that were damaged beyond reading, as far as times tell [1].
    """

    index: int
    pts: int
    time_base: Fraction
    time_s: float
    duration: int
    picture: Picture
    lost: int = 0

    @property
    def number(self) -> int:
        """Position in the source with the lost ones counted: by it files belong to frames."""
        return self.index + self.lost


def is_cover(stream: Stream) -> bool:
    """Whether a stream is a picture that stands for the file."""
    return bool(stream.disposition & Disposition.attached_pic)
