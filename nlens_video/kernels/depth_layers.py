"""Two depth layers of the object at its CoC discontinuities: the nearer surface and the rest.

The scatter has no depth order inside the object. Around a CoC discontinuity there are two surfaces:
the nearer one becomes a layer of its own. The one behind continues below it, because a lens sees
around the edge: inpainted (`split_at_steps`), or rendered by depth peeling (`split_at_hidden`).
Inpainting is pull-push (Gortler et al. 1996, The Lumigraph): a pyramid of means of the known pixels
fills each unknown one from the finest level that has data.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Float32
from nlens_video.kernels.coc_discontinuities import (
    FULL_STEP_PX,
    SPARE_PX,
    STEP_PX,
    CocDiscontinuities,
    HiddenSurface,
    see_through,
)
from nlens_video.native import kernels

_SMALL_PX = 28.0  # discs up to which the order is right across cuts too, as `bench` tells
_SPREAD = 0.35  # standard deviation of what a cut concerns, by the disc's diameter [1]
_SIGMA_PX = 4.0  # blur for which a picture is coarse enough
_WHOLE = 4.0  # share upon a long straight cut, before it is bounded by 1


class DepthLayers(Struct, frozen=True, kw_only=True):
    """An object in two layers, each with CoCs of its own.

    Attributes:
        near_rgba: premultiplied colour and alpha of what is in front (h, w, 4), 0 elsewhere.
        near_coc_px: its signed CoC diameter (h, w), 0 where it is not [px].
        back_rgba: the rest, continued below what is in front (h, w, 4).
        back_coc_px: its signed CoC diameter (h, w), 0 where it is not [px].
    """

    near_rgba: Float32
    near_coc_px: Float32
    back_rgba: Float32
    back_coc_px: Float32


def split_at_steps(
    rgba: Float32, coc_px: Float32, steps: CocDiscontinuities, corner: tuple[int, int] = (0, 0)
) -> DepthLayers:
    """Split at the CoC half-way of the nearest discontinuity; inpaint the back below the front.

    Args:
        rgba: premultiplied scene-linear colour and alpha (h, w, 4).
        coc_px: signed CoC diameter (h, w), positive nearer than focus, read only where alpha > 0.
        steps: where it steps.
        corner: row and column of the arrays' first pixel in the frame, to which the means that
            carry on the back are anchored: what is hidden does not change with the cut [px].
    """
    covered = rgba[..., 3] > 0.0
    near = covered & (coc_px > steps.split_px)
    known = ~near
    values = np.zeros((*coc_px.shape, 5), dtype=np.float32)
    values[..., :4] = np.where(known[..., None], rgba, np.float32(0.0))
    values[..., 4] = np.where(known & covered, coc_px * rgba[..., 3], np.float32(0.0))
    filled = inpaint(values, known, corner)
    near_rgba = np.where(near[..., None], rgba, np.float32(0.0))
    kernels.take_back_out(near_rgba, near, covered & known, filled)
    alpha = filled[..., 3]
    coc = np.divide(filled[..., 4], alpha, out=np.zeros_like(alpha), where=alpha > 0.0)
    back_coc = np.where(known, np.where(covered, coc_px, np.float32(0.0)), coc)
    return DepthLayers(
        near_rgba=near_rgba,
        near_coc_px=np.where(near, coc_px, np.float32(0.0)),
        back_rgba=np.ascontiguousarray(filled[..., :4]),
        back_coc_px=back_coc,
    )


def split_at_hidden(
    rgba: Float32, coc_px: Float32, steps: CocDiscontinuities, hidden: HiddenSurface
) -> DepthLayers:
    """Split likewise where the hidden surface is known: nothing is inpainted."""
    near = (rgba[..., 3] > 0.0) & (coc_px > steps.split_px)
    near_rgba = np.zeros(rgba.shape, np.float32)
    back_rgba, back_coc = rgba.copy(), coc_px.copy()
    whole, alone = np.ascontiguousarray(rgba), np.ascontiguousarray(hidden.front_rgba)
    kernels.part_layers(near, whole, alone, np.ascontiguousarray(hidden.rgba), near_rgba, back_rgba)
    through = near & see_through(coc_px, rgba[..., 3], hidden)
    np.copyto(near_rgba, hidden.front_rgba, where=through[..., None])
    np.copyto(back_coc, hidden.coc_px, where=near)
    return DepthLayers(
        near_rgba=near_rgba,
        near_coc_px=np.where(near, coc_px, np.float32(0.0)),
        back_rgba=back_rgba,
        back_coc_px=back_coc,
    )


def cut_share(
    rgba: Float32, coc_px: Float32, steps: CocDiscontinuities, hidden: HiddenSurface
) -> Float32 | None:
    """How much of what a pixel's disc meets is a cut through a surface (h, w), 0 to 1; None: none.

    Three surfaces behind each other do not part into two layers: the one in the middle is cut where
    it changes from the near layer to the back one. Where the near side of a cut hides something,
    that lies in one layer with the other side, which hides it as well. Small discs show nothing of
    it. The share grows with the disc, the length of the cut and the step to what it hides, so that
    nothing pops when one appears.

    Args:
        rgba: premultiplied colour and alpha (h, w, 4).
        coc_px: signed CoC diameter (h, w) [px].
        steps: where it steps.
        hidden: what the nearest surfaces hide.
    """
    covered = rgba[..., 3] > 0.0
    near = covered & (coc_px > steps.split_px)
    hides = np.clip((coc_px - hidden.coc_px - STEP_PX) / (FULL_STEP_PX - STEP_PX), 0.0, 1.0)
    hides *= np.clip(np.abs(coc_px) / _SMALL_PX - 1.0, 0.0, 1.0)
    hides *= near & (hidden.rgba[..., 3] > 0.0)
    cut = np.zeros_like(coc_px)
    whole = slice(None)
    for one, other in (
        ((whole, slice(1, None)), (whole, slice(None, -1))),
        ((slice(1, None), whole), (slice(None, -1), whole)),
    ):
        parts = covered[one] & covered[other] & (near[one] != near[other])
        parts &= np.abs(coc_px[one] - coc_px[other]) < STEP_PX
        cut[one] = np.maximum(cut[one], parts * hides[one])
        cut[other] = np.maximum(cut[other], parts * hides[other])
    if not cut.any():
        return None
    sigma = _SPREAD * float(np.abs(coc_px).max(where=cut > 0.0, initial=0.0)) + 0.5 * SPARE_PX
    step = max(1, int(sigma / _SIGMA_PX))
    height, width = cut.shape
    size = -(-width // step), -(-height // step)
    coarse = cv2.resize(cut, size, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(coarse, (0, 0), sigma / step, borderType=cv2.BORDER_CONSTANT)
    line = math.sqrt(2.0 * math.pi) * sigma  # a long straight cut has 1 / line of it upon itself
    share = cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.clip(_WHOLE * line * share, 0.0, 1.0), dtype=np.float32)


def inpaint(values: Float32, known: Bool, corner: tuple[int, int]) -> Float32:
    """Fill unknown pixels from a pyramid of means of the known ones.

    Args:
        values: any maps (h, w, c); those of unknown pixels are 0.
        known: where they are known (h, w).
        corner: row and column of the first pixel in the frame, to which the means are anchored.

    Returns:
        The maps (h, w, c), known pixels as they were; 0 where nothing at all is known.
    """
    levels = [(values, known.astype(np.float32), (0, 0))]
    y, x = corner
    while max(levels[-1][1].shape) > 2 and not levels[-1][1].all():
        offset = (y % 2, x % 2)
        fine, weight, _ = levels[-1]
        levels[-1] = (fine, weight, offset)
        levels.append((*_halved(fine, weight, offset), (0, 0)))
        y, x = y // 2, x // 2
    filled = levels.pop()[0]
    while levels:
        fine, weight, offset = levels.pop()
        filled = _raised(fine, weight, filled, offset)
    return filled


def _halved(values: Float32, weight: Float32, offset: tuple[int, int]) -> tuple[Float32, Float32]:
    """Weighted means of 2 x 2 pixels, the first pixel `offset` into its cell, and their weights."""
    height, width, channels = values.shape
    size = (height + offset[0] + 1) // 2, (width + offset[1] + 1) // 2
    out, kept = np.zeros((*size, channels), np.float32), np.zeros(size, np.float32)
    kernels.halve(values, weight, offset, out, kept)
    return out, kept


def _raised(fine: Float32, weight: Float32, coarse: Float32, offset: tuple[int, int]) -> Float32:
    """The fine level, its unknown pixels from the coarse one, bilinearly."""
    out = fine.copy()
    kernels.raise_level(fine, weight, coarse, offset, out)
    return out
