"""Alpha-tested (MASK) and blended (BLEND) triangles, pixel by pixel.

Blending runs from near to far: each sample stores its remaining transmittance only, no colour.
"""

# Kernels of other files are compiled into these, and numba notes changes of this file only. After
# a change there, delete the cache in __pycache__, or edit this file too.
from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.numba_config import f32, inlined, kernel, to_f32
from nlens_video.render.software import shading_block as at
from nlens_video.render.software.deferred import BRIGHTEST, ShadingInputs, shade
from nlens_video.render.software.interpolation import MeshBuffers, interpolate
from nlens_video.render.software.material_eval import MaterialBuffers, base_colors, same_material
from nlens_video.render.software.raster import SAMPLE_X, SAMPLE_Y, covered
from nlens_video.render.software.shading_block import Block, Int32
from nlens_video.render.software.triangles import SAMPLES, Shape, disparity_at

_CUTOFF = 7  # of a material's numbers
_FLAT = f32(1e-4)
_HALF, _ZERO, _ONE = f32(0.5), f32(0.0), f32(1.0)
_PATTERNS = (0, 1, 9, 11, 15)  # samples of a pixel that is covered by so many quarters
Runs = tuple[tuple[int, int], tuple[int, int], tuple[int, int], tuple[int, int]]
Where = tuple[int, int, int]
"""Triangle, column, row."""
OnScreen = tuple[Shape, Int32]


@kernel
def _runs(shape: Shape, t: int, y: int, width: int) -> Runs:
    line = SAMPLES * y
    return (
        covered(shape, t, line, width), covered(shape, t, line + 1, width),
        covered(shape, t, line + 2, width), covered(shape, t, line + 3, width),
    )  # fmt: skip


@kernel
def _meeting(runs: Runs, x: int) -> tuple[int, float, float]:
    """Samples of pixel `x` within the runs, and their centroid in the pixel."""
    mask, count, px, py = 0, 0, 0.0, 0.0
    for s in range(SAMPLES):
        if runs[s][0] <= x < runs[s][1]:
            mask |= 1 << s
            count += 1
            px += SAMPLE_X[s]
            py += SAMPLE_Y[s]
    return (mask, px / count, py / count) if count else (0, 0.0, 0.0)


@inlined
def _ends(runs: Runs) -> tuple[int, int]:
    first, last = 1 << 30, 0
    for s in range(SAMPLES):
        if runs[s][0] < runs[s][1]:
            first, last = min(first, runs[s][0]), max(last, runs[s][1])
    return first, last


@kernel
def _kept(block: Float32, i: int, cutoff: float) -> int:
    """Samples that the cutoff leaves, sharpened to one pixel around it.

    The alphas at the point, a column on and a row on are those of points `i` to `i + 2`.
    """
    here = block[at.ALPHA + i]
    slope = abs(block[at.ALPHA + i + 1] - here) + abs(block[at.ALPHA + i + 2] - here)
    over = here - cutoff
    share = min(max(over / slope + _HALF, _ZERO), _ONE) if slope > _FLAT else (
        _ONE if over >= _ZERO else _ZERO
    )  # fmt: skip
    return _PATTERNS[int(share * SAMPLES + 0.5)]


@kernel
def _cut(
    block: Float32, whole: Int32, count: int, width: int, mesh: MeshBuffers, paint: MaterialBuffers,
    most: Float32, disparity: Float32, ids: Int32,
) -> None:  # fmt: skip
    """Draw the masked points of a block, three for each, in order."""
    interpolate(block, whole, count, mesh)
    first = 0
    while first < count:
        run = same_material(whole, first, count)
        first = run[1]
        base_colors(block, whole, run, paint)
    for i in range(0, count, 3):
        pixel, t = whole[at.PIXEL + i], whole[at.TRIANGLE + i]
        y, x = pixel // width, pixel % width
        mask = whole[at.MASK + i] & _kept(block, i, paint[0][mesh[5][t], _CUTOFF])
        for s in range(SAMPLES):
            if mask >> s & 1:
                d = disparity_at(mesh[6], t, x + SAMPLE_X[s], y + SAMPLE_Y[s])
                if len(most) and d > most[y, x]:
                    continue
                if d >= disparity[SAMPLES * y + s, x]:
                    disparity[SAMPLES * y + s, x] = d
                    ids[SAMPLES * y + s, x] = t


@kernel
def cut_out(
    drawn: Int32, rows: tuple[int, int], width: int, on_screen: OnScreen, mesh: MeshBuffers,
    paint: MaterialBuffers, most: Float32, disparity: Float32, ids: Int32, block: Block,
) -> None:  # fmt: skip
    """Draw masked triangles on rows [first, last), as `raster.fill` draws opaque ones.

    `most` (h, w) limits the disparity, (0, 0) does not; `block` is from `new_block`.
    """
    (numbers, whole), (shape, spans), count = block, on_screen, 0
    for n in range(len(drawn)):
        t = drawn[n]
        for y in range(max(rows[0], spans[t, 0] >> 2), min(rows[1] - 1, spans[t, 1] >> 2) + 1):
            runs = _runs(shape, t, y, width)
            left, right = _ends(runs)
            for x in range(left, right):
                mask, px, py = _meeting(runs, x)
                if not mask:
                    continue
                for k in range(3):  # here, a column on, a row on
                    whole[at.TRIANGLE + count + k] = t
                    numbers[at.X + count + k] = to_f32(x + px + (k == 1))
                    numbers[at.Y + count + k] = to_f32(y + py + (k == 2))
                whole[at.PIXEL + count], whole[at.MASK + count] = y * width + x, mask
                count += 3
                if count > at.WIDTH - 3:
                    _cut(numbers, whole, count, width, mesh, paint, most, disparity, ids)
                    count = 0
    _cut(numbers, whole, count, width, mesh, paint, most, disparity, ids)


@kernel
def _lay_under(
    block: Float32, whole: Int32, count: int, width: int, scene: ShadingInputs,
    passed: Float32, front: Float32, rgba: Float32,
) -> None:  # fmt: skip
    """Shade the points of a block and lay them, in order, under what lies before them."""
    for i in range(count):
        block[at.HIDDEN + i] = _ONE  # less where light goes through
    shade(block, whole, count, scene)
    planes = scene[0][6]
    for i in range(count):
        alpha = block[at.ALPHA + i]
        if not alpha > _ZERO:
            continue
        pixel, t = whole[at.PIXEL + i], whole[at.TRIANGLE + i]
        y, x = pixel // width, pixel % width
        weight = _ZERO
        for s in range(SAMPLES):
            if whole[at.MASK + i] >> s & 1:
                line = SAMPLES * y + s
                weight += passed[line, x]
                passed[line, x] *= _ONE - alpha * block[at.HIDDEN + i]
                d = disparity_at(planes, t, x + SAMPLE_X[s], y + SAMPLE_Y[s])
                front[line, x] = max(front[line, x], d)
        weight *= alpha / np.float32(SAMPLES)
        rgba[pixel, 0] += weight * min(block[at.RED + i], BRIGHTEST)
        rgba[pixel, 1] += weight * min(block[at.GREEN + i], BRIGHTEST)
        rgba[pixel, 2] += weight * min(block[at.BLUE + i], BRIGHTEST)
        rgba[pixel, 3] += weight * block[at.HIDDEN + i]


@inlined
def _seen(planes: Float32, where: Where, mask: int, disparity: Float32) -> int:
    """Those samples of a mask that no opaque surface hides."""
    t, x, y = where
    for s in range(SAMPLES):
        if mask >> s & 1:
            d = disparity_at(planes, t, x + SAMPLE_X[s], y + SAMPLE_Y[s])
            if d < disparity[SAMPLES * y + s, x]:
                mask &= ~(1 << s)
    return mask


@kernel
def blend(
    drawn: Int32, rows: tuple[int, int], width: int, on_screen: OnScreen, scene: ShadingInputs,
    disparity: Float32, passed: Float32, front: Float32, rgba: Float32, block: Block,
) -> None:  # fmt: skip
    """Add the light of blended triangles to rows [first, last) of the picture.

    Args:
        drawn: the triangles, from near to far.
        rows: first row, and one beyond the last [px].
        width: columns of the picture [px].
        on_screen: the triangles on the screen, and first and last line of samples of each (F, 2).
        scene: what to shade with.
        disparity: of the opaque surface at each sample [1 / scene unit], as of `raster.fill`.
        passed: changed: share of light that gets through to each sample, likewise.
        front: changed: disparity of the nearest surface at each sample, likewise.
        rgba: changed: premultiplied linear light (h * width, 4).
        block: from `new_block`.
    """
    (numbers, whole), (shape, spans), mesh, count = block, on_screen, scene[0], 0
    for n in range(len(drawn)):
        t = drawn[n]
        for y in range(max(rows[0], spans[t, 0] >> 2), min(rows[1] - 1, spans[t, 1] >> 2) + 1):
            runs = _runs(shape, t, y, width)
            left, right = _ends(runs)
            for x in range(left, right):
                mask, px, py = _meeting(runs, x)
                mask = _seen(mesh[6], (t, x, y), mask, disparity)
                if not mask:
                    continue
                whole[at.TRIANGLE + count], whole[at.PIXEL + count] = t, y * width + x
                whole[at.MASK + count] = mask
                numbers[at.X + count], numbers[at.Y + count] = to_f32(x + px), to_f32(y + py)
                count += 1
                if count == at.WIDTH:
                    _lay_under(numbers, whole, count, width, scene, passed, front, rgba)
                    count = 0
    _lay_under(numbers, whole, count, width, scene, passed, front, rgba)
