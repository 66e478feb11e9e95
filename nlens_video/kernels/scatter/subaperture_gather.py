"""Gather blur of one aperture view over its cell of the aperture, in depth order.

Discs are small, so each pixel gathers from its neighbours: some columns at a time, whose sums stay
in vector registers, from the nearest neighbour to the largest disc around. Defined by
`scatter_ref.gather_subaperture_ref`.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.kernels.scatter.disc import fitted_radius, round_coverage
from nlens_video.kernels.scatter.extend import Int32
from nlens_video.kernels.scratch import scratch
from nlens_video.native import kernels

LARGEST_RADIUS_PX = 8.0
"""Largest radius that is gathered; beyond it a scatter costs less [px]."""
STEPS = 32
"""Entries of a table per pixel of radius."""
_TILE = kernels.GATHERED_COLUMNS  # that share a bound, more than any disc reaches across [px]


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
    return max(_reaches(largest_coc_px, pixel_aspect))


def _reaches(largest_coc_px: float, pixel_aspect: float) -> tuple[int, int]:
    """The same by rows and by columns."""
    entry = math.ceil(0.5 * largest_coc_px * STEPS)
    radius = float(subaperture_table(pixel_aspect)[0, : entry + 1].max())
    return math.ceil((radius + 0.5) * pixel_aspect) - 1, math.ceil(radius + 0.5) - 1


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
    reach = down, across = _reaches(largest, pixel_aspect)
    tiles = -(-target.width // _TILE)
    around = Box(
        target.x0 - across, target.y0 - down,
        target.x0 + tiles * _TILE + across, target.y1 + down,
    )  # fmt: skip
    planes = scratch("cell", (around.height, kernels.GATHERED_PLANES, around.width))
    widest = scratch("cell widest", (around.height, tiles + 2))
    kernels.lay_out(
        np.ascontiguousarray(light, np.float32), np.ascontiguousarray(covered),
        np.ascontiguousarray(coc_px, np.float32), subaperture_table(pixel_aspect), STEPS,
        (around.y0, around.x0, across), planes, widest,
    )  # fmt: skip
    out = np.empty((target.height, target.width, 4), np.float32)
    kernels.gather(planes, widest, reach, *_neighbours(reach, pixel_aspect), out)
    return out


@lru_cache(maxsize=32)
def _neighbours(reach: tuple[int, int], pixel_aspect: float) -> tuple[Int32, Float32]:
    """Rows and columns (n, 2) that a neighbour is away by, and how far (n,), the nearest first."""
    down, across = reach
    y, x = np.mgrid[-down : down + 1, -across : across + 1].reshape(2, -1)
    distance = np.hypot(x, y / pixel_aspect)
    order = np.lexsort((x, y, distance))  # the same, however far they reach
    return np.stack([y, x], 1)[order].astype(np.int32), distance[order].astype(np.float32)
