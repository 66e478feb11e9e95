"""Blur of one view of the lens over its own cell of the aperture: `cell_ref`, made fast.

Discs are small, so each pixel gathers from those around it, many columns at a time.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit

from nlens_video.frames import Bool, Box, Float32, Float64
from nlens_video.kernels.disc import coverage, fitted_radius

LARGEST_RADIUS_PX = 8.0
"""Largest radius that is gathered; beyond it a scatter costs less [px]."""
STEPS = 32
"""Entries of a table per pixel of radius."""
# numba's cache follows changes of this file only, so the kernels' numbers stand here.
_CHUNK = 128  # columns that are gathered at a time, more than any disc reaches [px]
_RADIUS, _SHARE, _COC, _PLANES = 4, 5, 6, 7  # after the four of the light
_NEAR, _WEIGHTS, _BEFORE, _ROOM = 5, 10, 11, 12
_NOWHERE = np.float32(-1e9)


def ramp(distance: Float64, radius: float) -> Float64:
    """How much of a pixel a disc covers, nearly: from 1 to 0 within a pixel of its rim [1].

    Args:
        distance: of the pixel from the disc's middle, any shape [px].
        radius: of the disc [px].
    """
    return np.asarray(np.clip(radius + 0.5 - distance, 0.0, 1.0))


@lru_cache(maxsize=8)
def cell_table(pixel_aspect: float = 1.0) -> Float32:
    """Radius of the ramp, and one by its sum, of the disc of each nominal radius (2, K).

    The ramp is as wide, by its second moment along columns, as `disc.coverage` of the radius that
    suits sampled pictures; `STEPS` entries a pixel up to `LARGEST_RADIUS_PX`.

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
    weights = coverage(radius, radius).sum(axis=0)
    across = np.arange(len(weights)) - len(weights) // 2
    return float(weights @ (across * across))


def _moment_and_sum(radius: float, pixel_aspect: float) -> tuple[float, float]:
    reach = math.ceil((radius + 0.5) * max(1.0, pixel_aspect))
    at = np.arange(-reach, reach + 1)
    weights = ramp(np.hypot(at[None, :], at[:, None] / pixel_aspect), radius)
    return float((weights * at * at).sum() / weights.sum()), float(weights.sum())


def cell_reach(largest_coc_px: float, pixel_aspect: float = 1.0) -> int:
    """Whole pixels by which a blurred view can exceed its silhouette, the larger of both axes.

    Args:
        largest_coc_px: of any covered pixel, at most `2 * LARGEST_RADIUS_PX` [px, columns].
        pixel_aspect: width of a pixel by its height, > 0 [1].
    """
    entry = math.ceil(0.5 * largest_coc_px * STEPS)
    radius = float(cell_table(pixel_aspect)[0, : entry + 1].max())
    return math.ceil((radius + 0.5) * max(1.0, pixel_aspect)) - 1


def blur_cell(
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
    out = np.zeros((target.height, target.width, 4), np.float32)
    reach = cell_reach(largest, pixel_aspect)
    around = target.grown(reach)
    planes = np.empty((around.height, _PLANES, around.width), np.float32)
    widest = np.zeros((around.height, -(-target.width // _CHUNK) + 2), np.float32)
    _lay_out(
        np.ascontiguousarray(light, np.float32), np.ascontiguousarray(covered),
        np.ascontiguousarray(coc_px, np.float32), cell_table(pixel_aspect),
        (around.y0, around.x0, reach), planes, widest,
    )  # fmt: skip
    _gather(planes, widest, reach, 1.0 / pixel_aspect, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_out(
    light: Float32, covered: Bool, coc_px: Float32, table: Float32, place: tuple[int, int, int],
    planes: Float32, widest: Float32,
) -> None:  # fmt: skip
    """Fill in the planes (h, 7, w) around the target: light, radius, share of the sum, CoC.

    Args:
        light: of the view.
        covered: where it is.
        coc_px: of it.
        table: `cell_table`.
        place: row and column of the view at which the planes start, how far discs reach.
        planes: to fill in; where nothing is, it lies behind everything and spreads nothing.
        widest: largest radius of each chunk of a row (h, chunks + 2), one more on each side [px].
    """
    top, left, reach = place
    for y in range(planes.shape[0]):
        row = y + top
        of_row = planes[y]
        for x in range(planes.shape[2]):
            column = x + left
            inside = 0 <= row < covered.shape[0] and 0 <= column < covered.shape[1]
            if not inside or not covered[row, column]:
                for k in range(_COC):
                    of_row[k, x] = 0.0
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
            chunk = (x - reach + _CHUNK) // _CHUNK
            widest[y, chunk] = max(widest[y, chunk], radius)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_from(
    theirs: Float32, start: int, mine: Float32, first: int, distance: np.float32, sums: Float32,
    count: int,
) -> None:  # fmt: skip
    """Add what some of a row's pixels give to as many pixels of another row.

    Args:
        theirs: planes of the row that gives (7, w).
        start: column of it that gives to the first pixel.
        mine: planes of the row of the pixels.
        first: column of the first pixel.
        distance: between the two [px, columns].
        sums: to add to (12, n): light and weight of all, light and weight of what lies before;
            room for two rows of weights.
        count: how many pixels [1].
    """
    stop, last = start + count, first + count
    radii, my_radii = theirs[_RADIUS, start:stop], mine[_RADIUS, first:last]
    shares, my_shares = theirs[_SHARE, start:stop], mine[_SHARE, first:last]
    depths, my_depths = theirs[_COC, start:stop], mine[_COC, first:last]
    weights, before = sums[_WEIGHTS, :count], sums[_BEFORE, :count]
    rim = np.float32(0.5) - distance
    zero, one = np.float32(0.0), np.float32(1.0)
    # Loops of few arrays each: of more the compiler makes no vectors.
    for x in range(count):
        nearer = depths[x] > my_depths[x]
        radius = radii[x] if nearer else my_radii[x]
        share = shares[x] if nearer else my_shares[x]
        weights[x] = min(max(radius + rim, zero), one) * share
    for x in range(count):
        before[x] = weights[x] if depths[x] > my_depths[x] else zero
    for k in range(4):
        light, whole, near = theirs[k, start:stop], sums[k, :count], sums[_NEAR + k, :count]
        for x in range(count):
            whole[x] += weights[x] * light[x]
            near[x] += before[x] * light[x]
    whole, near = sums[4, :count], sums[_NEAR + 4, :count]
    for x in range(count):
        whole[x] += weights[x]
        near[x] += before[x]


@njit(cache=True, nogil=True, error_model="numpy")
def _finish(sums: Float32, depths: Float32, out: Float32) -> None:
    """Lay what lies before some pixels (n, 4) over the rest, seen as far as that leaves room."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for x in range(out.shape[0]):
        near = sums[_NEAR + 4, x]
        behind = zero
        if depths[x] != _NOWHERE:
            behind = max(one - near, zero) / (sums[4, x] - near)
        scale = one / max(near, one)
        for k in range(4):
            before = sums[_NEAR + k, x]
            out[x, k] = scale * before + behind * (sums[k, x] - before)


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(planes: Float32, widest: Float32, reach: int, tall: float, out: Float32) -> None:
    """Fill in the target (H, W, 4).

    Args:
        planes: see `_lay_out`, `reach` pixels larger than the target on each side.
        widest: see there.
        reach: how far discs reach at most [px].
        tall: height of a pixel by its width [1].
        out: to fill in.
    """
    height, width = out.shape[:2]
    sums = np.empty((_ROOM, _CHUNK), np.float32)
    for y in range(height):
        mine = planes[y + reach]
        for first in range(0, width, _CHUNK):
            chunk = first // _CHUNK
            rim = widest[y : y + 2 * reach + 1, chunk : chunk + 3].max() + np.float32(0.5)
            if rim == np.float32(0.5):
                continue
            sums[:] = np.float32(0.0)
            count, at = min(_CHUNK, width - first), first + reach
            for dy in range(-reach, reach + 1):
                theirs = planes[y + reach + dy]
                for dx in range(-reach, reach + 1):
                    distance = np.float32(math.sqrt(dx * dx + dy * dy * tall * tall))
                    if distance < rim:
                        _add_from(theirs, at + dx, mine, at, distance, sums, count)
            _finish(sums, mine[_COC, at : at + count], out[y, first : first + count])
