"""Real things in front: what is laid on the plate is hidden behind them.

Where a blurred foreground covers a share m of a pixel, the plate shows P = m F + (1 - m) B. With a
layer of premultiplied light C and coverage a between the two it would show
m F + (1 - m) (C + (1 - a) B): the layer counts (1 - m) times, and what it takes away is light of
the background B alone. So m F, the foreground's own light, is told apart from B in the soft edge;
without that the old background would stay visible there as a halo.
"""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Picture
from nlens_video.kernels.pull_push import inpaint
from nlens_video.stages.composite import ForegroundMatte

CONTEXT_PX = 48
"""How far around its region the light of foreground and background is looked for [px]."""
_PURE = 1e-3  # a share this near to 0 or 1 is one of the two alone


def foreground_light(plate: Float32, coverage: Float32, corner: tuple[int, int]) -> Float32:
    """The foreground's share m F of a plate P = m F + (1 - m) B.

    F and B are carried on into the soft edge from where each is seen alone (pull-push), then
    changed as little as makes them add up to the plate. Where one of them is nowhere seen alone
    the other one decides.

    Args:
        plate: scene-linear light (h, w, 3).
        coverage: m (h, w), 0 to 1 [1].
        corner: row and column of the first pixel in the frame.

    Returns:
        Premultiplied light (h, w, 3), between 0 and the plate.
    """
    front, back = coverage >= 1.0 - _PURE, coverage <= _PURE
    m = coverage[..., None]
    free = np.float32(1.0) - m
    if not back.any():
        return np.asarray(m * plate, dtype=np.float32)
    behind_it = _carried(plate, back, corner)
    if front.any():
        alone = _carried(plate, front, corner)
        missing = plate - m * alone - free * behind_it
        light = m * alone + (m * m / (m * m + free * free)) * missing
    else:
        light = plate - free * behind_it
    light = np.where(coverage[..., None] <= 0.0, np.float32(0.0), light)
    return np.asarray(np.clip(light, 0.0, np.maximum(plate, 0.0)), dtype=np.float32)


def _carried(plate: Float32, known: Bool, corner: tuple[int, int]) -> Float32:
    """A plate (h, w, 3) carried on from where it is known; what is nowhere near weighs nothing."""
    ones = np.ones((*known.shape, 1), np.float32)
    maps = np.concatenate([plate, ones], axis=2) * known[..., None]
    carried = inpaint(np.ascontiguousarray(maps, dtype=np.float32), known, corner)
    return np.asarray(carried[..., :3] / np.maximum(carried[..., 3:], np.float32(1e-6)))


def cover_of(picture: Picture, region: Box, coverage: Float32) -> ForegroundMatte | None:
    """What covers a region, its light told apart from the background's.

    Args:
        picture: the plate as it was decoded.
        region: where layers will be laid; inside the frame.
        coverage: of the foreground on the whole frame (H, W) [1].

    Returns:
        The cover on the region; None where nothing is in front there.
    """
    frame = Box(0, 0, picture.width, picture.height)
    seen = coverage[region.slices_in(frame)]
    if region.empty or not (seen > 0.0).any():
        return None
    wide = region.expanded(CONTEXT_PX).intersection(frame)
    light = foreground_light(
        picture.linear(wide), coverage[wide.slices_in(frame)], (wide.y0, wide.x0)
    )
    return ForegroundMatte(box=region, coverage=seen, light=light[region.slices_in(wide)])
