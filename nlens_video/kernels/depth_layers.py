"""Two depth layers of the object at its CoC discontinuities: the nearer surface and the rest.

The scatter has no depth order inside the object. Around a CoC discontinuity there are two surfaces:
the nearer one becomes a layer of its own. The one behind continues below it, because a lens sees
around the edge: inpainted (`split_at_steps`), or rendered by depth peeling (`split_at_hidden`).
Inpainting is pull-push (Gortler et al. 1996, The Lumigraph): a pyramid of means of the known pixels
fills each unknown one from the finest level that has data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from nlens_video.core.layers import Bool, Float32
from nlens_video.kernels.coc_discontinuities import CocDiscontinuities, HiddenSurface


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthLayers:
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


@njit(cache=True, nogil=True)
def _touches(mask: Bool, y: int, x: int, value: int) -> bool:
    """Whether one of the eight neighbours of a pixel is 1 or 0 in the mask."""
    for j in range(max(0, y - 1), min(mask.shape[0], y + 2)):
        for i in range(max(0, x - 1), min(mask.shape[1], x + 2)):
            if mask[j, i] == value and (j != y or i != x):
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
    """Unmix the near layer's antialiased edge pixels from the surface behind.

    Their coverage is the mix of the near colour beside them and the inpainted back; composited
    over the back they give their original colour.
    """
    height, width = near.shape
    edge, inner = np.zeros((2, height, width), dtype=np.bool_)
    for y in range(height):
        for x in range(width):
            if near[y, x]:
                edge[y, x] = _touches(back, y, x, 1)
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


def split_at_hidden(
    rgba: Float32, coc_px: Float32, steps: CocDiscontinuities, hidden: HiddenSurface
) -> DepthLayers:
    """Split likewise where the hidden surface is known: nothing is inpainted."""
    near = (rgba[..., 3] > 0.0) & (coc_px > steps.split_px)
    near_rgba = np.zeros_like(rgba)
    back_rgba, back_coc = rgba.copy(), coc_px.copy()
    _part(near, (rgba, hidden.front_rgba), hidden.rgba, near_rgba, back_rgba)
    np.copyto(back_coc, hidden.coc_px, where=near)
    return DepthLayers(
        near_rgba=near_rgba,
        near_coc_px=np.where(near, coc_px, np.float32(0.0)),
        back_rgba=back_rgba,
        back_coc_px=back_coc,
    )


@njit(cache=True, nogil=True)
def _part(
    near: Bool, front: tuple[Float32, Float32], hidden: Float32,
    near_rgba: Float32, back_rgba: Float32,
) -> None:  # fmt: skip
    """Fill in the near layer's colours and those that it hides.

    Its antialiased pixels are those beside what is not near; only they are parted, for on a steep
    surface samples of one pixel lie apart too.
    """
    whole, alone = front
    for y in range(near.shape[0]):
        for x in range(near.shape[1]):
            if near[y, x]:
                source = alone if _touches(near, y, x, 0) else whole
                for c in range(4):
                    near_rgba[y, x, c] = source[y, x, c]
                    back_rgba[y, x, c] = hidden[y, x, c]


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


@njit(cache=True, nogil=True)
def _halved(values: Float32, weight: Float32, offset: tuple[int, int]) -> tuple[Float32, Float32]:
    """Weighted means of 2 x 2 pixels, the first pixel `offset` into its cell, and their weights."""
    height, width, channels = values.shape
    rows, columns = (height + offset[0] + 1) // 2, (width + offset[1] + 1) // 2
    out = np.zeros((rows, columns, channels), dtype=np.float32)
    kept = np.zeros((rows, columns), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            part = weight[y, x]
            if part <= 0.0:
                continue
            j, i = (y + offset[0]) // 2, (x + offset[1]) // 2
            kept[j, i] += part
            for c in range(channels):
                out[j, i, c] += part * values[y, x, c]
    for j in range(rows):
        for i in range(columns):
            if kept[j, i] > 0.0:
                for c in range(channels):
                    out[j, i, c] /= kept[j, i]
                kept[j, i] = min(np.float32(1.0), kept[j, i])
    return out, kept


@njit(cache=True, nogil=True)
def _raised(fine: Float32, weight: Float32, coarse: Float32, offset: tuple[int, int]) -> Float32:
    """The fine level, its unknown pixels from the coarse one, bilinearly."""
    height, width, channels = fine.shape
    rows, columns = coarse.shape[:2]
    out = fine.copy()
    for y in range(height):
        v = 0.5 * (y + offset[0]) - 0.25
        top = int(np.floor(v))
        down = np.float32(v - top)
        j0, j1 = max(top, 0), min(top + 1, rows - 1)
        for x in range(width):
            part = np.float32(1.0) - weight[y, x]
            if part <= 0.0:
                continue
            u = 0.5 * (x + offset[1]) - 0.25
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
