"""A picture as the frame, the array or the light that a sink writes."""

from __future__ import annotations

from typing import Any

import av
import numpy as np

from nlens_video.core.color import ColorTags, transfer
from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.video.pixels.picture import ArrayPicture, AvPicture
from nlens_video.video.pixels.pixel_formats import converted, layout
from nlens_video.video.pixels.sample_tables import Plane

_SRGB_TRC = 13


def picture_frame(picture: Picture, pixel_format: str) -> av.VideoFrame:
    """The picture as a stored (not yet upright) frame; the very frame where the format fits."""
    if isinstance(picture, AvPicture):
        frame, tags = picture.frame, picture.tags
    elif isinstance(picture, ArrayPicture):
        keeps = any(part.is_alpha for part in av.VideoFormat(pixel_format).components)
        frame, tags = _array_frame(picture, alpha=keeps), None
    else:
        raise TypeError(f"{type(picture).__name__} is no picture that a sink knows")
    return frame if frame.format.name == pixel_format else converted(frame, pixel_format, tags)


def upright_frame(frame: av.VideoFrame, rotation: int) -> av.VideoFrame:
    """A copy turned counter-clockwise by a multiple of 90 [deg], for files that cannot say so.

    Args:
        frame: in a format whose components all have the picture's size.
        rotation: multiple of 90 [deg].
    """
    array = frame.to_ndarray()
    planar = layout(frame.format.name)
    axes = (1, 2) if array.ndim == 3 and planar is not None and planar.channels == 1 else (0, 1)
    turned: Any = np.ascontiguousarray(np.rot90(array, round(rotation / 90), axes))
    result = av.VideoFrame.from_ndarray(turned, frame.format.name)
    for name in ("colorspace", "color_range", "color_primaries", "color_trc"):
        setattr(result, name, getattr(frame, name))
    return result


def picture_channels(picture: Picture) -> dict[str, Float32]:
    """The whole picture as scene-linear channels for OpenEXR."""
    if isinstance(picture, ArrayPicture) and picture.tags.transfer == "linear":
        array = np.atleast_3d(picture.array)
        if picture.order == "bgr" and array.shape[2] > 1:
            array = array[..., (2, 1, 0, 3)[: array.shape[2]]]
        if array.shape[2] == 4 and not picture.associated:
            array = np.concatenate([array[..., :3] * array[..., 3:], array[..., 3:]], axis=2)
        return {name: np.asarray(array[..., i]) for i, name in enumerate("RGBA"[: array.shape[2]])}
    light = picture.linear(Box(0, 0, picture.width, picture.height))
    return {name: np.ascontiguousarray(light[..., i]) for i, name in enumerate("RGB")}


def _array_frame(picture: ArrayPicture, *, alpha: bool) -> av.VideoFrame:
    """An RGB array as a frame; light becomes 16-bit sRGB, clipped to what that can hold.

    FFmpeg's alpha is straight; where none is wanted, associated colours are those over black.
    """
    array, tags = picture.array, picture.tags
    if picture.associated:
        array = _straight(array) if alpha else array[..., :3]
    if array.dtype == np.float32:
        array = _coded(array, tags)
    deep = array.dtype == np.uint16
    if array.ndim == 2:
        name = "gray16le" if deep else "gray"
    else:
        array = array if picture.order == "rgb" else array[..., (2, 1, 0, 3)[: array.shape[2]]]
        kind = "rgba" if array.shape[2] == 4 else "rgb"
        name = {"rgb": ("rgb24", "rgb48le"), "rgba": ("rgba", "rgba64le")}[kind][deep]
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(array), name)
    frame.color_trc, frame.color_primaries, frame.color_range = _SRGB_TRC, 1, 2
    return frame


def _straight(array: Plane) -> Plane:
    cover = np.where(array[..., 3:] > 0, array[..., 3:], 1)
    return np.concatenate([array[..., :3] / cover, array[..., 3:]], axis=2)


def _coded(array: Plane, tags: ColorTags) -> Plane:
    values = array.astype(np.float64)
    colour = values[..., :3] if values.ndim == 3 else values
    if tags.transfer == "linear":
        colour[...] = transfer("iec61966-2-1").to_coded(colour)
    return np.asarray(np.clip(values, 0.0, 1.0) * 65535.0 + 0.5).astype(np.uint16)
