"""Textures of the software rasteriser: mipmaps of all in one atlas, and their sampling.

Texels are 16-bit linear light, which represents 8-bit sRGB codes to within 1/130000; textures are
thus decoded once, before filtering. Each level has a border of one texel, filled as its sampler
wraps it, so that the two texels of a row around any position are adjacent in memory.

They are sampled as OpenGL 4 defines it (section 8.14), for a run of points at a time. Addresses and
weights are computed for many points at once (vectorised); a loop of its own then reads the texels,
so that no point waits for the memory accesses of the previous one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.color import transfer
from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import (
    exponent,
    f32,
    fastmath_inlined,
    fastmath_kernel,
    floor,
    half_power,
    kernel,
    significand,
    to_f32,
)
from nlens_video.kernels.simd import bilinear4, lane, splat
from nlens_video.render.software import shading_block as at
from nlens_video.render.software.shading_block import Int32
from nlens_video.scene.gltf.textures import LINEAR, NEAREST, Image

Texels = npt.NDArray[np.uint16]
Table = npt.NDArray[np.int64]

# OpenGL's codes, as glTF stores them.
CLAMP, MIRROR = 33071, 33648
Run = tuple[int, int]
"""First point of a block, and one beyond the last."""
Rule = tuple[float, float, float, float, bool, bool, bool]
"""Columns and rows of a texture, its last level, the square of the change from which on it is
shrunk; whether enlarging and shrinking are linear, whether one level serves."""

# Columns of the atlas' table: first level, levels, filters for enlarging and shrinking, wrapping.
_FIRST, _COUNT, _MAG, _MIN, _WRAP_S, _WRAP_T = range(6)
_NEAREST_OF_NEAREST, _LINEAR_OF_NEAREST, _NEAREST_OF_TWO = 9984, 9985, 9986
_U = np.uint64  # of an index: signed ones might count from the end, which prevents vectorising
_ZERO, _HALF, _ONE, _TWO = (f32(v) for v in (0.0, 0.5, 1.0, 2.0))
_FAR, _LEAST = f32(1e6), f32(1e-30)
_ROOT, _OF_ODD = f32(math.sqrt(2.0)), f32(2.0 / math.log(2.0))
_THIRD, _FIFTH, _SEVENTH = f32(1.0 / 3.0), f32(1.0 / 5.0), f32(1.0 / 7.0)


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


@fastmath_inlined
def _log2(value: float) -> float:
    """Of a positive number, to 1e-6: libm's takes one number at a time."""
    part = significand(value)
    large = part > _ROOT
    part = part * _HALF if large else part
    odd = (part - _ONE) / (part + _ONE)  # of the series of the inverse hyperbolic tangent
    square = odd * odd
    series = _ONE + square * (_THIRD + square * (_FIFTH + square * _SEVENTH))
    found: float = exponent(value) + (_ONE if large else _ZERO) + _OF_ODD * odd * series
    return found


@fastmath_inlined
def _wrapped(u: float, wrap: int) -> float:
    """A coordinate as one in [0, 1]; 0 where it is too large to have a fraction."""
    u = u if abs(u) < _FAR else _ZERO
    clamped = u if u > _ZERO else _ZERO
    clamped = clamped if clamped < _ONE else _ONE
    mirrored = abs(u - _TWO * floor(u * _HALF + _HALF))
    mirrored = mirrored if mirrored < _ONE else _ONE
    repeated = u - floor(u)
    return clamped if wrap == CLAMP else (mirrored if wrap == MIRROR else repeated)


@fastmath_kernel
def _choose_levels(block: Float32, run: Run, rule: Rule) -> None:
    """Fill in which level each point of a run reads, and the share of the next."""
    width, height, last, edge, mag, least, single_level = rule
    for i in range(run[0], run[1]):
        ux, vx = block[_U(at.U_ACROSS + i)] * width, block[_U(at.V_ACROSS + i)] * height
        uy, vy = block[_U(at.U_DOWN + i)] * width, block[_U(at.V_DOWN + i)] * height
        across, down = ux * ux + vx * vx, uy * uy + vy * vy
        squared = across if across > down else down
        shrunk = squared > edge
        lod = _HALF * _log2(squared if shrunk else _ONE)
        lod = lod if lod < last else last
        lod = lod if lod > _ZERO else _ZERO
        near = floor(lod + _HALF)
        near = near if near < lod + _HALF else near - _ONE  # a half goes to the larger picture
        level = near if single_level else floor(lod)
        block[_U(at.LEVEL + i)] = level if level > _ZERO else _ZERO
        block[_U(at.NEXT + i)] = _ZERO if single_level else lod - level
        block[_U(at.SMOOTH + i)] = _ONE if (least if shrunk else mag) else _ZERO


@fastmath_kernel
def _choose_texels(
    block: Float32, whole: Int32, run: Run, rule: Rule, wrap: tuple[int, int]
) -> None:
    """Fill in the texels of both levels of each point, and the shares of those beside them."""
    width, height, last = rule[0], rule[1], rule[2]
    for k in range(2):
        for i in range(run[0], run[1]):
            level = block[_U(at.LEVEL + i)] + to_f32(k)
            level = level if level < last else last
            scale = half_power(level)
            columns, rows = floor(width * scale), floor(height * scale)
            columns = columns if columns > _ONE else _ONE
            rows = rows if rows > _ONE else _ONE
            smooth = block[_U(at.SMOOTH + i)]
            x = _wrapped(block[_U(at.U + i)], wrap[0]) * columns - _HALF * smooth
            y = _wrapped(block[_U(at.V + i)], wrap[1]) * rows - _HALF * smooth
            left, top = floor(x), floor(y)
            block[_U(at.ACROSS + k * at.WIDTH + i)] = (x - left) * smooth
            block[_U(at.DOWN + k * at.WIDTH + i)] = (y - top) * smooth
            left = left if left < columns - _ONE + smooth else columns - _ONE
            top = top if top < rows - _ONE + smooth else rows - _ONE
            stride = np.int32(columns) + 2
            whole[_U(at.TEXEL + k * at.WIDTH + i)] = np.int32(top) * stride + np.int32(left)
            whole[_U(at.STRIDE + k * at.WIDTH + i)] = stride


@kernel
def _read(
    block: Float32, whole: Int32, run: Run, texels: Texels, levels: Table, table: tuple[int, int]
) -> None:  # fmt: skip
    """Mix the texels of each point; `table` has the texture's first and last level."""
    for i in range(run[0], run[1]):
        level = table[0] + int(block[at.LEVEL + i])
        here = levels[level, 0] + whole[at.TEXEL + i]
        below = here + whole[at.STRIDE + i]
        rgba = bilinear4(texels, here, below, block[at.ACROSS + i], block[at.DOWN + i])
        part = block[at.NEXT + i]
        if part > _ZERO:
            j = at.WIDTH + i
            here = levels[min(level + 1, table[1]), 0] + whole[at.TEXEL + j]
            below = here + whole[at.STRIDE + j]
            coarser = bilinear4(texels, here, below, block[at.ACROSS + j], block[at.DOWN + j])
            rgba = rgba + (coarser - rgba) * splat(part)
        block[at.TEXEL_R + i], block[at.TEXEL_G + i] = lane(rgba, 0), lane(rgba, 1)
        block[at.TEXEL_B + i], block[at.TEXEL_A + i] = lane(rgba, 2), lane(rgba, 3)


@kernel
def sample_texture(
    block: Float32, whole: Int32, run: Run, atlas: tuple[Texels, Table, Table], texture: int
) -> None:  # fmt: skip
    """Fill in a texture's colours, linear RGBA, at a run of points of a block.

    Their coordinates and the change of these are read, `TEXEL_R` to `TEXEL_A` written; `atlas` is
    texels, levels and table of an `Atlas`.
    """
    texels, levels, table = atlas
    mag, least, base = table[texture, _MAG], table[texture, _MIN], table[texture, _FIRST]
    last = table[texture, _COUNT] - 1
    edge = _ONE
    if mag == LINEAR and (least == _NEAREST_OF_NEAREST or least == _NEAREST_OF_TWO):
        edge = _TWO
    smooth = least == LINEAR or least == _LINEAR_OF_NEAREST or least > _NEAREST_OF_TWO
    one = least == _NEAREST_OF_NEAREST or least == _LINEAR_OF_NEAREST
    rule = (
        to_f32(levels[base, 1]), to_f32(levels[base, 2]), to_f32(last), edge, mag == LINEAR,
        smooth, one,
    )  # fmt: skip
    _choose_levels(block, run, rule)
    _choose_texels(block, whole, run, rule, (table[texture, _WRAP_S], table[texture, _WRAP_T]))
    _read(block, whole, run, texels, levels, (base, base + last))
