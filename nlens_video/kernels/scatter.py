"""Layered scatter: each pixel of the object spreads over its disc of confusion.

A large disc is added row by row as a span, into a difference buffer as wide as one row, which one
running sum turns into light; a small one pixel by pixel. Rows of the result do not depend on each
other, so any number of threads gives the same bits.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from nlens_video.frames import Float32
from nlens_video.kernels.disc import (
    FADE_START,
    FADE_STOP,
    SPAN_STEPS,
    STAMP_STEPS,
    fitted_radii,
    tables,
)
from nlens_video.kernels.extend import SourceLayer, blur_reach, prepare
from nlens_video.kernels.pool import share
from nlens_video.kernels.scatter_rows import Pixels, Rows, reached_columns, scatter_rows

__all__ = ["blur_reach", "scatter"]

BAND_ROWS = 8
"""Rows that a thread takes at a time."""


def _pixels(layer: SourceLayer, pixel_aspect: float) -> Pixels:
    """Lay out a layer for the loops."""
    radius = np.maximum(layer.radius_px, FADE_START).astype(np.float64)
    rx, ry = fitted_radii(radius), fitted_radii(radius * pixel_aspect)
    as_spans = np.minimum((radius - FADE_START) / (FADE_STOP - FADE_START), 1.0)
    density = (as_spans / (math.pi * rx * ry)).astype(np.float32)
    return layer.rgba, layer.radius_px, rx.astype(np.float32), density, layer.skew


def _rows(radius_px: Float32, pixel_aspect: float) -> Rows:
    """How far each row of pixels reaches, and which of its columns take part."""
    takes_part = radius_px >= 0.0
    largest = np.maximum(radius_px.max(axis=1), 0.0)
    least = np.min(radius_px, axis=1, where=takes_part, initial=np.inf)
    reaches = fitted_radii(largest.astype(np.float64) * pixel_aspect) - 0.5
    reaches = np.maximum(np.ceil(reaches), 0.0)
    reaches[~takes_part.any(axis=1)] = -1.0
    last = takes_part.shape[1] - 1 - takes_part[:, ::-1].argmax(axis=1)
    return reaches.astype(np.intp), takes_part.argmax(axis=1), last, least, largest


def scatter(
    rgba: Float32, coc_px: Float32, *, pixel_aspect: float = 1.0, threads: int | None = None
) -> Float32:
    """Blur an object's layer by its own CoC, as a lens does where the object hides none of itself.

    Each pixel spreads over a disc of its CoC (`disc.fitted_radii`: areas of a disc fitted to
    sampled pictures; `extend.coc_skew`: uneven where the CoC has a slope). Transparent pixels do so
    too, with the CoC of the nearest covered pixel, and the sum is renormalised by all weights that
    arrive. So alpha stays 1 inside and edges are as wide as the disc. CoC 0 leaves a pixel as it
    is; one above `disc.MAX_COC_PX` counts as that.

    Args:
        rgba: premultiplied scene-linear colour and alpha (h, w, 4). Colour where alpha is 0 is
            dropped. Leave `blur_reach` pixels around the object, or its blur is cut off.
        coc_px: signed CoC diameter (h, w), read only where alpha > 0; only its size matters
            [px, columns].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: how many threads share the rows at most; default: one a processor.
            The result does not depend on it.

    Returns:
        The blurred layer (h, w, 4), premultiplied, alpha in [0, 1]; exactly 0 out of reach.

    Raises:
        ValueError: shapes that do not belong together, values that are not finite.
    """
    layer = prepare(rgba, coc_px, pixel_aspect)
    out = np.zeros(rgba.shape, dtype=np.float32)
    if layer is None:
        return out
    stamps, chords = tables(float(layer.radius_px.max()), pixel_aspect)
    target = layer.target
    view = out[target.y0 : target.y1, target.x0 : target.x1]
    origin = (target.y0 - layer.box.y0, target.x0 - layer.box.x0)
    tops = range(0, target.height, BAND_ROWS)
    bands = [(top, min(top + BAND_ROWS, target.height)) for top in tops]
    scatter_band = partial(
        scatter_rows,
        _pixels(layer, pixel_aspect),
        _rows(layer.radius_px, pixel_aspect),
        reached_columns(layer.rgba[..., 3] > 0.0, layer.radius_px, pixel_aspect),
        (stamps, chords, pixel_aspect, FADE_START, FADE_STOP, STAMP_STEPS, SPAN_STEPS),
        view,
        origin,
    )
    share(scatter_band, bands, threads)
    return out
