"""Gather blur of one aperture view over its cell of the aperture, in depth order.

Discs are small, so each pixel gathers from its neighbours: sixteen columns at a time, whose sums
stay in vector registers, from the nearest neighbour to the largest disc around. Defined by
`scatter_ref.gather_subaperture_ref`.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.kernels.scatter.disc import fitted_radius, round_coverage
from nlens_video.kernels.scatter.extend import Int32
from nlens_video.kernels.simd import load16, select_gt, splat16, store16
from nlens_video.kernels.thread_pool import scratch

LARGEST_RADIUS_PX = 8.0
"""Largest radius that is gathered; beyond it a scatter costs less [px]."""
STEPS = 32
"""Entries of a table per pixel of radius."""
# numba's cache follows changes of this file only, so the kernels' numbers stand here.
_LANES = 16  # columns that are gathered at a time, more than any disc reaches [px]
_RADIUS, _SHARE, _COC, _PLANES = 4, 5, 6, 7  # after the four of the light
_NOWHERE = np.float32(-1e9)
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


def ramp(distance: Float64, radius: float) -> Float64:
    """Approximate coverage of a pixel by a disc: a ramp of one pixel across its rim [1].

    Args:
        distance: of the pixel from the disc's middle, any shape [px].
        radius: of the disc [px].
    """
    return np.asarray(np.clip(radius + 0.5 - distance, 0.0, 1.0))


@lru_cache(maxsize=8)
def subaperture_table(pixel_aspect: float = 1.0) -> Float32:
    """Radius of the ramp, and one by its sum, of the disc of each nominal radius (2, K).

    The ramp is as wide, by its second moment along columns, as `disc.round_coverage` of the radius
    that suits sampled pictures; `STEPS` entries a pixel up to `LARGEST_RADIUS_PX`.

    Args:
        pixel_aspect: width of a pixel by its height, > 0 [1].
    """
    radii = np.linspace(0.5, LARGEST_RADIUS_PX + 1.0, 32 * STEPS)
    moments, sums = np.array([_moment_and_sum(radius, pixel_aspect) for radius in radii]).T
    nominal = np.arange(int(LARGEST_RADIUS_PX * STEPS) + 2) / STEPS
    wanted = np.array([_disc_moment(fitted_radius(radius)) for radius in nominal])
    found = np.interp(wanted, np.maximum.accumulate(moments), radii)
    return np.stack([found, 1.0 / np.interp(found, radii, sums)]).astype(np.float32)


def _disc_moment(radius: float) -> float:
    weights = round_coverage(radius, radius).sum(axis=0)
    across = np.arange(len(weights)) - len(weights) // 2
    return float(weights @ (across * across))


def _moment_and_sum(radius: float, pixel_aspect: float) -> tuple[float, float]:
    reach = math.ceil((radius + 0.5) * max(1.0, pixel_aspect))
    at = np.arange(-reach, reach + 1)
    weights = ramp(np.hypot(at[None, :], at[:, None] / pixel_aspect), radius)
    return float((weights * at * at).sum() / weights.sum()), float(weights.sum())


def subaperture_reach(largest_coc_px: float, pixel_aspect: float = 1.0) -> int:
    """Whole pixels by which a blurred view can exceed its silhouette, the larger of both axes.

    Args:
        largest_coc_px: of any covered pixel, at most `2 * LARGEST_RADIUS_PX` [px, columns].
        pixel_aspect: width of a pixel by its height, > 0 [1].
    """
    entry = math.ceil(0.5 * largest_coc_px * STEPS)
    radius = float(subaperture_table(pixel_aspect)[0, : entry + 1].max())
    return math.ceil((radius + 0.5) * max(1.0, pixel_aspect)) - 1


def gather_subaperture(
    light: Float32, covered: Bool, coc_px: Float32, target: Box, *, pixel_aspect: float = 1.0
) -> Float32:
    """Blur a view over the small discs of its cell, in the order of depth.

    What lies before a pixel spreads onto it, each source over its own disc. Through the rest of
    the pixel's own disc it sees what lies at its depth or behind, itself included: so a sharp edge
    before something blurred stays sharp, a blurred edge is half transparent, and alpha stays 1
    inside.

    Args:
        light: premultiplied colour and alpha (h, w, 4), or any four maps that blur like light.
        covered: where the object is (h, w); light elsewhere is dropped.
        coc_px: signed CoC diameter that the cell makes (h, w), the larger the nearer, read only
            where covered; at most `2 * LARGEST_RADIUS_PX` in size [px, columns].
        target: which pixels are wanted, in pixels of the arrays; may reach beyond them.
        pixel_aspect: width of a pixel by its height, > 0 [1].

    Returns:
        The target's pixels (H, W, 4).

    Raises:
        ValueError: shapes that do not belong together, or a disc that is too large.
    """
    if light.shape != (*coc_px.shape, 4) or covered.shape != coc_px.shape:
        raise ValueError(f"{light.shape = }, {covered.shape = } and {coc_px.shape = } differ")
    largest = float(np.max(np.abs(coc_px), where=covered, initial=0.0))
    if not largest <= 2.0 * LARGEST_RADIUS_PX:
        raise ValueError(f"a CoC of {largest} px; at most {2.0 * LARGEST_RADIUS_PX} is gathered")
    reach = subaperture_reach(largest, pixel_aspect)
    tiles = -(-target.width // _LANES)
    around = Box(
        target.x0 - reach, target.y0 - reach,
        target.x0 + tiles * _LANES + reach, target.y1 + reach,
    )  # fmt: skip
    planes = scratch("cell", (around.height, _PLANES, around.width))
    widest = scratch("cell widest", (around.height, tiles + 2))
    widest[:] = 0.0
    _lay_out(
        np.ascontiguousarray(light, np.float32), np.ascontiguousarray(covered),
        np.ascontiguousarray(coc_px, np.float32), subaperture_table(pixel_aspect),
        (around.y0, around.x0, reach), planes, widest,
    )  # fmt: skip
    out = np.empty((target.height, target.width, 4), np.float32)
    _gather(planes, widest, reach, *_neighbours(reach, pixel_aspect), out)
    return out


@lru_cache(maxsize=32)
def _neighbours(reach: int, pixel_aspect: float) -> tuple[Int32, Float32]:
    """Rows and columns (n, 2) that a neighbour is away by, and how far (n,), the nearest first."""
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    distance = np.hypot(x, y / pixel_aspect)
    order = np.lexsort((x, y, distance))  # the same, however far they reach
    return np.stack([y, x], 1)[order].astype(np.int32), distance[order].astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_out(
    light: Float32, covered: Bool, coc_px: Float32, table: Float32, place: tuple[int, int, int],
    planes: Float32, widest: Float32,
) -> None:  # fmt: skip
    """Fill in the planes (h, 7, w) around the target: light, radius, share of the sum, CoC.

    Where nothing is, it lies behind everything and spreads nothing. `place` is row and column of
    the view at which the planes start, and how far discs reach; `widest` gets the largest radius of
    each tile of a row (h, tiles + 2), one more on each side [px].
    """
    top, left, reach = place
    first = max(0, -left)
    for y in range(planes.shape[0]):
        row = y + top
        of_row = planes[y]
        last = min(planes.shape[2], covered.shape[1] - left)
        if not 0 <= row < covered.shape[0]:
            last = 0
        for x in range(planes.shape[2]):
            column = x + left
            if not first <= x < last or not covered[row, column]:
                for k in range(_COC):
                    of_row[k, x] = _ZERO
                of_row[_COC, x] = _NOWHERE
                continue
            for k in range(4):
                of_row[k, x] = light[row, column, k]
            coc = coc_px[row, column]
            place_in = abs(coc) * np.float32(0.5 * STEPS)
            entry = int(place_in)
            part = place_in - np.float32(entry)
            low = table[0, entry]
            radius = low + part * (table[0, entry + 1] - low)
            low = table[1, entry]
            of_row[_RADIUS, x] = radius
            of_row[_SHARE, x] = low + part * (table[1, entry + 1] - low)
            of_row[_COC, x] = coc
            tile = (x - reach + _LANES) // _LANES
            widest[y, tile] = max(widest[y, tile], radius)


@njit(cache=True, nogil=True, error_model="numpy")
def _rim(widest: Float32, y: int, rows: int, tile: int) -> np.float32:
    """How far discs reach that may touch a tile, 0 where there are none [px]."""
    found = _ZERO
    for row in range(y, y + rows):
        for beside in range(tile, tile + 3):
            found = max(found, widest[row, beside])
    return found + _HALF if found > _ZERO else _ZERO


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(
    planes: Float32, widest: Float32, reach: int, places: Int32, distances: Float32, out: Float32
) -> None:
    """Fill in the target (H, W, 4) from planes that are `reach` pixels larger on each side.

    `planes` and `widest` are those of `_lay_out`, `places` and `distances` those of `_neighbours`.
    """
    height, width = out.shape[:2]
    stride = planes.shape[2]
    zero, one = splat16(_ZERO), splat16(_ONE)
    of_tile = np.empty((4, _LANES), np.float32)
    for y in range(height):
        for first in range(0, width, _LANES):
            rim = _rim(widest, y, 2 * reach + 1, first // _LANES)
            here = (y + reach) * _PLANES * stride + first + reach
            mine = load16(planes, here + _COC * stride)
            my_radius = load16(planes, here + _RADIUS * stride) + splat16(_HALF)
            my_share = load16(planes, here + _SHARE * stride)
            r = g = b = a = weights = zero  # of all
            near_r = near_g = near_b = near_a = near = zero  # of what lies before
            for k in range(distances.shape[0]):
                if distances[k] >= rim:
                    break
                away = splat16(distances[k])
                there = here + places[k, 0] * _PLANES * stride + places[k, 1]
                coc = load16(planes, there + _COC * stride)
                radius = load16(planes, there + _RADIUS * stride) + splat16(_HALF)
                share = load16(planes, there + _SHARE * stride)
                covered = select_gt(coc, mine, radius, my_radius) - away
                covered = select_gt(covered, zero, covered, zero)
                weight = select_gt(covered, one, one, covered) * select_gt(
                    coc, mine, share, my_share
                )
                before = select_gt(coc, mine, weight, zero)
                light = load16(planes, there)
                r, near_r = r + weight * light, near_r + before * light
                light = load16(planes, there + stride)
                g, near_g = g + weight * light, near_g + before * light
                light = load16(planes, there + 2 * stride)
                b, near_b = b + weight * light, near_b + before * light
                light = load16(planes, there + 3 * stride)
                a, near_a = a + weight * light, near_a + before * light
                weights, near = weights + weight, near + before
            # What lies before is laid over the rest, seen as far as that leaves room.
            room = select_gt(one, near, one - near, zero)
            rest = weights - near
            behind = select_gt(rest, zero, room / select_gt(rest, zero, rest, one), zero)
            behind = select_gt(mine, splat16(_NOWHERE), behind, zero)
            scale = one / select_gt(near, one, near, one)
            store16(of_tile, 0, scale * near_r + behind * (r - near_r))
            store16(of_tile, _LANES, scale * near_g + behind * (g - near_g))
            store16(of_tile, 2 * _LANES, scale * near_b + behind * (b - near_b))
            store16(of_tile, 3 * _LANES, scale * near_a + behind * (a - near_a))
            for x in range(min(_LANES, width - first)):
                for c in range(4):
                    out[y, first + x, c] = of_tile[c, x]
