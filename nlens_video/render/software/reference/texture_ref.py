"""`texture.sample` by its definition, one coordinate at a time in float64."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.render.software.texture import Atlas

_CLAMP, _MIRROR = 33071, 33648
_LINEAR = 9729
# Shrinking: nearest of nearest level, linear of nearest, nearest of two levels, linear of two.
_FILTERS = {9728: (0, 0), 9729: (1, 0), 9984: (0, 1), 9985: (1, 1), 9986: (0, 2), 9987: (1, 2)}


def sample(
    atlas: Atlas, texture: int, at: tuple[float, float], along: tuple[Float64, Float64]
) -> Float64:
    """Linear RGBA (4,) at coordinates that change by `along` (2,) a column and a row."""
    first, count, mag, least, *wrap = (int(v) for v in atlas.table[texture])
    size = atlas.levels[first, 1:].astype(np.float64)
    squared = max(float(((change * size) ** 2).sum()) for change in along)
    linear, levels = _FILTERS[least]
    edge = 2.0 if mag == _LINEAR and least in (9984, 9986) else 1.0
    if squared <= edge:
        return _at(atlas, first, at, wrap, linear=mag == _LINEAR)
    if levels == 0:
        return _at(atlas, first, at, wrap, linear=linear == 1)
    lod = min(max(0.5 * math.log2(squared), 0.0), count - 1.0)
    if levels == 1:
        near = max(math.ceil(lod + 0.5) - 1, 0)
        return _at(atlas, first + near, at, wrap, linear=linear == 1)
    low = min(int(lod), count - 1)
    finer = _at(atlas, first + low, at, wrap, linear=linear == 1)
    coarser = _at(atlas, first + min(low + 1, count - 1), at, wrap, linear=linear == 1)
    return finer + (coarser - finer) * (lod - low)


def _at(
    atlas: Atlas, level: int, at: tuple[float, float], wrap: list[int], *, linear: bool
) -> Float64:
    start, width, height = (int(v) for v in atlas.levels[level])
    rows = start + np.arange(height)[:, None] * (width + 2)
    picture = atlas.texels.reshape(-1, 4)[rows + np.arange(width)] / 65535.0
    x, y = at[0] * width, at[1] * height
    if not linear:
        row, column = _index(math.floor(y), height, wrap[1]), _index(math.floor(x), width, wrap[0])
        return np.asarray(picture[row, column])
    x0, y0 = math.floor(x - 0.5), math.floor(y - 0.5)
    total = np.zeros(4)
    for dy in range(2):
        for dx in range(2):
            share = (1.0 - abs(x - 0.5 - x0 - dx)) * (1.0 - abs(y - 0.5 - y0 - dy))
            row, column = _index(y0 + dy, height, wrap[1]), _index(x0 + dx, width, wrap[0])
            total += share * picture[row, column]
    return total


def _index(texel: int, size: int, wrap: int) -> int:
    if wrap == _CLAMP:
        return min(max(texel, 0), size - 1)
    if wrap == _MIRROR:
        turn = texel % (2 * size)
        return min(turn, 2 * size - 1 - turn)
    return texel % size
