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
    return of_label[labels]


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


def split_at_steps(rgba: Float32, coc_px: Float32, steps: Steps) -> DepthLayers:
    """Cut the object in two: nearer than the nearest step's middle, and the rest carried on.

    Args:
        rgba: premultiplied scene-linear colour and alpha (h, w, 4).
        coc_px: signed CoC diameter (h, w), positive nearer than focus, read only where alpha > 0.
        steps: where it steps.
    """
    covered = rgba[..., 3] > 0.0
    near = covered & (coc_px > steps.split_px)
    known = ~near
    values = np.zeros((*coc_px.shape, 5), dtype=np.float32)
    values[..., :4] = np.where(known[..., None], rgba, np.float32(0.0))
    values[..., 4] = np.where(known & covered, coc_px * rgba[..., 3], np.float32(0.0))
    filled = _carried_on(values, known)
    alpha = filled[..., 3]
    coc = np.divide(filled[..., 4], alpha, out=np.zeros_like(alpha), where=alpha > 0.0)
    back_coc = np.where(known, np.where(covered, coc_px, np.float32(0.0)), coc)
    return DepthLayers(
        near_rgba=np.where(near[..., None], rgba, np.float32(0.0)),
        near_coc_px=np.where(near, coc_px, np.float32(0.0)),
        back_rgba=np.ascontiguousarray(filled[..., :4]),
        back_coc_px=back_coc,
    )


def _carried_on(values: Float32, known: Bool) -> Float32:
    """Fill unknown pixels from coarser and coarser means of the known ones (pull-push)."""
    levels = [(values, known.astype(np.float32))]
    while min(levels[-1][1].shape) > 1 and not levels[-1][1].all():
        levels.append(_halved(*levels[-1]))
    filled = levels.pop()[0]
    while levels:
        fine, weight = levels.pop()
        filled = _raised(fine, weight, filled)
    return filled


@njit(cache=True, nogil=True)
def _halved(values: Float32, weight: Float32) -> tuple[Float32, Float32]:
    """Weighted means of 2 x 2 pixels (h / 2, w / 2, c), and whether they hold anything."""
    height, width, channels = values.shape
    rows, columns = (height + 1) // 2, (width + 1) // 2
    out = np.zeros((rows, columns, channels), dtype=np.float32)
    kept = np.zeros((rows, columns), dtype=np.float32)
    for y in range(rows):
        for x in range(columns):
            total = np.float32(0.0)
            for j in range(2 * y, min(2 * y + 2, height)):
                for i in range(2 * x, min(2 * x + 2, width)):
                    if weight[j, i] > 0.0:
                        total += weight[j, i]
                        for c in range(channels):
                            out[y, x, c] += weight[j, i] * values[j, i, c]
            if total > 0.0:
                for c in range(channels):
                    out[y, x, c] /= total
                kept[y, x] = min(np.float32(1.0), total)
    return out, kept


@njit(cache=True, nogil=True)
def _raised(fine: Float32, weight: Float32, coarse: Float32) -> Float32:
    """The fine level, its unknown pixels from the coarse one, bilinearly."""
    height, width, channels = fine.shape
    rows, columns = coarse.shape[:2]
    out = fine.copy()
    for y in range(height):
        v = 0.5 * y - 0.25
        top = int(np.floor(v))
        down = np.float32(v - top)
        j0, j1 = max(top, 0), min(top + 1, rows - 1)
        for x in range(width):
            part = np.float32(1.0) - weight[y, x]
            if part <= 0.0:
                continue
            u = 0.5 * x - 0.25
            left = int(np.floor(u))
            along = np.float32(u - left)
            i0, i1 = max(left, 0), min(left + 1, columns - 1)
            for c in range(channels):
                above = coarse[j0, i0, c] + along * (coarse[j0, i1, c] - coarse[j0, i0, c])
                below = coarse[j1, i0, c] + along * (coarse[j1, i1, c] - coarse[j1, i0, c])
                out[y, x, c] = weight[y, x] * fine[y, x, c] + part * (
                    above + down * (below - above)
                )
    return out
