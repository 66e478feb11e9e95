"""Textures of the software rasteriser: mipmaps of all in one atlas.

Texels are 16-bit linear light, which represents 8-bit sRGB codes to within 1/130000; textures are
thus decoded once, before filtering. Each level has a border of one texel, filled as its sampler
wraps it, so that the two texels of a row around any position are adjacent in memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.color import transfer
from nlens_video.scene.gltf.textures import LINEAR, NEAREST, Image

Texels = npt.NDArray[np.uint16]
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
            for level in _pyramid(texture):
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


def _pyramid(texture: Image) -> list[Texels]:
    """The picture in linear light and, where the sampler wants them, its halves."""
    codes = np.arange(256) / 255.0
    straight = np.round(codes * 65535.0).astype(np.uint16)
    linear = transfer("iec61966-2-1").to_linear(codes)
    decoded = np.round(linear * 65535.0).astype(np.uint16) if texture.srgb else straight
    level: Texels = np.empty(texture.pixels.shape, np.uint16)
    level[..., :3] = decoded[texture.pixels[..., :3]]
    level[..., 3] = straight[texture.pixels[..., 3]]
    levels: list[Texels] = [level]
    while texture.min_filter not in (NEAREST, LINEAR) and max(level.shape[:2]) > 1:
        height, width = max(1, level.shape[0] // 2), max(1, level.shape[1] // 2)
        half = cv2.resize(level, (width, height), interpolation=cv2.INTER_AREA)
        level = np.asarray(half, np.uint16).reshape(height, width, 4)
        levels.append(level)
    return levels


def _bordered(level: Texels, wrap: tuple[int, int]) -> Texels:
    """A level (h, w, 4) with a border of one wrapped texel (h + 2, w + 2, 4)."""
    for axis, way in ((1, wrap[0]), (0, wrap[1])):
        first, last = level.take([0], axis), level.take([-1], axis)
        around = (first, level, last) if way in (CLAMP, MIRROR) else (last, level, first)
        level = np.concatenate(around, axis)
    return level
