"""Pull-push inpainting (Gortler et al. 1996, The Lumigraph).

A pyramid of means of the known pixels fills each unknown one from the finest level that has data.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from nlens_video.core.layers import Bool, Float32


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
