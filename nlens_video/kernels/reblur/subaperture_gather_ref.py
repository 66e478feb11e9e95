"""Definition of `subaperture_gather`: every pixel sums over every source."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.kernels.reblur.subaperture_gather import STEPS, ramp, subaperture_table


def gather_subaperture_ref(
    light: Float32, covered: Bool, coc_px: Float32, target: Box, *, pixel_aspect: float = 1.0
) -> Float64:
    """Blur a view over its cell; arguments and result as `gather_subaperture`."""
    out = np.zeros((target.height, target.width, 4))
    sources = [(int(y), int(x)) for y, x in np.argwhere(covered)]
    for y in range(target.y0, target.y1):
        for x in range(target.x0, target.x1):
            inside = 0 <= y < covered.shape[0] and 0 <= x < covered.shape[1]
            own = float(coc_px[y, x]) if inside and covered[y, x] else -math.inf
            before, near = np.zeros(4), 0.0
            behind, far = np.zeros(4), 0.0
            for row, column in sources:
                coc = float(coc_px[row, column])
                distance = math.hypot(column - x, (row - y) / pixel_aspect)
                if coc > own:
                    weight = _weight(distance, coc, pixel_aspect)
                    before += weight * light[row, column]
                    near += weight
                else:
                    weight = _weight(distance, own, pixel_aspect)
                    behind += weight * light[row, column]
                    far += weight
            if own > -math.inf:  # beyond the object's own pixels its disc sees nothing
                far += _empty(covered, (y, x), own, pixel_aspect)
                behind *= max(1.0 - near, 0.0) / far
            out[y - target.y0, x - target.x0] = before / max(near, 1.0) + behind
    return out


def _weight(distance: float, coc_px: float, pixel_aspect: float) -> float:
    """Share of a disc's light on a pixel."""
    place = 0.5 * abs(coc_px) * STEPS
    table = subaperture_table(pixel_aspect)
    entry = int(place)
    radius, share = table[:, entry] + (place - entry) * (table[:, entry + 1] - table[:, entry])
    return float(ramp(np.array(distance), float(radius)) * share)


def _empty(covered: Bool, at: tuple[int, int], coc_px: float, pixel_aspect: float) -> float:
    """Weight, in the disc of a pixel, of those where the object is not."""
    reach = math.ceil((0.5 * abs(coc_px) + 2.0) * max(1.0, pixel_aspect))
    wide = np.pad(covered, reach)
    total = 0.0
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if not wide[at[0] + dy + reach, at[1] + dx + reach]:
                distance = math.hypot(dx, dy / pixel_aspect)
                total += _weight(distance, coc_px, pixel_aspect)
    return total
