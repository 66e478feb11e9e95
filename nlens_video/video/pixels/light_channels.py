"""Pictures as channels of scene-linear light, for OpenEXR."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.video.pixels.picture import ArrayPicture, SamplesPicture


def picture_channels(picture: Picture) -> dict[str, Float32]:
    """The whole picture as scene-linear channels, premultiplied by alpha where it has that."""
    if isinstance(picture, ArrayPicture) and picture.tags.transfer == "linear":
        array = np.atleast_3d(picture.array)
        if picture.order == "bgr" and array.shape[2] > 1:
            array = array[..., (2, 1, 0, 3)[: array.shape[2]]]
        if array.shape[2] == 4 and not picture.associated:
            array = np.concatenate([array[..., :3] * array[..., 3:], array[..., 3:]], axis=2)
        return {name: np.asarray(array[..., i]) for i, name in enumerate("RGBA"[: array.shape[2]])}
    light = picture.linear(Box(0, 0, picture.width, picture.height))
    samples = picture.samples() if isinstance(picture, SamplesPicture) else None
    if samples is None or samples.alpha is None:
        return {name: np.ascontiguousarray(light[..., i]) for i, name in enumerate("RGB")}
    alpha = samples.alpha.astype(np.float32) / np.float32(samples.coding.peak or 1.0)
    return {**{name: light[..., i] * alpha for i, name in enumerate("RGB")}, "A": alpha}


def channel_primaries(picture: Picture) -> str:
    """Primaries of `picture_channels`, by a name of `ColorTags`."""
    if isinstance(picture, ArrayPicture) and picture.tags.transfer == "linear":
        return picture.tags.primaries
    return "bt709"
