"""Frames in other pixel formats, sizes and codes."""

from __future__ import annotations

import av
import numpy as np
import numpy.typing as npt
from av.video.reformatter import Interpolation
from msgspec.structs import replace

from nlens_video.core.color import FULL_RANGE, MATRICES, ColorTags
from nlens_video.video.pixels.pixel_formats import (
    PixelLayout,
    layout,
    working_format,
    working_layout,
)
from nlens_video.video.pixels.recoding import recode
from nlens_video.video.pixels.samples import Coding, frame_samples

_SWS = (
    Interpolation.BICUBIC
    | Interpolation.ACCURATE_RND
    | Interpolation.FULL_CHR_H_INT
    | Interpolation.FULL_CHR_H_INP
)
_QUICK = Interpolation.POINT
"""For frames whose samples are then written anew: only FFmpeg's copies have the side data."""

_BT601 = 5
"""Number of the matrix that libswscale converts into; as a target it does not know 6."""
_BT2020_NC = 9
_BT2020_PRIMARIES = 9


def unpacked(frame: av.VideoFrame) -> av.VideoFrame:
    """The frame in its working format, rows from the top; the same frame where it is so.

    Raises:
        InputError: its format is not supported.
    """
    target = working_format(frame.format.name)
    if target != frame.format.name:
        return converted(frame, target)
    return _from_the_top(frame) if any(one.line_size < 0 for one in frame.planes) else frame


def _from_the_top(frame: av.VideoFrame) -> av.VideoFrame:
    """A copy of a frame whose rows lie in memory from the bottom up, as FFmpeg's of PFM files."""
    made = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for mine, theirs in zip(made.planes, frame.planes, strict=True):
        rows, own = (
            np.frombuffer(memoryview(one), np.uint8).reshape(one.height, abs(one.line_size))
            for one in (theirs, mine)
        )
        width = min(rows.shape[1], own.shape[1])
        own[:, :width] = rows[::-1, :width]
    take_tags(made, frame)
    made.duration = frame.duration
    return made


def resized(frame: av.VideoFrame, width: int, height: int) -> av.VideoFrame:
    """The frame in another size, its format and tags kept."""
    matrix = frame.colorspace if frame.colorspace not in (0, 2) else 1
    span = frame.color_range or 1
    result = frame.reformat(
        width=width, height=height, src_colorspace=matrix, dst_colorspace=matrix,
        src_color_range=span, dst_color_range=span, interpolation=_SWS,
    )  # fmt: skip
    copy_colour_tags(result, frame)
    return result


def recoded(frame: av.VideoFrame, was: ColorTags, becomes: ColorTags) -> av.VideoFrame:
    """The frame, of YUV, in the codes of another matrix and range; its tags are to be set."""
    matrices = {name: number for number, name in MATRICES.items()} | {"smpte170m": _BT601}
    name, full = frame.format.name, FULL_RANGE
    plain = name.replace("yuvj", "yuv")
    if plain != name:  # libswscale takes yuvj for full range, whatever it is told
        frame = frame.reformat(format=plain, src_color_range=full, dst_color_range=full)
    made = frame.reformat(
        format=name, src_colorspace=matrices[was.matrix], dst_colorspace=matrices[becomes.matrix],
        src_color_range=full if was.full_range else 1,
        dst_color_range=full if becomes.full_range else 1, interpolation=_QUICK,
    )  # fmt: skip
    recode(frame_samples(frame, was), frame_samples(made, becomes))
    return made


def copy_colour_tags(made: av.VideoFrame, frame: av.VideoFrame) -> None:
    """Copy the colour tags of a frame to one that was made from it."""
    for name in ("colorspace", "color_range", "color_primaries", "color_trc"):
        setattr(made, name, getattr(frame, name))


def take_tags(made: av.VideoFrame, frame: av.VideoFrame) -> None:
    """Copy the time and the colour tags of a frame to one that was made from it."""
    made.pts = frame.pts
    if frame.time_base is not None:  # frames that no decoder has made have none
        made.time_base = frame.time_base
    copy_colour_tags(made, frame)


def copied(frame: av.VideoFrame) -> av.VideoFrame:
    """A frame with samples of its own."""
    copy = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for mine, theirs in zip(copy.planes, frame.planes, strict=True):
        rows, own = _rows(theirs), _rows(mine)
        height, width = np.minimum(rows.shape, own.shape)
        own[:height, :width] = rows[:height, :width]
    take_tags(copy, frame)
    return copy


def _rows(plane: av.video.plane.VideoPlane) -> npt.NDArray[np.uint8]:
    """The bytes of a plane by rows, padding included; a palette, which has no rows, as one."""
    flat = np.frombuffer(memoryview(plane), np.uint8)
    return flat.reshape(-1, plane.line_size or plane.buffer_size)


def converted(
    frame: av.VideoFrame, target: str, tags: ColorTags | None = None, *, limited: bool = False,
    bt601: bool = False, chroma_siting: str = "",
) -> av.VideoFrame:  # fmt: skip
    """The frame in another pixel format, at its own time.

    Between two YUV or two RGB formats matrix and range stay, but with `limited` YUV becomes
    limited. YUV to RGB uses `tags`; RGB or grey to YUV uses the matrix of its primaries
    (`matrix_of_primaries`), or with `bt601` that, in limited range, or for `yuvj` BT.601 in full
    range as in JPEG, and tags the result so.

    Args:
        frame: any.
        target: FFmpeg's name of a pixel format.
        tags: colour tags of the frame; needed from YUV to RGB.
        limited: whether YUV of full range is to become limited; for YUV alone.
        bt601: whether RGB or grey is to become YUV of BT.601.
        chroma_siting: of the frame, as of `frame_samples`.
    """
    was, becomes = av.VideoFormat(frame.format.name).is_rgb, av.VideoFormat(target).is_rgb
    matrix = frame.colorspace if frame.colorspace not in (0, 2) else 1
    span = frame.color_range or 1
    if tags is not None and not was and tags.matrix != "gbr":
        matrix = next(number for number, name in MATRICES.items() if name == tags.matrix)
        span = FULL_RANGE if tags.full_range else 1
    to_yuv = (was or _is_grey(frame.format.name)) and not becomes and not _is_grey(target)
    jpeg = target.startswith("yuvj")
    own_matrix = _BT601 if jpeg or bt601 else matrix_of_primaries(frame.color_primaries)
    made = own_matrix if to_yuv else matrix
    made_span = FULL_RANGE if jpeg else 1 if to_yuv or limited else span
    result = _exact(frame, target, (matrix, span), (made, made_span), chroma_siting)
    if result is None:
        result = _reformatted(frame, target, (matrix, span), (made, made_span))
    result.color_primaries, result.color_trc = frame.color_primaries, frame.color_trc
    result.colorspace = made if to_yuv else 0 if becomes else frame.colorspace
    if to_yuv or becomes:
        result.color_range = FULL_RANGE if becomes or jpeg else 1
    else:
        result.color_range = 1 if limited else FULL_RANGE if jpeg else frame.color_range
    result.pts, result.duration = frame.pts, frame.duration
    if frame.time_base is not None:
        result.time_base = frame.time_base
    return result


def matrix_of_primaries(primaries: int) -> int:
    """Number of the matrix of YUV that is made of RGB: BT.2020 for its primaries, else BT.709.

    Args:
        primaries: FFmpeg's number of the primaries.
    """
    return _BT2020_NC if primaries == _BT2020_PRIMARIES else 1


def _is_grey(name: str) -> bool:
    return name.startswith(("gray", "ya"))


def _exact(
    frame: av.VideoFrame, target: str, was: tuple[int, int], becomes: tuple[int, int],
    chroma_siting: str,
) -> av.VideoFrame | None:  # fmt: skip
    """The frame in another pixel format, matrix and range; None where FFmpeg converts it well."""
    kind, goal = layout(frame.format.name), working_layout(target)
    if kind is None or goal is None:
        return None
    own, other = _coding(kind, *was), _coding(goal, *becomes)
    if _unbiased(own, other):
        return None
    name = working_format(target)
    made = _reformatted(frame, name, was, becomes, _QUICK)
    source = frame_samples(frame, own.tags, chroma_siting=chroma_siting)
    if own.family == "yuv" and other.family == "gray":
        source = replace(source, coding=replace(own, family="gray"))
    keeps = (kind.step_x, kind.step_y) == (goal.step_x, goal.step_y)
    siting = chroma_siting if keeps else "center" if goal.full_range else ""
    recode(source, frame_samples(made, other.tags, chroma_siting=siting))
    return made if name == target else _reformatted(made, target, becomes, becomes)


def _reformatted(
    frame: av.VideoFrame, target: str, was: tuple[int, int], becomes: tuple[int, int],
    method: Interpolation = _SWS,
) -> av.VideoFrame:  # fmt: skip
    """FFmpeg's conversion to another pixel format, matrix and range."""
    return frame.reformat(
        format=target, src_colorspace=was[0], dst_colorspace=becomes[0],
        src_color_range=was[1], dst_color_range=becomes[1], interpolation=method,
    )  # fmt: skip


def _coding(kind: PixelLayout, matrix: int, span: int) -> Coding:
    """Meaning of the codes of a format: matrix and range count for YUV."""
    yuv, grey = kind.family == "yuv", len(kind.components) - kind.alpha == 1
    tags = ColorTags(
        matrix=MATRICES.get(matrix, "bt709") if yuv else "gbr", transfer="bt709",
        primaries="bt709", full_range=not yuv or kind.full_range or span == FULL_RANGE,
    )  # fmt: skip
    return Coding("yuv" if yuv else "gray" if grey else "rgb", tags, kind.bits)


def _unbiased(own: Coding, other: Coding) -> bool:
    """Whether libswscale converts codes without a mean error.

    It rounds depths down or up, keeps 4 * 255 for 1023, rounds chroma of full range down, moves
    chroma between ranges, and takes BT.601's weights for grey.
    """
    full = other.family == "yuv" and other.tags.full_range
    if own.family == "rgb" and (full or other.family == "gray"):
        return False
    if own.family == other.family == "yuv" and own.tags != other.tags:
        return False
    if own.bits == other.bits == 8:
        return True
    if own.family == "yuv":
        same = own.bits == other.bits and other.family == "yuv"
        return other.family != "rgb" and (same or not own.tags.full_range)
    return own.bits == other.bits != 0 and other.family == "rgb"
