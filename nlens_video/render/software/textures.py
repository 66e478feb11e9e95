"""Textures of the software rasteriser: mipmaps of all in one atlas.

Each level has a border of one texel, filled as its sampler wraps it, so that the two texels of a
row around any position are adjacent in memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlens_video.render.base.mipmaps import Texels, mipmaps
from nlens_video.scene.gltf.textures import Image

Table = npt.NDArray[np.int64]

# OpenGL's codes, as glTF stores them.
CLAMP, MIRROR = 33071, 33648


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """All textures of a scene.

    Attributes:
        texels: of all levels of all textures, RGBA, flat (4 n,).
        levels: texel of row 0 and column 0, columns and rows of each level (L, 3); a row lies
            two texels more than its columns after the one before.
        table: first level, count of levels, two filters, two wraps of each texture (T, 6).
    """

    texels: Texels
    levels: Table
    table: Table

    @classmethod
    def of(cls, textures: Sequence[Image]) -> Atlas:
        """Decode textures and build their mipmaps."""
        parts, size = [np.zeros(4, np.uint16)], 1
        levels: list[tuple[int, int, int]] = []
        table: list[tuple[int, ...]] = []
        for texture in textures:
            first = len(levels)
            for level in mipmaps(texture):
                height, width = level.shape[:2]
                levels.append((size + width + 3, width, height))
                parts.append(_bordered(level, texture.wrap).ravel())
                size += (width + 2) * (height + 2)
            row = (first, len(levels) - first, texture.mag_filter, texture.min_filter)
            table.append((*row, *texture.wrap))
        return cls(
            np.concatenate(parts),
            np.array(levels, np.int64).reshape(-1, 3),
            np.array(table, np.int64).reshape(-1, 6),
        )


def _bordered(level: Texels, wrap: tuple[int, int]) -> Texels:
    """A level (h, w, 4) with a border of one wrapped texel (h + 2, w + 2, 4)."""
    for axis, way in ((1, wrap[0]), (0, wrap[1])):
        first, last = level.take([0], axis), level.take([-1], axis)
        around = (first, level, last) if way in (CLAMP, MIRROR) else (last, level, first)
        level = np.concatenate(around, axis)
    return level
