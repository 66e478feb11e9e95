"""Depth resolve: the depth of a pixel's nearest surface, never a mean of two surfaces."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import f32, inlined, kernel, kernel_of
from nlens_video.render.software.triangles import SAMPLES

_ONE_SURFACE = f32(1.005)  # samples of one surface differ by less, seen from the front
_STEEPER = f32(1.5)


@inlined
def _range(disparity: Float32, y: int, x: int, least: float) -> tuple[float, float]:
    """Least and greatest disparity of a pixel's samples; `least` stands for nothing."""
    low = high = max(disparity[SAMPLES * y, x], least)
    for s in range(1, SAMPLES):
        d = max(disparity[SAMPLES * y + s, x], least)
        low, high = min(low, d), max(high, d)
    return low, high


@kernel
def _steep(disparity: Float32, y: int, x: int, size: tuple[int, int], least: float) -> bool:
    """Whether samples that differ lie on one steep surface and not on two.

    On a plane the neighbours' samples differ as much; across a step, those of the neighbours on
    either side do not.
    """
    height, width = size
    low, high = _range(disparity, y, x, least)
    left = _range(disparity, y, max(x - 1, 0), least)
    right = _range(disparity, y, min(x + 1, width - 1), least)
    above = _range(disparity, max(y - 1, 0), x, least)
    below = _range(disparity, min(y + 1, height - 1), x, least)
    beside = min(left[1] - left[0], right[1] - right[0])
    over = min(above[1] - above[0], below[1] - below[0])
    return high - low < _STEEPER * min(beside, over)


@kernel_of("void(f4[:,::1],i8,i8,f4,f4[:,::1])")
def resolve_depth(
    disparity: Float32, first: int, last: int, least: float, depth: Float32
) -> None:  # fmt: skip
    """Fill in depths on rows [first, last).

    Where all samples lie on one surface, their mean disparity, which is affine across the screen,
    is that at the pixel's centre.

    Args:
        disparity: of each sample (4 h, width + PADDING), 0 where there is nothing
            [1 / scene unit].
        first: first row [px].
        last: one beyond the last row [px].
        least: disparity of a surface beyond all others [1 / scene unit].
        depth: filled in (h, width), +inf where nothing is [scene unit].
    """
    size = depth.shape[0], depth.shape[1]
    for y in range(first, last):
        for x in range(size[1]):
            low = high = total = disparity[SAMPLES * y, x]
            for s in range(1, SAMPLES):
                d = disparity[SAMPLES * y + s, x]
                low, high = min(low, d), max(high, d)
                total += d
            if high == 0.0:
                depth[y, x] = np.inf
            elif low > 0.0 and (high < _ONE_SURFACE * low or _steep(disparity, y, x, size, least)):
                depth[y, x] = np.float32(SAMPLES) / total
            else:
                depth[y, x] = np.float32(1.0) / high
