"""Textures as the software rasteriser samples them: trilinear, in linear light.

Texels are 16-bit linear light, which holds 8-bit sRGB codes to 1/130000: so decoding comes before
filtering and costs nothing while drawing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from nlens_video.color import transfer
from nlens_video.kernels.compiled import floor, inlined, narrow, single, truncated

Texels = npt.NDArray[np.uint16]
Table = npt.NDArray[np.int64]
Rgba = tuple[float, float, float, float]

# OpenGL's codes, as glTF stores them.
NEAREST, LINEAR = 9728, 9729
_NEAREST_OF_NEAREST, _LINEAR_OF_NEAREST, _NEAREST_OF_TWO = 9984, 9985, 9986
_CLAMP, _MIRROR = 33071, 33648
_ZERO, _HALF, _ONE, _TWO = (single(v) for v in (0.0, 0.5, 1.0, 2.0))
_FAR = single(1e6)
# Columns of the table: first level, levels, filters for enlarging and shrinking, wrapping.
_FIRST, _COUNT, _MAG, _MIN, _WRAP_S, _WRAP_T = range(6)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Texture:
    """One picture and its sampler.

    Attributes:
        pixels: straight RGBA (H, W, 4), 8 bit.
        srgb: whether RGB is sRGB-coded.
        mag_filter: OpenGL's code.
        min_filter: OpenGL's code.
        wrap: OpenGL's codes along u and v.
    """

    pixels: npt.NDArray[np.uint8]
    srgb: bool
    mag_filter: int
    min_filter: int
    wrap: tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """All textures of a scene.

    Attributes:
        texels: of all levels of all textures, RGBA, flat (4 n,).
        levels: first texel, columns and rows of each level (L, 3).
        table: first level, count of levels, two filters, two wraps of each texture (T, 6).
    """

    texels: Texels
    levels: Table
    table: Table

    @classmethod
    def of(cls, textures: Sequence[Texture]) -> Atlas:
        """Decode textures and make their smaller levels."""
        parts, size = [np.zeros(4, np.uint16)], 1
        levels: list[tuple[int, int, int]] = []
        table: list[tuple[int, ...]] = []
        for texture in textures:
            first = len(levels)
            for level in _pyramid(texture):
                height, width = level.shape[:2]
                levels.append((size, width, height))
                parts.append(level.ravel())
                size += width * height
            row = (first, len(levels) - first, texture.mag_filter, texture.min_filter)
            table.append((*row, *texture.wrap))
        return cls(
            np.concatenate(parts),
            np.array(levels, np.int64).reshape(-1, 3),
            np.array(table, np.int64).reshape(-1, 6),
        )


def _pyramid(texture: Texture) -> list[Texels]:
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


_Generator = tuple[Any, Callable[..., Any]]
_CODES, _FLOATS = ir.VectorType(ir.IntType(16), 4), ir.VectorType(ir.FloatType(), 4)


@intrinsic
def _blend(
    _: Any, texels: Any, a: Any, b: Any, c: Any, d: Any, across: Any, down: Any  # noqa: ANN401
) -> _Generator:  # fmt: skip
    """Compile: mix texels a, b of one row by `across`, c, d of the next, then both by `down`."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:  # noqa: ANN401
        data = context.make_array(signature.args[0])(context, builder, given[0]).data

        def texel(index: Any) -> Any:  # noqa: ANN401
            at = builder.gep(data, [builder.shl(index, index.type(2))])
            codes = builder.load(builder.bitcast(at, _CODES.as_pointer()), align=2)
            return builder.uitofp(codes, _FLOATS)

        def mixed(one: Any, other: Any, part: Any) -> Any:  # noqa: ANN401
            single = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), part, _INT(0))
            parts = builder.shuffle_vector(single, single, ir.Constant(_ORDER, [0] * 4))
            return builder.fadd(one, builder.fmul(builder.fsub(other, one), parts))

        upper = mixed(texel(given[1]), texel(given[2]), given[5])
        lower = mixed(texel(given[3]), texel(given[4]), given[5])
        both = mixed(upper, lower, given[6])
        scale = ir.Constant(_FLOATS, [1.0 / 65535.0] * 4)
        both = builder.fmul(both, scale)
        channels = [builder.extract_element(both, _INT(k)) for k in range(4)]
        return context.make_tuple(builder, signature.return_type, channels)

    kinds = (types.intp,) * 4 + (types.float32,) * 2
    rgba: Any = types.Tuple
    return rgba((types.float32,) * 4)(texels, *kinds), generate


_mixed: Any = _blend
_INT, _ORDER = ir.IntType(32), ir.VectorType(ir.IntType(32), 4)


@inlined
def _wrapped(u: float, wrap: int) -> float:
    """A coordinate as one in [0, 1]."""
    if wrap == _CLAMP:
        return min(max(u, _ZERO), _ONE)
    if wrap == _MIRROR:
        return min(abs(u - _TWO * floor(u * _HALF + _HALF)), _ONE)
    return u - floor(u)


@inlined
def _neighbours(u: float, size: int, wrap: int) -> tuple[int, int, float]:
    """The two texels beside a coordinate in [0, 1], and the second one's share."""
    x = u * narrow(size) - _HALF
    below = floor(x)
    low = truncated(below)
    high = low + 1
    if wrap == _CLAMP or wrap == _MIRROR:
        return max(low, 0), min(high, size - 1), x - below
    return (size - 1 if low < 0 else low), (0 if high >= size else high), x - below


@inlined
def _level(
    atlas: tuple[Texels, Table, Table], row: int, at: tuple[float, float], wrap: tuple[int, int]
) -> Rgba:
    """A level, bilinear; `at` in [0, 1]."""
    texels, levels, _ = atlas
    start, width, height = levels[row, 0], levels[row, 1], levels[row, 2]
    x0, x1, across = _neighbours(at[0], width, wrap[0])
    y0, y1, down = _neighbours(at[1], height, wrap[1])
    upper, lower = start + y0 * width, start + y1 * width
    mixed: Rgba = _mixed(texels, upper + x0, upper + x1, lower + x0, lower + x1, across, down)
    return mixed


@inlined
def _nearest(atlas: tuple[Texels, Table, Table], row: int, at: tuple[float, float]) -> Rgba:
    """The nearest texel of a level; `at` in [0, 1]."""
    texels, levels, _ = atlas
    start, width, height = levels[row, 0], levels[row, 1], levels[row, 2]
    x = min(truncated(at[0] * narrow(width)), width - 1)
    y = min(truncated(at[1] * narrow(height)), height - 1)
    here = start + y * width + x
    mixed: Rgba = _mixed(texels, here, here, here, here, _ZERO, _ZERO)
    return mixed


@inlined
def _filtered(
    atlas: tuple[Texels, Table, Table], row: int, at: tuple[float, float], wrap: tuple[int, int],
    linear: bool,  # noqa: FBT001
) -> Rgba:  # fmt: skip
    return _level(atlas, row, at, wrap) if linear else _nearest(atlas, row, at)


@inlined
def sample(
    atlas: tuple[Texels, Table, Table], texture: int,
    at: tuple[float, float], along_x: tuple[float, float], along_y: tuple[float, float],
) -> Rgba:  # fmt: skip
    """A texture's colour, linear RGBA, as OpenGL 4 filters it (specification, section 8.14).

    Args:
        atlas: texels, levels and table of an `Atlas`.
        texture: which texture.
        at: coordinates u and v.
        along_x: their change from a pixel to the next column.
        along_y: their change to the next row.
    """
    _, levels, table = atlas
    u, v = at
    if not (abs(u) < _FAR and abs(v) < _FAR):  # nothing is left of the fraction
        u, v = _ZERO, _ZERO
    wrap = table[texture, _WRAP_S], table[texture, _WRAP_T]
    inside = _wrapped(u, wrap[0]), _wrapped(v, wrap[1])
    mag, least, base = table[texture, _MAG], table[texture, _MIN], table[texture, _FIRST]
    width, height = narrow(levels[base, 1]), narrow(levels[base, 2])
    ux, vx, uy, vy = (
        along_x[0] * width,
        along_x[1] * height,
        along_y[0] * width,
        along_y[1] * height,
    )
    squared = max(ux * ux + vx * vx, uy * uy + vy * vy)
    edge = _ONE
    if mag == LINEAR and (least == _NEAREST_OF_NEAREST or least == _NEAREST_OF_TWO):
        edge = _TWO
    if not squared > edge:
        return _filtered(atlas, base, inside, wrap, mag == LINEAR)
    linear = least == LINEAR or least == _LINEAR_OF_NEAREST or least > _NEAREST_OF_TWO
    last = table[texture, _COUNT] - 1
    lod = min(_HALF * narrow(math.log2(squared)), narrow(last))
    if least == _NEAREST_OF_NEAREST or least == _LINEAR_OF_NEAREST or last == 0:
        near = truncated(math.ceil(lod + _HALF)) - 1
        return _filtered(atlas, base + max(near, 0), inside, wrap, linear)
    lod = max(lod, _ZERO)
    first = truncated(lod)
    part = lod - narrow(first)
    r, g, b, a = _filtered(atlas, base + first, inside, wrap, linear)
    q = _filtered(atlas, base + min(first + 1, last), inside, wrap, linear)
    return (
        r + (q[0] - r) * part, g + (q[1] - g) * part, b + (q[2] - b) * part, a + (q[3] - a) * part
    )  # fmt: skip
