"""CoC discontinuities inside the object: edges where one of its surfaces occludes another."""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Float32
from nlens_video.native import kernels

STEP_PX = 2.0
"""Smallest CoC difference between neighbours that separates two surfaces [px]."""

FULL_STEP_PX = 4.0
"""Difference at which the reach is full; it grows linearly from 0 at `STEP_PX` [px]."""

SPARE_PX = 3.0
"""Margin of the reach beyond the radius of the larger disc [px]."""

BESIDE_PX = 3.0
"""Distance to hidden pixels up to which a discontinuity counts fully; 0 at twice that [px]."""

_OPAQUE = 0.999  # alpha of a surface that hides what is behind it
_STEP = (STEP_PX, FULL_STEP_PX, SPARE_PX, BESIDE_PX)


class HiddenSurface(Struct, frozen=True, kw_only=True):
    """What the nearest surfaces hide.

    Attributes:
        rgba: premultiplied colour and alpha of the nearest surface behind them (h, w, 4).
        coc_px: its signed CoC diameter (h, w), read only where it has alpha [px].
        front_rgba: what the nearest surfaces alone give to each pixel (h, w, 4).
    """

    rgba: Float32
    coc_px: Float32
    front_rgba: Float32


def chamfer(reach: Float32) -> None:
    """Spread each reach (h, w), less the chamfer distance, keeping the maximum [px].

    Args:
        reach: how far what is at a pixel reaches, 0 for not at all; changed in place [px].
    """
    kernels.chamfer(reach)


class CocDiscontinuities(Struct, frozen=True, kw_only=True):
    """Discontinuities of the object's CoC.

    Attributes:
        inside_px: how deep a pixel lies within the reach of a step (h, w), 0 out of reach [px].
        split_px: CoC half-way of the nearest step (h, w), 0 where there is none at all [px].
    """

    inside_px: Float32
    split_px: Float32


def extend_nearest(values: Float32, known: Bool) -> Float32:
    """Give every pixel the value of the nearest known one (h, w); as they are where none is."""
    if not known.any():
        return values
    _, labels = cv2.distanceTransformWithLabels(
        np.where(known, np.uint8(0), np.uint8(1)),
        cv2.DIST_L2,
        cv2.DIST_MASK_5,
        labelType=cv2.DIST_LABEL_PIXEL,
    )
    out = np.empty(values.shape, np.float32)
    kernels.carry_labels(
        np.ascontiguousarray(values, np.float32), np.ascontiguousarray(known),
        np.ascontiguousarray(labels, np.int32), out,
    )  # fmt: skip
    return out


def find_discontinuities(
    rgba: Float32, coc_px: Float32, hidden: HiddenSurface | None = None
) -> CocDiscontinuities | None:
    """Find the steps of the CoC inside the object, and what is within reach of them.

    Where it is known what is hidden, that counts too where the object ends before nothing or is
    see-through, and only what hides something is a step: a surface seen at a glancing angle is
    steep and hides none.

    The reach is that of the larger disc, for light of either side can be misplaced that far. It
    grows from nothing with the step, so that nothing pops when a step appears.

    Args:
        rgba: premultiplied colour and alpha (h, w, 4).
        coc_px: signed CoC diameter (h, w), read only where alpha > 0 [px].
        hidden: what the nearest surfaces hide, where that is known.

    Returns:
        The steps, or None where the CoC has none of `STEP_PX`.
    """
    reach, split = np.zeros((2, *coc_px.shape), dtype=np.float32)
    alpha = np.ascontiguousarray(rgba[..., 3])
    coc = np.ascontiguousarray(coc_px, dtype=np.float32)
    away = np.zeros_like(coc)
    if hidden is not None:
        there = hidden.rgba[..., 3] > 0.0
        if not there.any():
            return None
        away[:] = cv2.distanceTransform(
            np.where(there, np.uint8(0), np.uint8(1)), cv2.DIST_L2, cv2.DIST_MASK_5
        )
    found = kernels.find_steps(coc, alpha, away, _STEP, (reach, split))
    if hidden is not None:
        nearest = (extend_nearest(hidden.coc_px, there), away)
        found |= kernels.find_rims(coc, alpha, nearest, _STEP, (reach, split))
        found |= _mark_see_through(coc, alpha, hidden, (reach, split))
    if not found:
        return None
    marked = reach > 0.0
    if not marked.any():
        return None
    split = extend_nearest(split, marked)
    chamfer(reach)
    return CocDiscontinuities(inside_px=reach, split_px=split)


def see_through(coc_px: Float32, alpha: Float32, hidden: HiddenSurface) -> Bool:
    """Where light of a surface of another CoC comes through the nearest one (h, w)."""
    shows = (alpha > 0.0) & (hidden.rgba[..., 3] > 0.0) & (hidden.front_rgba[..., 3] < _OPAQUE)
    return np.asarray(shows & (coc_px - hidden.coc_px >= np.float32(STEP_PX)))


def _mark_see_through(
    coc_px: Float32, alpha: Float32, hidden: HiddenSurface, marks: tuple[Float32, Float32]
) -> bool:
    """Mark likewise what is see-through; whether anything is. `marks` are reach and split."""
    reach, split = marks
    there = see_through(coc_px, alpha, hidden)
    if not there.any():
        return False
    one, other = coc_px[there], hidden.coc_px[there]
    share = np.minimum((one - other - STEP_PX) / (FULL_STEP_PX - STEP_PX), 1.0)
    radius = share * (0.5 * np.maximum(np.abs(one), np.abs(other)) + SPARE_PX)
    more = radius > reach[there]
    reach[there] = np.where(more, radius, reach[there])
    split[there] = np.where(more, 0.5 * (one + other), split[there])
    return True
