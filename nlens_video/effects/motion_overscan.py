"""What a moving object brings into the frame, or takes out of it, while the shutter is open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce

import numpy as np
from msgspec.structs import replace

from nlens_video.core.layers import BlurredLayer, Box, Float32, Float64
from nlens_video.scene.posed import bounds_of
from nlens_video.stages.l_reblur import ReblurLayer

_EXTENDED_PX = 2  # so narrow a strip beyond the border looks as the border itself [px]


def overscan(places: Sequence[Float64], half_px: Float64, reach_px: float, frame: Box) -> Box:
    """The frame, and beside it what the motion filter brings in of an object that stands there.

    It grows by no more than the frame's own size on each side, which bounds the memory.

    Args:
        places: positions of vertices (V, 2) at the moments of which layers are rendered [px].
        half_px: by how many columns and rows the filter reaches to each side (2,) [px].
        reach_px: how far the lens spreads the object [px].
        frame: the frame's own box.

    Returns:
        The box; the frame itself where nothing comes in, an empty one where the object stays out.
    """
    low, high = bounds_of(np.concatenate(places))
    low, high = low - reach_px, high + reach_px
    columns, rows = (
        min(math.ceil(float(half)), size)
        for half, size in zip(half_px, (frame.width, frame.height), strict=True)
    )
    met = low[0] < frame.x1 + columns and low[1] < frame.y1 + rows
    if not (met and high[0] > frame.x0 - columns and high[1] > frame.y0 - rows):
        return Box(0, 0, 0, 0)
    columns *= columns >= _EXTENDED_PX
    rows *= rows >= _EXTENDED_PX
    return Box(
        frame.x0 - columns * (low[0] < frame.x0), frame.y0 - rows * (low[1] < frame.y0),
        frame.x1 + columns * (high[0] > frame.x1), frame.y1 + rows * (high[1] > frame.y1),
    )  # fmt: skip


def farthest_px(box: Box, frame: Box) -> int:
    """How far a box reaches beyond the frame at most, 0 where it does not [px]."""
    beyond = (frame.x0 - box.x0, frame.y0 - box.y0, box.x1 - frame.x1, box.y1 - frame.y1)
    return max(0, *beyond)


def strips(box: Box, frame: Box) -> list[Box]:
    """The parts of a box beyond the frame, each pixel in one of them."""
    sides = (
        Box(box.x0, box.y0, frame.x0, box.y1),
        Box(frame.x1, box.y0, box.x1, box.y1),
        Box(frame.x0, box.y0, frame.x1, frame.y0),
        Box(frame.x0, frame.y1, frame.x1, box.y1),
    )
    return [side for side in sides if not side.empty]


def lens_beyond(lens: ReblurLayer, frame: Box, box: Box) -> ReblurLayer:
    """A lens whose results are cut to a box instead of the frame, which its cat's eye stays with.

    Args:
        lens: to be called with that box for the frame.
        frame: the frame's own box.
        box: what is to be seen.
    """

    def scatter(rgba: Float32, coc_px: Float32, *, pixel_aspect: float, frame: Box) -> Float32:
        own = whole.translated(frame.x0 - box.x0, frame.y0 - box.y0)
        return lens.scatter(rgba, coc_px, pixel_aspect=pixel_aspect, frame=own)

    whole = frame
    return replace(lens, scatter=scatter)


def beside(blurred: BlurredLayer | None, frame: Box, parts: Sequence[BlurredLayer]) -> BlurredLayer:
    """A layer inside the frame with what is beside it, as one.

    Args:
        blurred: the layer; None for nothing.
        frame: the frame's own box, in which nothing else counts.
        parts: what is beside the frame.
    """
    blurred = blurred or BlurredLayer.nothing()
    held = [part for part in parts if not part.box.empty]
    if not held:
        return blurred
    box = reduce(Box.union, (part.box for part in held), blurred.box)
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    for part in held:
        rgba[part.box.slices_in(box)] = part.rgba
    inside = frame.intersection(box)
    if not inside.empty:
        rgba[inside.slices_in(box)] = 0.0
    if not blurred.box.empty:
        rgba[blurred.box.slices_in(box)] = blurred.rgba
    return BlurredLayer(box=box, rgba=rgba)
