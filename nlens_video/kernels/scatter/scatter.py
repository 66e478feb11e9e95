"""Layered scatter: each pixel of the object spreads over its disc of confusion.

Each row of a disc is a span: its ends go into a difference buffer, and one running sum (prefix sum)
turns them into light. Small discs are stamped pixel by pixel, very large ones drawn at a coarser
level (`levels`). Optical vignetting (cat's eye) leaves the part of each disc that the lens barrel
lets through. Rows of the result are independent: any number of threads gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.scatter.disc import (
    MAX_COC_PX,
    SURPLUS,
    Discs,
    fitted_radius,
    reach,
    tables,
)
from nlens_video.kernels.scatter.extend import lay_out, survey
from nlens_video.kernels.scatter.levels import AXIS, Detail, Level, Rule, make_levels, on_level
from nlens_video.kernels.scatter.normalize import (
    Columns,
    normalise,
    reached_columns,
    wanted_columns,
)
from nlens_video.kernels.scratch import scratch
from nlens_video.kernels.thread_pool import bands, parallel_for
from nlens_video.native import kernels

Spread = Callable[[list[Level], Box, Discs, Columns, float, int | None], Float32]

FINE = Detail(stamps_px=3.0, spans_px=4.0, coarse_px=16.0)
"""Close to the definition (`scatter_ref`): 50 dB and more, but for the rim of a lone highlight's
disc above a CoC of 32 px, which is as soft as a coarse pixel is large."""
DRAFT = Detail(stamps_px=1.5, spans_px=2.0, coarse_px=5.0)
"""As cheap as is acceptable: 36 dB and more against the true lens."""
SKEW_REACH = 7.0 / 6.0
"""How many of its half axes a disc reaches at most when its light is skew [1]."""
BAND_ROWS = 16
"""Rows that a thread takes at a time."""
_SMALL_PX = 4096  # pixels of a level that are done before another thread would have begun


def blur_reach(
    coc_px: Float32,
    alpha: Float32,
    pixel_aspect: float = 1.0,
    *,
    aperture: Aperture = ROUND,
    detail: Detail = FINE,
) -> int:
    """Whole pixels by which the blurred object can exceed its silhouette, the larger of both axes.

    Args:
        coc_px: signed CoC diameter (h, w), read only where `alpha` > 0 [px, columns].
        alpha: coverage by the object (h, w).
        pixel_aspect: width of a pixel by its height, > 0 [1].
        aperture: shape of the discs.
        detail: how finely they are drawn.
    """
    covered = np.where(alpha > 0.0, coc_px, np.float32(0.0))
    largest = float(max(covered.max(initial=0.0), -covered.min(initial=0.0)))
    return _reach(largest, pixel_aspect, _tables(aperture, pixel_aspect, detail), detail)


def _reach(largest_coc_px: float, pixel_aspect: float, discs: Discs, detail: Detail) -> int:
    radius = 0.5 * min(largest_coc_px, MAX_COC_PX)
    across = fitted_radius(radius * max(1.0, pixel_aspect)) if radius > 0.0 else 0.0
    return reach(across * discs.outer_radius) + detail.spread(radius)


def _tables(aperture: Aperture, pixel_aspect: float, detail: Detail) -> Discs:
    return tables(aperture, pixel_aspect, detail.spans_px, detail.largest_px)


def scatter(
    rgba: Float32,
    coc_px: Float32,
    *,
    pixel_aspect: float = 1.0,
    threads: int | None = None,
    aperture: Aperture = ROUND,
    frame: Box | None = None,
    detail: Detail = FINE,
    spread: Spread | None = None,
    wanted: Bool | None = None,
) -> Float32:
    """Blur an object's layer by its own CoC, as a lens does where the object hides none of itself.

    Each pixel spreads over a disc of its CoC (`disc.fitted_radii`: areas of a disc fitted to
    sampled pictures; `scatter_ref.coc_skew`: uneven where the CoC has a slope). Transparent pixels
    do so too, with the CoC of the nearest covered pixel, and the sum is renormalised by all weights
    that arrive. So alpha stays 1 inside and edges are as wide as the disc. CoC 0 leaves a pixel as
    it is; one above `disc.MAX_COC_PX` counts as that.

    Args:
        rgba: premultiplied scene-linear colour and alpha (h, w, 4). Colour where alpha is 0 is
            dropped. Leave `blur_reach` pixels around the object, or its blur is cut off.
        coc_px: signed CoC diameter (h, w), read only where alpha > 0 [px, columns].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: how many threads share the rows at most; default: one a processor.
            The result does not depend on it.
        aperture: shape of the discs, turned by half a turn where the CoC is positive.
        frame: the frame's box, in pixels of the array: what a cat's eye turns around, and where
            the grid of coarser levels starts; default: the array.
        detail: how finely discs are drawn.
        spread: does what `spread_levels` does, perhaps elsewhere; None for that itself.
        wanted: pixels that are needed (h, w), which saves time; pixels of a row before the first
            and past the last of them are 0. None for all.

    Returns:
        The blurred layer (h, w, 4), premultiplied, alpha in [0, 1]; exactly 0 out of reach.

    Raises:
        ValueError: shapes that do not belong together, values that are not finite.
        InputError: the aperture is a picture that cannot be read.
    """
    if rgba.ndim != 3 or rgba.shape[2] != 4 or coc_px.shape != rgba.shape[:2]:
        raise ValueError(f"{rgba.shape = } must be (h, w, 4) and {coc_px.shape = } its (h, w)")
    if not (np.isfinite(pixel_aspect) and pixel_aspect > 0.0):
        raise ValueError(f"{pixel_aspect = } must be a positive number")
    rgba = np.ascontiguousarray(rgba, dtype=np.float32)
    coc_px = np.ascontiguousarray(coc_px, dtype=np.float32)
    silhouette = survey(rgba, coc_px, threads)
    out = np.zeros(rgba.shape, dtype=np.float32)
    bounds = silhouette.bounds
    if bounds.empty:
        return out
    discs = _tables(aperture, pixel_aspect, detail)
    largest = float(silhouette.largest_coc_px.max())
    margin = _reach(largest, pixel_aspect, discs, detail)
    layer = lay_out(rgba, coc_px, bounds, margin, threads)
    whole = Box(0, 0, rgba.shape[1], rgba.shape[0])
    frame = whole if frame is None else frame
    target = bounds.expanded(margin).intersection(whole if wanted is None else Box.of(wanted))
    if target.empty:
        return out
    outer = discs.outer_radius
    radius = 0.5 * min(largest, MAX_COC_PX)
    shape = (pixel_aspect, outer * SKEW_REACH, detail.spread(radius))
    columns = reached_columns(silhouette, shape, layer.box)
    if wanted is not None:
        columns = wanted_columns(columns, wanted, layer.box)
    corner = (layer.box.x0 - frame.x0, layer.box.y0 - frame.y0)
    at = Box(target.x0 - frame.x0, target.y0 - frame.y0, target.x1 - frame.x0, target.y1 - frame.y0)
    fades = (detail.stamps_px, detail.spans_px)
    if aperture.image is not None:
        fades = (4.0 * MAX_COC_PX, 8.0 * MAX_COC_PX)  # stamps all over: a picture has no spans
    rule: Rule = (*fades, outer, SURPLUS, pixel_aspect)
    levels = make_levels(layer, corner, radius, detail, rule, threads)
    rim = outer if aperture.cat_eye > 0.0 else 0.0
    if rim > 0.0:
        for level, n in zip(levels, range(len(levels) - 1, -1, -1), strict=True):
            _vignette_discs(level, 1 << n, aperture, frame, discs, threads)
    sums = (spread or spread_levels)(levels, at, discs, columns, rim, threads)
    origin = (target.y0 - layer.box.y0, target.x0 - layer.box.x0)
    view = out[target.y0 : target.y1, target.x0 : target.x1]
    parallel_for(partial(normalise, sums, columns, origin, view), bands(target.height, 32), threads)
    return out


def _vignette_discs(
    level: Level,
    size: int,
    aperture: Aperture,
    frame: Box,
    discs: Discs,
    threads: int | None,
) -> None:
    """Clip the discs of a level, in place, by the barrel (`shape.barrel_centre`).

    `size` columns of the frame, of which only the size matters, make one of the level's.
    """
    aspect = discs.pixel_aspect
    per_px = -aperture.cat_eye / (0.5 * math.hypot(frame.width * aspect, frame.height))
    place = (
        level.box.x0 * size - 0.5 * frame.width,
        level.box.y0 * size - 0.5 * frame.height,
        float(size),
    )
    work = partial(kernels.vignette_discs, level.light[1], discs, place, (per_px, aspect))
    parallel_for(work, bands(level.box.height, 2 * BAND_ROWS), threads)


def spread_levels(
    levels: list[Level],
    target: Box,
    discs: Discs,
    columns: Columns,
    rim: float,
    threads: int | None,
) -> Float32:
    """Spread all levels, the coarsest first; sums (h, w, 5) of `target`, a box of the frame."""
    sums = np.zeros((0, 0, 5), np.float32)
    start = (0, 0)
    for level, n in zip(levels, range(len(levels) - 1, -1, -1), strict=True):
        size = 1 << n
        here = target
        if n > 0:  # and the pixels beside it that the next finer level interpolates between
            here = on_level(target, n).expanded(2)
            height = level.box.height
            reached = np.zeros(height), np.full(height, float(level.box.width))
        else:
            reached = columns
        inner = here.intersection(level.box)
        made = scratch(f"sums {n}", (here.height, here.width, 5))
        made[:] = 0.0
        view = made[inner.slices_in(here)]
        coarse = (sums, 2 * start[0] - inner.y0, 2 * start[1] - inner.x0)
        origin = (inner.y0 - level.box.y0, inner.x0 - level.box.x0)
        work = partial(
            kernels.scatter_rows,
            level.light,
            level.rows,
            discs,
            reached,
            coarse,
            float(level.light[1][:, AXIS].max()),
            rim,
            view,
            origin,
        )
        small = inner.width * inner.height < _SMALL_PX
        parallel_for(work, bands(inner.height, max(4, BAND_ROWS // size)), 1 if small else threads)
        sums, start = made, (here.y0, here.x0)
    return sums
