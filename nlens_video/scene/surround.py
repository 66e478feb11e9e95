"""The light from around as smooth surfaces mirror it: maps filtered by the width of highlights.

The sum over the lobe is split from the reflectance, as Karis does ("Real Shading in Unreal Engine
4", 2013): `Surround.levels` is the first of the two factors, for four roughnesses. Directions are
folded onto an octahedron (Cigolle et al. 2014), whose square is looked up without trigonometry.
"""

from __future__ import annotations

import math
from functools import cached_property

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.thread_pool import bands

SIDE = 128
"""Texels of a level along each side, without the border of one that joins the folded edges."""
LEVELS = 4
ROUGHEST = 0.6
"""Roughness of the last level; the first is a mirror, those between are as far apart [1]."""
# Of each level after the first: texels along a side, and columns of the map that it is made from.
# The wider the lobe, the fewer tell all of it.
_FILTERED = ((40, 96), (36, 64), (28, 48))
_MIRROR_COLUMNS = 256
_AT_ONCE = 1 << 16  # products of directions that stay in a processor's cache
_LEAST_ALPHA = 0.002
_REDUCED_ROWS = 16  # of the result at a time, where each is made of whole rows


class Surround(Struct, frozen=True, eq=False, dict=True):
    """Radiance around the object, but for what lamps stand for.

    Attributes:
        radiance: equirectangular, scene-linear (h, w, 3), w = 2 h; the middle column looks along
            +X, row 0 straight up.
        turn: about the up axis, as of `load_environment` [rad].
        gain: factor on the radiance, of all channels or of each (3,) [1].
        unscaled: the one that this is a multiple of, whose filtered maps it uses; None for none.
    """

    radiance: Float32
    turn: float = 0.0
    gain: float | Float64 = 1.0
    unscaled: Surround | None = None

    def scaled(self, gain: float | Float64) -> Surround:
        """So many times as bright, in all channels or in each (3,).

        The maps are filtered once for both.
        """
        return replace(self, gain=gain * self.gain, unscaled=self.unscaled or self)

    @cached_property
    def levels(self) -> Float32:
        """The filtered maps (LEVELS, SIDE + 2, SIDE + 2, 4), the last channel 0."""
        out = (self.unscaled or self)._filtered_maps.copy()
        out[..., :3] *= self.gain  # in place: stays float32 by a gain of NumPy, as kernels take it
        return out

    @cached_property
    def _filtered_maps(self) -> Float32:
        """The maps of `levels` by a gain of 1."""
        out = np.zeros((LEVELS, SIDE + 2, SIDE + 2, 4), np.float32)
        directions = _texels(SIDE)
        out[0, ..., :3] = self._seen(reduced(self.radiance, _MIRROR_COLUMNS), directions)
        for level, (side, columns) in enumerate(_FILTERED, start=1):
            small = self._filtered(side, columns, ROUGHEST * level / (LEVELS - 1))
            x, y = (_unfolded(directions, side) - 0.5).transpose(2, 0, 1).astype(np.float32)
            out[level, ..., :3] = cv2.remap(small, x, y, cv2.INTER_LINEAR)
        return out

    def _seen(self, radiance: Float32, directions: Float64) -> Float32:
        """What a map shows in directions (..., 3)."""
        rows, columns = radiance.shape[:2]
        across = (np.arctan2(directions[..., 2], directions[..., 0]) + self.turn) / (2.0 * math.pi)
        x = (across + 0.5) % 1.0 * columns + 0.5  # one column is joined to either edge
        y = (0.5 - np.arcsin(np.clip(directions[..., 1], -1.0, 1.0)) / math.pi) * rows - 0.5
        joined = np.concatenate([radiance[:, -1:], radiance, radiance[:, :1]], axis=1)
        return np.asarray(
            cv2.remap(
                joined, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
        )  # fmt: skip

    def _filtered(self, side: int, columns: int, roughness: float) -> Float32:
        """What surfaces of a roughness mirror, seen head on (side + 2, side + 2, 3)."""
        small = reduced(self.radiance, columns)
        directions, solid = (
            one.reshape(small.shape[0] * small.shape[1], -1)
            for one in sphere(small.shape[1], self.turn)
        )
        light = np.concatenate([small.reshape(-1, 3), np.ones_like(solid)], axis=1)
        weighted = np.asarray(light * solid, dtype=np.float32)
        slope = np.float32(0.5 * (max(roughness * roughness, _LEAST_ALPHA) ** 2 - 1.0))
        sources = np.ascontiguousarray(directions.T, dtype=np.float32)
        targets = _texels(side).reshape(-1, 3).astype(np.float32)
        parts = []
        for some in np.array_split(targets, max(1, len(targets) * len(solid) // _AT_ONCE)):
            cosine = some @ sources
            np.maximum(cosine, 0.0, out=cosine)
            # Trowbridge and Reitz's microfacets; the one that mirrors halves the angle, and the
            # square of its cosine is 0.5 + 0.5 * cosine. In place, which is several times quicker.
            spread = cosine * slope
            spread += slope + np.float32(1.0)
            spread *= spread
            cosine /= spread
            parts.append(cosine @ weighted)
        found = np.concatenate(parts)
        mean = found[:, :3] / np.maximum(found[:, 3:], np.float32(1e-20))
        return np.ascontiguousarray(mean.reshape(side + 2, side + 2, 3), dtype=np.float32)


def _texels(side: int) -> Float64:
    """Directions (side + 2, side + 2, 3) of a level's texels, with its border."""
    place = (np.arange(side + 2) - 0.5) / side * 2.0 - 1.0
    x, z = np.meshgrid(place, place)
    # beyond an edge of the square the octahedron goes on, turned over
    wide, deep = np.abs(x) > 1.0, np.abs(z) > 1.0
    x, z = np.where(wide, np.copysign(2.0, x) - x, x), np.where(deep, np.copysign(2.0, z) - z, z)
    x, z = np.where(deep, -x, x), np.where(wide, -z, z)
    y = 1.0 - np.abs(x) - np.abs(z)
    low = y < 0.0
    folded = np.copysign(1.0 - np.abs(z), x), np.copysign(1.0 - np.abs(x), z)
    found = np.stack([np.where(low, folded[0], x), y, np.where(low, folded[1], z)], axis=-1)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def _unfolded(directions: Float64, side: int) -> Float64:
    """Columns and rows (..., 2) of directions (..., 3) on a level with its border [texel]."""
    x, y, z = np.moveaxis(directions / np.abs(directions).sum(axis=-1, keepdims=True), -1, 0)
    low = y < 0.0
    u = np.where(low, np.copysign(1.0 - np.abs(z), x), x)
    v = np.where(low, np.copysign(1.0 - np.abs(x), z), z)
    return np.stack([u, v], axis=-1) * (0.5 * side) + (0.5 * side + 1.0)


def mirrored_light(levels: Float32, direction: Float64, roughness: float) -> Float64:
    """Light (3,) that a surface of a roughness up to the last level's mirrors from a direction.

    Definition of what the renderers look up, in float64; bilinear within a level.
    """
    column, row = _unfolded(direction, levels.shape[1] - 2) - 0.5
    left, top = int(column), int(row)
    across, down = column - left, row - top
    place = min(roughness / ROUGHEST, 1.0) * (len(levels) - 1)
    finer = min(int(place), len(levels) - 2)
    share = place - finer
    level = (1.0 - share) * levels[finer].astype(np.float64) + share * levels[finer + 1]
    upper = (1.0 - across) * level[top, left] + across * level[top, left + 1]
    lower = (1.0 - across) * level[top + 1, left] + across * level[top + 1, left + 1]
    return np.asarray(((1.0 - down) * upper + down * lower)[:3])


def sphere(columns: int, turn: float = 0.0) -> tuple[Float64, Float64]:
    """Directions (h, w, 3) and solid angles (h, w) [sr] of the pixels of an equirectangular map.

    The middle column looks along +X, row 0 straight up.

    Args:
        columns: w, even; h is half of it [px].
        turn: about the up axis, counter-clockwise seen from above [rad].
    """
    rows = columns // 2
    up = math.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    round_ = 2.0 * math.pi * ((np.arange(columns) + 0.5) / columns - 0.5)[None] - turn
    x, z = np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_)
    directions = np.stack([x, np.broadcast_to(np.sin(up), x.shape), z], axis=-1)
    area = heights_of_rows(rows) * (2.0 * math.pi / columns)
    return directions, np.repeat(area[:, None], columns, axis=1)


def heights_of_rows(rows: int) -> Float64:
    """Height of the zone of the unit sphere that each row of a map covers (rows,)."""
    edges = np.sin(math.pi * (0.5 - np.arange(rows + 1) / rows))
    return np.asarray(edges[:-1] - edges[1:])


def reduced(radiance: Float32, columns: int) -> Float32:
    """An equirectangular map with at most so many columns, and all its light.

    Rows are averaged by the part of the sphere that each of them covers.

    Args:
        radiance: (h, w, 3), w = 2 h.
        columns: even [px].
    """
    height, width = radiance.shape[:2]
    columns = min(columns, width)
    rows = max(columns // 2, 1)
    covered = heights_of_rows(height).astype(np.float32)[:, None]
    whole = np.empty((rows, columns, 3), np.float32)
    for top, end in bands(rows, rows if height % rows or width % columns else _REDUCED_ROWS):
        part = slice(top * height // rows, end * height // rows)
        weighted = radiance[part] * covered[part, :, None]
        size = columns, end - top
        whole[top:end] = cv2.resize(weighted, size, interpolation=cv2.INTER_AREA).reshape(
            end - top, columns, 3
        )
    shares = cv2.resize(covered, (1, rows), interpolation=cv2.INTER_AREA).reshape(rows, 1, 1)
    return np.asarray(whole / shares, dtype=np.float32)
