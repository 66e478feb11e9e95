"""Textures of the software rasteriser: mipmaps of all in one atlas.

Each level has a border of one texel, filled as its sampler wraps it, so that the two texels of a
row around any position are adjacent in memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.render.base.mipmaps import Texels, level_sizes, write_mipmaps
from nlens_video.scene.gltf.textures import Image

Table = npt.NDArray[np.int64]

# OpenGL's codes, as glTF stores them.
CLAMP, MIRROR = 33071, 33648


class Atlas(Struct, frozen=True, eq=False):
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
        """Decode textures and build their mipmaps.

        Pictures are released as soon as their levels exist, but for those whose alpha is also read
        by what casts shadows.
        """
        sizes = [level_sizes(texture) for texture in textures]
        counts = [(width + 2) * (height + 2) for one in sizes for height, width in one]
        starts = np.cumsum([1, *counts])
        texels: Texels = np.empty((starts[-1], 4), np.uint16)
        texels[0] = 0
        levels: list[tuple[int, int, int]] = []
        table: list[tuple[int, ...]] = []
        uses = Counter(texture.picture for texture in textures)
        kept = {texture.picture for texture in textures if texture.cutoff is not None}
        for texture, own in zip(textures, sizes, strict=True):
            first = len(levels)
            places: list[Texels] = []
            for number, (height, width) in enumerate(own, start=first):
                levels.append((int(starts[number]) + width + 3, width, height))
                place = texels[starts[number] : starts[number + 1]]
                places.append(place.reshape(height + 2, width + 2, 4))
            write_mipmaps(texture, [place[1:-1, 1:-1] for place in places])
            for place in places:
                _write_border(place, texture.wrap)
            uses[texture.picture] -= 1
            if not uses[texture.picture] and texture.picture not in kept:
                texture.picture.release()
            row = (first, len(own), texture.mag_filter, texture.min_filter)
            table.append((*row, *texture.wrap))
        return cls(
            texels.ravel(),
            np.array(levels, np.int64).reshape(-1, 3),
            np.array(table, np.int64).reshape(-1, 6),
        )


def _write_border(place: Texels, wrap: tuple[int, int]) -> None:
    """Fill the border of one texel around a level (h + 2, w + 2, 4), as its sampler wraps it."""
    for across, way in ((place.swapaxes(0, 1), wrap[0]), (place, wrap[1])):
        near, far = (1, -2) if way in (CLAMP, MIRROR) else (-2, 1)
        across[0], across[-1] = across[near], across[far]
