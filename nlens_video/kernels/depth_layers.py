"""The object cut in two where its CoC steps: what is in front there, and what lies behind it.

Scatter knows no order inside the object. Near a step there are two surfaces; the nearer one is
taken out as a layer of its own, and the one behind is carried on under it, as smoothly as what is
seen of it allows, because a lens looks around the edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from nlens_video.frames import Bool, Float32
from nlens_video.kernels.pull_push import carried_on

STEP_PX = 2.0
"""CoC step between neighbours from which two surfaces are told apart [px]."""

FULL_STEP_PX = 4.0
"""Step from which its whole surroundings count; the reach grows from none at `STEP_PX` [px]."""

SPARE_PX = 3.0
"""How much farther than the larger disc a step's surroundings go [px]."""

_STRAIGHT, _DIAGONAL = 0.955, 1.369  # chamfer distances: off by 4.5 % at most


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthLayers:
    """An object in two layers, each with CoCs of its own.

    Attributes:
        near_rgba: premultiplied colour and alpha of what is in front (h, w, 4), 0 elsewhere.
        near_coc_px: its signed CoC diameter (h, w), 0 where it is not [px].
        back_rgba: the rest, carried on under what is in front (h, w, 4).
        back_coc_px: its signed CoC diameter (h, w), 0 where it is not [px].
    """

    near_rgba: Float32
    near_coc_px: Float32
    back_rgba: Float32
    back_coc_px: Float32


@njit(cache=True, nogil=True)
def _find_steps(
    coc: Float32, alpha: Float32, limits: tuple[float, float, float], reach: Float32, split: Float32
) -> bool:
    """Mark both sides of every step with its reach [px] and the CoC half-way; whether there is one.

    Of several steps at one pixel the largest counts.
    """
    step_px, full_step_px, spare_px = limits
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
                if step < step_px:
                    continue
                found = True
                share = min(1.0, (step - step_px) / (full_step_px - step_px))
                radius = share * (0.5 * max(abs(here), abs(there)) + spare_px)
                for j, i in ((y, x), (v, u)):
                    reach[j, i] = max(reach[j, i], radius)
                    if step > largest[j, i]:
                        largest[j, i] = step
                        split[j, i] = 0.5 * (here + there)
    return found


@njit(cache=True, nogil=True)
def _sweep(reach: Float32, straight: float, diagonal: float) -> None:
    """Let every reach fall off by 1 a pixel to the right and downwards (a chamfer sweep)."""
    height, width = reach.shape
    for y in range(height):
        for x in range(width):
            best = reach[y, x]
            if x > 0:
                best = max(best, reach[y, x - 1] - straight)
            if y > 0:
                best = max(best, reach[y - 1, x] - straight)
                if x > 0:
                    best = max(best, reach[y - 1, x - 1] - diagonal)
                if x + 1 < width:
                    best = max(best, reach[y - 1, x + 1] - diagonal)
            reach[y, x] = best


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """Where the object's CoC steps.

    Attributes:
        inside_px: how deep a pixel lies within the reach of a step (h, w), 0 out of reach [px].
        split_px: CoC half-way of the nearest step (h, w), 0 where there is none at all [px].
    """

    inside_px: Float32
    split_px: Float32


def carried_out(values: Float32, known: Bool) -> Float32:
    """Give every pixel the value of the nearest known one (h, w); as they are where none is."""
    if not known.any():
        return values
    _, labels = cv2.distanceTransformWithLabels(
        np.where(known, np.uint8(0), np.uint8(1)),
        cv2.DIST_L2,
        cv2.DIST_MASK_5,
        labelType=cv2.DIST_LABEL_PIXEL,
    )
    of_label = np.zeros(int(labels.max()) + 1, dtype=np.float32)
    of_label[labels[known]] = values[known]
    return np.asarray(of_label[labels], dtype=np.float32)


def find_steps(rgba: Float32, coc_px: Float32) -> Steps | None:
    """Find the steps of the CoC inside the object, and what is within reach of them.

    The reach is that of the larger disc, for light of either side can be misplaced that far. It
    grows from nothing with the step, so that nothing pops when a step appears.

    Args:
        rgba: premultiplied colour and alpha (h, w, 4).
        coc_px: signed CoC diameter (h, w), read only where alpha > 0 [px].

    Returns:
        The steps, or None where the CoC has none of `STEP_PX`.
    """
    reach, split = np.zeros((2, *coc_px.shape), dtype=np.float32)
    alpha = np.ascontiguousarray(rgba[..., 3])
    coc = np.ascontiguousarray(coc_px, dtype=np.float32)
    if not _find_steps(coc, alpha, (STEP_PX, FULL_STEP_PX, SPARE_PX), reach, split):
        return None
    marked = reach > 0.0
    if not marked.any():
        return None
    split = carried_out(split, marked)
    for turned in (reach, reach[::-1, ::-1]):
        _sweep(turned, _STRAIGHT, _DIAGONAL)
    return Steps(inside_px=reach, split_px=split)


@njit(cache=True, nogil=True)
def _beside(mask: Bool, y: int, x: int) -> bool:
    """Whether one of the eight neighbours is in the mask."""
    for j in range(max(0, y - 1), min(mask.shape[0], y + 2)):
        for i in range(max(0, x - 1), min(mask.shape[1], x + 2)):
            if mask[j, i] and (j != y or i != x):
                return True
    return False


@njit(cache=True, nogil=True)
def _inner_mean(rgba: Float32, inner: Bool, y: int, x: int, mean: Float32) -> bool:
    """Mean colour of what is wholly near within two pixels; whether there is any."""
    count = 0
    mean[:] = 0.0
    for j in range(max(0, y - 2), min(inner.shape[0], y + 3)):
        for i in range(max(0, x - 2), min(inner.shape[1], x + 3)):
            if inner[j, i]:
                count += 1
                for c in range(4):
                    mean[c] += rgba[j, i, c]
    if count:
        mean /= count
    return count > 0


@njit(cache=True, nogil=True)
def _take_back_out(near_rgba: Float32, near: Bool, back: Bool, filled: Float32) -> None:
    """Part the near layer's edge pixels from what lies behind, with which they are antialiased.

    Their coverage is what mixes the near colour beside them and the back carried on into theirs.
    Laid over the back again they give what they were.
    """
    height, width = near.shape
    edge, inner = np.zeros((2, height, width), dtype=np.bool_)
    for y in range(height):
        for x in range(width):
            if near[y, x]:
                edge[y, x] = _beside(back, y, x)
                inner[y, x] = not edge[y, x]
    mean = np.zeros(4, dtype=np.float32)
    for y in range(height):
        for x in range(width):
            if not edge[y, x] or not _inner_mean(near_rgba, inner, y, x, mean):
                continue
            along, square = 0.0, 0.0
            for c in range(3):
                apart = mean[c] - filled[y, x, c]
                along += (near_rgba[y, x, c] - filled[y, x, c]) * apart
                square += apart * apart
            if square <= 0.0:
                continue
            free = np.float32(1.0 - min(max(along / square, 0.0), 1.0))
            for c in range(4):
                near_rgba[y, x, c] = max(near_rgba[y, x, c] - free * filled[y, x, c], 0.0)


def split_at_steps(
    rgba: Float32, coc_px: Float32, steps: Steps, corner: tuple[int, int] = (0, 0)
) -> DepthLayers:
    """Cut the object in two: nearer than the nearest step's middle, and the rest carried on.

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
    filled = carried_on(values, known, corner)
    near_rgba = np.where(near[..., None], rgba, np.float32(0.0))
    _take_back_out(near_rgba, near, covered & known, filled)
    alpha = filled[..., 3]
    coc = np.divide(filled[..., 4], alpha, out=np.zeros_like(alpha), where=alpha > 0.0)
    back_coc = np.where(known, np.where(covered, coc_px, np.float32(0.0)), coc)
    return DepthLayers(
        near_rgba=near_rgba,
        near_coc_px=np.where(near, coc_px, np.float32(0.0)),
        back_rgba=np.ascontiguousarray(filled[..., :4]),
        back_coc_px=back_coc,
    )
