"""CoC discontinuities inside the object: edges where one of its surfaces occludes another."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.core.layers import Bool, Float32

STEP_PX = 2.0
"""Smallest CoC difference between neighbours that separates two surfaces [px]."""

FULL_STEP_PX = 4.0
"""Difference at which the reach is full; it grows linearly from 0 at `STEP_PX` [px]."""

SPARE_PX = 3.0
"""Margin of the reach beyond the radius of the larger disc [px]."""

BESIDE_PX = 3.0
"""Distance to hidden pixels up to which a discontinuity counts fully; 0 at twice that [px]."""

_STRAIGHT, _DIAGONAL = 0.955, 1.369  # chamfer distances: off by 4.5 % at most


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenSurface:
    """What the nearest surfaces hide.

    Attributes:
        rgba: premultiplied colour and alpha of the nearest surface behind them (h, w, 4).
        coc_px: its signed CoC diameter (h, w), read only where it has alpha [px].
        front_rgba: what the nearest surfaces alone give to each pixel (h, w, 4).
    """

    rgba: Float32
    coc_px: Float32
    front_rgba: Float32


@njit(cache=True, nogil=True)
def _find_steps(
    coc: Float32, alpha: Float32, away: Float32, reach: Float32, split: Float32
) -> bool:
    """Mark both sides of every step with its reach [px] and the CoC half-way; whether there is one.

    Of several steps at one pixel the largest counts. `away` is the distance to the nearest hidden
    pixel [px], 0 where unknown: a surface that hides nothing is steep and no discontinuity.
    """
    height, width = coc.shape
    largest = np.zeros((height, width), dtype=np.float32)
    found = False
    for y in range(height):
        for x in range(width):
            if alpha[y, x] <= 0.0:
                continue
            for down in range(2):
                v, u = y + down, x + 1 - down
                if v >= height or u >= width or alpha[v, u] <= 0.0:
                    continue
                here, there = coc[y, x], coc[v, u]
                step = abs(here - there)
                if step < STEP_PX:
                    continue
                found = True
                share = min(1.0, (step - STEP_PX) / (FULL_STEP_PX - STEP_PX))
                radius = share * (0.5 * max(abs(here), abs(there)) + SPARE_PX)
                beside = away[y, x] if here > there else away[v, u]
                radius *= min(max(2.0 - beside / BESIDE_PX, 0.0), 1.0)
                if radius <= 0.0:
                    continue
                for j, i in ((y, x), (v, u)):
                    reach[j, i] = max(reach[j, i], radius)
                    if step > largest[j, i]:
                        largest[j, i] = step
                        split[j, i] = 0.5 * (here + there)
    return found


@njit(cache=True, nogil=True)
def _find_rims(
    coc: Float32, alpha: Float32, nearest: tuple[Float32, Float32], reach: Float32, split: Float32
) -> bool:
    """Mark likewise where the object ends before nothing and hides something; whether it does.

    `nearest` is the CoC of the nearest hidden pixel, and the distance to it [px].
    """
    height, width = coc.shape
    found = False
    for y in range(height):
        for x in range(width):
            if alpha[y, x] <= 0.0:
                continue
            rim = (
                (x > 0 and alpha[y, x - 1] <= 0.0) or (x + 1 < width and alpha[y, x + 1] <= 0.0)
                or (y > 0 and alpha[y - 1, x] <= 0.0)
                or (y + 1 < height and alpha[y + 1, x] <= 0.0)
            )  # fmt: skip
            here, there = coc[y, x], nearest[0][y, x]
            if not rim or here - there < STEP_PX:
                continue
            share = min(1.0, (here - there - STEP_PX) / (FULL_STEP_PX - STEP_PX))
            radius = share * (0.5 * max(abs(here), abs(there)) + SPARE_PX)
            radius = min(radius, 2.0 * (radius - nearest[1][y, x]))  # fades in with the distance
            if radius > reach[y, x]:
                found = True
                reach[y, x] = radius
                split[y, x] = 0.5 * (here + there)
    return found


@njit(cache=True, nogil=True)
def _sweep(reach: Float32) -> None:
    """Let every reach fall off by 1 a pixel to the right and downwards (a chamfer sweep)."""
    height, width = reach.shape
    for y in range(height):
        for x in range(width):
            best = reach[y, x]
            if x > 0:
                best = max(best, reach[y, x - 1] - _STRAIGHT)
            if y > 0:
                best = max(best, reach[y - 1, x] - _STRAIGHT)
                if x > 0:
                    best = max(best, reach[y - 1, x - 1] - _DIAGONAL)
                if x + 1 < width:
                    best = max(best, reach[y - 1, x + 1] - _DIAGONAL)
            reach[y, x] = best


def chamfer(reach: Float32) -> None:
    """Spread each reach (h, w), less the chamfer distance, keeping the maximum [px].

    Args:
        reach: how far what is at a pixel reaches, 0 for not at all; changed in place [px].
    """
    for turned in (reach, reach[::-1, ::-1]):
        _sweep(turned)


@dataclass(frozen=True, slots=True, kw_only=True)
class CocDiscontinuities:
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
    _carry(values, known, np.asarray(labels, np.int32), out)
    return out


@njit(cache=True, nogil=True)
def _carry(values: Float32, known: Bool, labels: npt.NDArray[np.int32], out: Float32) -> None:
    """Give every pixel the known value of its label."""
    of_label = np.zeros(labels.size + 1, np.float32)
    for y in range(known.shape[0]):
        for x in range(known.shape[1]):
            if known[y, x]:
                of_label[labels[y, x]] = values[y, x]
    for y in range(known.shape[0]):
        for x in range(known.shape[1]):
            out[y, x] = of_label[labels[y, x]]


def find_discontinuities(
    rgba: Float32, coc_px: Float32, hidden: HiddenSurface | None = None
) -> CocDiscontinuities | None:
    """Find the steps of the CoC inside the object, and what is within reach of them.

    Where it is known what is hidden, that counts too where the object ends before nothing, and
    only what hides something is a step: a surface seen at a glancing angle is steep and hides none.

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
    found = _find_steps(coc, alpha, away, reach, split)
    if hidden is not None:
        nearest = (extend_nearest(hidden.coc_px, there), away)
        found |= _find_rims(coc, alpha, nearest, reach, split)
    if not found:
        return None
    marked = reach > 0.0
    if not marked.any():
        return None
    split = extend_nearest(split, marked)
    chamfer(reach)
    return CocDiscontinuities(inside_px=reach, split_px=split)
