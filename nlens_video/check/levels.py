"""A picture as the check compares it: in levels of sRGB, which go on above diffuse white."""

from __future__ import annotations

import numpy as np

from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Box, Float32
from nlens_video.video.pixels import blend
from nlens_video.video.pixels.chroma import with_full_chroma
from nlens_video.video.pixels.samples import Samples

WHITE = np.float32(255.0)
"""Diffuse white [level]."""
_SLOPE = np.float32(1.055 / 2.4)  # of the sRGB curve at white, over the logarithm of light
_HDR = ("smpte2084", "arib-std-b67", "linear")


def goes_above_white(tags: ColorTags) -> bool:
    """Whether a picture's light above diffuse white is meant to be shown (PQ, HLG, OpenEXR)."""
    return tags.transfer in _HDR


def levels(samples: Samples, *, above_white: bool) -> Float32:
    """A whole picture, (H, W, 3) [level].

    Above white a level is as large a share of light as it is at white, as in HLG, and nearly so in
    PQ: what encoding changes there is then no larger than elsewhere. Chroma is interpolated, so
    that a result of another subsampling is not of another colour beside edges.

    Args:
        samples: of a source's picture.
        above_white: whether light above diffuse white counts; else it is clipped.
    """
    full = with_full_chroma(samples)
    height, width = full.planes[0].shape
    whole = Box(0, 0, width, height)
    result = WHITE * blend.srgb(full)
    if above_white:
        light = blend.linear(full, whole)
        brighter = light > 1.0
        result[brighter] = WHITE * (1.0 + _SLOPE * np.log(light[brighter]))
    return result


def alpha_levels(samples: Samples) -> Float32 | None:
    """Alpha, 0 to 255, (H, W) [level]; None where the picture has none."""
    if samples.alpha is None:
        return None
    return np.asarray(samples.alpha * (WHITE / np.float32(samples.coding.peak or 1.0)), np.float32)
