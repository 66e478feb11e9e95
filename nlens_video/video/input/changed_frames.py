"""Frames in another form than the first: converted where that can be done, else told."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np
from msgspec.structs import asdict, replace

from nlens_video.core.color import (
    FULL_RANGE,
    MATRICES,
    PRIMARIES,
    TRANSFERS,
    ColorTags,
    luma,
    primaries_from_bt709,
    transfer,
)
from nlens_video.core.errors import Note, NoteKind
from nlens_video.core.layers import Float64
from nlens_video.video.info import FrameTags, SourceInfo
from nlens_video.video.pixels.conversion import converted, recoded, resized, unpacked
from nlens_video.video.pixels.pixel_formats import working_format
from nlens_video.video.pixels.samples import frame_tags

_SHAPE_TOLERANCE = 0.01
"""Share by which the shown shape may differ: sizes and shapes of pixels are rounded [1]."""
_REMEDY = "cut the plate there, and composite the parts one by one"


class Conform:
    """Converts every frame to the size, pixel format, matrix and range of the first.

    Another shape of the picture, transfer function or primaries are told.

    Args:
        first: the source's first frame.
        info: the source.
        aspect: width of a pixel by its height as the decoder says, None where unknown [1].
    """

    def __init__(self, first: av.VideoFrame, info: SourceInfo, aspect: Fraction | None) -> None:
        self._size = (first.width, first.height)
        self._format = first.format.name
        self._tags = info.tags
        self._frame_tags = info.frame_tags
        self._aspect = aspect or info.sample_aspect_ratio or Fraction(1)
        self._changed = 0
        self._example = self._shape_note = self._colour_note = ""

    def __call__(
        self, frame: av.VideoFrame, index: int, aspect: Fraction | None
    ) -> av.VideoFrame:  # fmt: skip
        """The frame, or a converted copy.

        Args:
            frame: any; what it does not say of its colour is as in the first.
            index: its number.
            aspect: as of the class.
        """
        size, name = (frame.width, frame.height), frame.format.name
        self._compare_shape(size, aspect or self._aspect, index)
        same_form = (size, name) == (self._size, self._format)
        if same_form and FrameTags.of(frame) == self._frame_tags:
            return frame
        self._compare_colour(frame, index)
        made = frame if same_form else self._formed(frame)
        codes = self._codes(made)
        if not _same_codes(codes, self._tags):
            made = recoded(made, codes, self._tags)
        for tag, code in asdict(self._frame_tags).items():
            setattr(made, tag, code)
        if made is frame:
            return frame
        self._changed += 1
        if not self._example:
            was, becomes = _words(codes, self._tags)
            width, height = self._size
            self._example = (
                f"(from frame {index} on, {size[0]}x{size[1]} {name}{was}) and were converted to "
                f"{width}x{height} {self._format}{becomes}"
            )
        made.pts, made.time_base, made.duration = frame.pts, frame.time_base, frame.duration
        return made

    def _formed(self, frame: av.VideoFrame) -> av.VideoFrame:
        """The frame in the first one's size and format."""
        made, target = unpacked(frame), working_format(self._format)
        if (made.width, made.height) != self._size:
            made = resized(made, *self._size)
        if made.format.name != target:
            made = converted(made, target, frame_tags(made))
        return made

    def _codes(self, frame: av.VideoFrame) -> ColorTags:
        """Matrix and range of a frame in the first one's format."""
        if self._tags.matrix == "gbr":
            return self._tags
        told = frame.color_range  # H.264 that becomes limited stays yuvj, but says it
        return replace(
            self._tags,
            matrix=MATRICES.get(frame.colorspace or 2, self._tags.matrix),
            full_range=told == FULL_RANGE if told else self._tags.full_range,
        )

    def _compare_shape(self, size: tuple[int, int], aspect: Fraction, index: int) -> None:
        shown, first = (
            float(shape) * width / height
            for shape, (width, height) in ((aspect, size), (self._aspect, self._size))
        )
        if not self._shape_note and abs(shown / first - 1) > _SHAPE_TOLERANCE:
            self._shape_note = (
                f"from frame {index} on the picture is {shown:.3g} times as wide as high, before "
                f"{first:.3g} times: all frames are shown in the shape of the first; {_REMEDY}"
            )

    def _compare_colour(self, frame: av.VideoFrame, index: int) -> None:
        first, found = self._frame_tags, []
        for word, table, meaning, numbers in (
            ("transfer function", TRANSFERS, _mid_grey, (first.color_trc, frame.color_trc)),
            (
                "primaries", PRIMARIES, primaries_from_bt709,
                (first.color_primaries, frame.color_primaries),
            ),
        ):  # fmt: skip
            before, now = (table.get(number, "") for number in numbers)
            # some have several names
            if before and now and not np.array_equal(meaning(before), meaning(now)):
                found.append(f"{word} {now}, before {before}")
        if found and not self._colour_note:
            self._colour_note = (
                f"from frame {index} on the colour is another ({'; '.join(found)}): all frames are "
                f"taken for that of the first; {_REMEDY}"
            )

    def notes(self) -> tuple[str, ...]:
        """Notes on converted frames, and on what is not converted."""
        frames = "1 frame" if self._changed == 1 else f"{self._changed} frames"
        told = [f"{frames} had another form {self._example}"] if self._changed else []
        uncertain = (self._shape_note, self._colour_note)
        return (*told, *(Note(one, NoteKind.UNCERTAIN) for one in uncertain if one))


def _mid_grey(curve: str) -> Float64:
    """Light of the middle code, which tells the transfer functions apart."""
    return transfer(curve).to_linear(np.array(0.5))


def _same_codes(one: ColorTags, other: ColorTags) -> bool:
    """Whether the codes of two mean the same; some matrices have two names."""
    alike = np.array_equal(luma(one.matrix), luma(other.matrix))
    return alike and one.full_range == other.full_range


def _words(one: ColorTags, other: ColorTags) -> tuple[str, str]:
    """What is different in the matrix and range of two, for a note."""
    parts: list[tuple[str, str]] = []
    if one.matrix != other.matrix:
        parts.append((one.matrix, other.matrix))
    if one.full_range != other.full_range:
        ranges = ("limited range", "full range")
        parts.append((ranges[one.full_range], ranges[other.full_range]))
    first, second = (", ".join(words) for words in zip(*parts, strict=True)) if parts else ("", "")
    return (f" of {first}", f" of {second}") if parts else ("", "")


class LateFields:
    """Tells of interlaced frames in a source that begins with whole ones.

    Args:
        info: the source.
    """

    def __init__(self, info: SourceInfo) -> None:
        self._told = info.interlaced
        self._count = self._first = 0

    def see(self, frame: av.VideoFrame, index: int) -> None:
        """Count a frame."""
        if frame.interlaced_frame and not self._told:
            self._first = self._first if self._count else index
            self._count += 1

    def notes(self) -> tuple[str, ...]:
        """A note on interlaced frames."""
        if not self._count:
            return ()
        return (
            Note(
                f"{self._count} frames from frame {self._first} on are interlaced, the first is "
                "not: they are composited and encoded as whole frames; deinterlace the plate "
                "first, as by ffmpeg -i IN -vf bwdif OUT",
                NoteKind.UNCERTAIN,
            ),
        )
