"""Linear light in floating point as sRGB codes, for which readers take other samples."""

from __future__ import annotations

import re

import av
from msgspec.structs import replace

from nlens_video.core.color import ColorTags, transfer
from nlens_video.core.layers import Picture
from nlens_video.video.pixels.picture import ArrayPicture, AvPicture, picture_frame
from nlens_video.video.pixels.pixel_formats import PixelLayout, layout, working_format
from nlens_video.video.pixels.samples import plane_rows

SRGB_TRC = 13
"""FFmpeg's number of sRGB's transfer function."""
_SRGB = "iec61966-2-1"
_FLOAT = re.compile(r"f(?:16|32)(?:le|be)$")


def is_float(pixel_format: str) -> bool:
    """Whether FFmpeg's format of that name holds floating-point numbers."""
    return _FLOAT.search(pixel_format) is not None


def is_light(pixel_format: str, tags: ColorTags) -> bool:
    """Whether samples are linear light in floating point.

    Args:
        pixel_format: FFmpeg's name.
        tags: of the samples.

    Raises:
        InputError: the format is not supported.
    """
    return is_float(working_format(pixel_format)) and tags.transfer == "linear"


def display_coded(picture: Picture, pixel_format: str) -> Picture:
    """A picture of light with sRGB codes, for a format without floats; else the picture itself.

    Primaries and alpha stay.

    Args:
        picture: any.
        pixel_format: FFmpeg's name of the format to store it in.
    """
    if not isinstance(picture, AvPicture) or is_float(pixel_format):
        return picture
    kind = layout(picture.frame.format.name)
    if kind is None or not is_light(picture.frame.format.name, picture.tags):
        return picture
    if len(kind.components) == 1:  # FFmpeg would take grey floats for limited range
        light = ArrayPicture(plane_rows(picture.frame.planes[0], kind), tags=picture.tags)
        frame = picture_frame(light, "gray16le")
    else:
        frame = _with_codes(picture.copy().frame, kind)
    return AvPicture(frame, replace(picture.tags, transfer=_SRGB), orientation=picture.orientation)


def _with_codes(frame: av.VideoFrame, kind: PixelLayout) -> av.VideoFrame:
    """A frame of light whose colours become codes, in place."""
    to_coded = transfer(_SRGB).to_coded
    colours = kind.components[:-1] if kind.alpha else kind.components
    for plane, place in colours:
        values = plane_rows(frame.planes[plane], kind)[:, place :: kind.channels]
        values[...] = to_coded(values)
    frame.color_trc = SRGB_TRC
    return frame
