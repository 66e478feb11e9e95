"""Deferred shading: each surface visible in a pixel is shaded once; resolve of its depth.

Samples of triangles that share a vertex are one surface: normals and texture coordinates are
continuous across the edge, so one shading serves all of them. At hard edges vertices are split, and
each side is shaded. This keeps meshes finer than the pixels affordable. Depth is that of a pixel's
nearest surface, never a mean of two.
"""

# Kernels of other files are compiled into these, and numba notes changes of this file only. After
# a change there, delete the cache in __pycache__, or edit this file too.
from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import f32, inlined, kernel, kernel_of
from nlens_video.render.software import shading_block as at
from nlens_video.render.software.interpolation import MeshBuffers, PinholeRows
from nlens_video.render.software.layers import light_layers
from nlens_video.render.software.light import light, mirror_surround
from nlens_video.render.software.material_eval import MaterialBuffers, eval_materials
from nlens_video.render.software.raster import NOTHING, SAMPLE_X, SAMPLE_Y
from nlens_video.render.software.shading_block import Block, Int32
from nlens_video.render.software.triangles import FACING, SAMPLES

Lamps = tuple[Float32, int, Float32, Float32 | None]
"""Numbers of the lamps (L, 16), how many have no place, ambient light (9, 4) or (0, 4), and
`Surround.levels`, None where nothing mirrors them."""
ShadingInputs = tuple[MeshBuffers, MaterialBuffers, PinholeRows, Lamps, int | None]
"""The last is None where no material has layers: their kernels are then not compiled."""
BRIGHTEST = f32(60000.0)
"""As much as the OpenGL backend's half floats hold: nothing overflows in the blur."""
_ONE_SURFACE = f32(1.005)  # samples of one surface differ by less, seen from the front
_STEEPER = f32(1.5)


@inlined
def same_surface(mesh: MeshBuffers, one: int, other: int) -> bool:
    """Whether two triangles share a corner and show the same side."""
    faces, planes = mesh[4], mesh[6]
    if planes[one, FACING] != planes[other, FACING]:
        return False
    for i in range(3):
        for j in range(3):
            if faces[one, i] == faces[other, j]:
                return True
    return False


@kernel
def shade(block: Float32, whole: Int32, count: int, scene: ShadingInputs) -> None:
    """Compute the radiance of the first `count` points of a block."""
    mesh, paint, lens, (lamps, suns, ambient, levels), layered = scene
    found = eval_materials(block, whole, count, mesh, paint, lens, layered)
    light(block, lamps, suns, ambient)
    mirror_surround(block, count, ambient, levels)
    if found:
        light_layers(block, whole, count, paint, (lamps, suns, ambient), levels, layered)


@kernel
def _flush(block: Float32, whole: Int32, count: int, scene: ShadingInputs, rgba: Float32) -> None:
    """Shade the points and add their light to the pixels (h * w, 4)."""
    shade(block, whole, count, scene)
    for i in range(count):
        pixel, weight = whole[at.PIXEL + i], block[at.WEIGHT + i]
        rgba[pixel, 0] += weight * min(block[at.RED + i], BRIGHTEST)
        rgba[pixel, 1] += weight * min(block[at.GREEN + i], BRIGHTEST)
        rgba[pixel, 2] += weight * min(block[at.BLUE + i], BRIGHTEST)
        rgba[pixel, 3] += weight


@inlined
def _put(
    block: Float32, whole: Int32, i: int, t: int, pixel: int, place: tuple[float, float, float]
) -> None:
    whole[at.TRIANGLE + i], whole[at.PIXEL + i] = t, pixel
    block[at.X + i], block[at.Y + i] = np.float32(place[0]), np.float32(place[1])
    block[at.WEIGHT + i] = np.float32(place[2])


@inlined
def _edge_pixel(
    block: Float32, whole: Int32, count: int, mesh: MeshBuffers, ids: Int32, passed: Float32,
    where: tuple[int, int, int],
) -> int:  # fmt: skip
    """Points of a pixel that shows several triangles, or less than a whole one; the new count."""
    x, y, width = where
    left = 15
    for s in range(SAMPLES):
        t = ids[SAMPLES * y + s, x]
        if not left >> s & 1 or t == NOTHING:
            continue
        weight, own, px, py = 0.0, 0, 0.0, 0.0
        for other in range(s, SAMPLES):
            u = ids[SAMPLES * y + other, x]
            if not left >> other & 1 or u == NOTHING:
                continue
            if u == t:
                own += 1
                px += SAMPLE_X[other]
                py += SAMPLE_Y[other]
            elif not same_surface(mesh, t, u):
                continue
            weight += passed[SAMPLES * y + other, x] if len(passed) else 1.0
            left &= ~(1 << other)
        place = x + px / own, y + py / own, weight / SAMPLES
        _put(block, whole, count, t, y * width + x, place)
        count += 1
    return count


@kernel
def shade_rows(
    first: int, last: int, width: int, ids: Int32, passed: Float32, scene: ShadingInputs,
    rgba: Float32, block: Block,
) -> None:  # fmt: skip
    """Add the light of the opaque surfaces to rows [first, last) of the picture.

    Args:
        first: first row [px].
        last: one beyond the last row [px].
        width: columns of the picture [px].
        ids: triangle of each sample, as of `raster.fill`.
        passed: share of light that reaches each sample, likewise; (0, 0) for all of it.
        scene: what to shade with.
        rgba: changed: premultiplied linear light (h * width, 4).
        block: from `new_block`.
    """
    mesh, (numbers, whole) = scene[0], block
    count = 0
    for y in range(first, last):
        line = SAMPLES * y
        for x in range(width):
            t = ids[line, x]
            every = t == ids[line + 1, x] and t == ids[line + 2, x] and t == ids[line + 3, x]
            if every and t == NOTHING:
                continue
            if every and not len(passed):
                _put(numbers, whole, count, t, y * width + x, (x + 0.5, y + 0.5, 1.0))
                count += 1
            else:
                count = _edge_pixel(numbers, whole, count, mesh, ids, passed, (x, y, width))
            if count > at.WIDTH - SAMPLES:
                _flush(numbers, whole, count, scene, rgba)
                count = 0
    _flush(numbers, whole, count, scene, rgba)


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
    """Fill in depths (h, w) on rows [first, last), +inf where nothing is [scene unit].

    Where all samples lie on one surface, their mean disparity, which is affine across the screen,
    is that at the pixel's centre. `least` is the disparity of a surface beyond all others, which
    stands for nothing; a sample of 0 shows nothing [1 / scene unit].
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
