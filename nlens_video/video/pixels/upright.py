"""Frames made upright, for what cannot say how its pictures are to be turned or mirrored."""

from __future__ import annotations

import re
from typing import Any

import av

from nlens_video.core.layers import Picture
from nlens_video.video.pixels.conversion import converted, take_tags
from nlens_video.video.pixels.orientation import Orientation
from nlens_video.video.pixels.picture import AvPicture, picture_frame
from nlens_video.video.pixels.pixel_formats import layout
from nlens_video.video.pixels.samples import plane_rows

_UNEQUAL = re.compile("422|411|440")
"""Subsampling along one axis more than along the other."""


def upright_frame(picture: Picture, pixel_format: str, *, limited: bool = False) -> av.VideoFrame:
    """The picture as an upright frame; the same frame where it is one in that format.

    Args:
        picture: any.
        pixel_format: FFmpeg's name of the frame's format.
        limited: as of `picture_frame`.
    """
    if not isinstance(picture, AvPicture) or picture.orientation.upright:
        return picture_frame(picture, pixel_format, limited=limited)
    frame = turned(picture.frame, picture.orientation)
    fits = frame.format.name == pixel_format and not limited
    return frame if fits else converted(frame, pixel_format, picture.tags, limited=limited)


def turned(frame: av.VideoFrame, orientation: Orientation) -> av.VideoFrame:
    """A copy as it is displayed, in 4:4:4 where its subsampling would not fit any more.

    Else its samples stay what they are, as by FFmpeg's own filter.

    Args:
        frame: in a working format.
        orientation: of the frame.

    Raises:
        ValueError: it is in another format.
    """
    if orientation.sideways and _UNEQUAL.search(frame.format.name):
        frame = converted(frame, _UNEQUAL.sub("444", frame.format.name))
    kind = layout(frame.format.name)
    if kind is None:
        raise ValueError(f"{frame.format.name} is not a working format")
    width, height = frame.width, frame.height
    size = (height, width) if orientation.sideways else (width, height)
    made = av.VideoFrame(*size, frame.format.name)
    for mine, theirs in zip(made.planes, frame.planes, strict=True):
        pixels: Any = plane_rows(theirs, kind).reshape(theirs.height, -1, kind.channels)
        rows = orientation.shown(pixels).reshape(mine.height, -1)
        plane_rows(mine, kind)[...] = rows
    take_tags(made, frame)
    made.duration = frame.duration
    return made
