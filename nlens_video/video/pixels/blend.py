"""Compiled kernels that decode samples to light and composite over them, with tabulated curves.

`blend_ref` defines the results.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.thread_pool import Band, parallel_for, picture_bands
from nlens_video.native import kernels
from nlens_video.video.pixels.samples import Axis, Plane, Samples, display_table, tables

_AS_LIGHT = np.empty(0, np.float32)  # a table from light to codes, in place of one


@lru_cache(maxsize=64)
def _axis(axis: Axis) -> tuple[int, int, int, Float32]:
    return axis.step, axis.phase, axis.first, np.array(axis.weights, np.float32)


def _decoder(samples: Samples, to_display: Float32) -> Callable[[int, int, Float32], None]:
    """Decodes the pixels from a column and row on [px] into an array (h, w, 3).

    What the samples have in common is looked up once for many boxes.
    """
    maps = tables(samples.coding)
    axes = _axis(samples.across), _axis(samples.down)

    def decode(x: int, y: int, out: Float32) -> None:
        kernels.linear(
            samples.planes, axes, (y, x), maps.rgb_from_codes, maps.to_linear, maps.to_bt709,
            to_display, out,
        )  # fmt: skip

    return decode


def _decoded(samples: Samples, box: Box, to_display: Float32) -> Float32:
    decode = _decoder(samples, to_display)
    out = np.empty((box.height, box.width, 3), np.float32)

    def decode_band(band: Band) -> None:
        decode(box.x0, box.y0 + band[0], out[slice(*band)])

    parallel_for(decode_band, picture_bands(box.height, box.width))
    return out


def linear(samples: Samples, box: Box) -> Float32:
    """Scene-linear BT.709 RGB (h, w, 3) of a box inside the frame."""
    return _decoded(samples, box, _AS_LIGHT)


def patches(samples: Samples, corners: Sequence[tuple[int, int]], side: int) -> Float32:
    """Scene-linear BT.709 RGB (N, side, side, 3) of squares whose top left pixels are given."""
    decode = _decoder(samples, _AS_LIGHT)
    out = np.empty((len(corners), side, side, 3), np.float32)
    for (x, y), patch in zip(corners, out, strict=True):
        decode(x, y, patch)
    return out


def downsample(samples: Samples, width: int, height: int) -> Float32:
    """Scene-linear BT.709 RGB (height, width, 3), each of the mean of nine codes of its cell."""
    maps = tables(samples.coding)
    out = np.empty((height, width, 3), np.float32)
    kernels.downsample(samples.planes, maps.rgb_from_codes, maps.to_linear, maps.to_bt709, out)
    return out


def srgb(samples: Samples, box: Box) -> Float32:
    """Display-coded sRGB in [0, 1] (h, w, 3) of a box inside the frame."""
    return _decoded(samples, box, display_table())


def composite_over(samples: Samples, box: Box, rgba: Float32, *, of_plate: bool = False) -> None:
    """Composite a premultiplied scene-linear BT.709 layer (h, w, 4) over a box inside the frame.

    With `of_plate` its colours are multiples of the plate's own light.
    """
    if box.empty:
        return
    maps = tables(samples.coding)
    first = samples.planes[0]
    rows, columns = slice(box.y0, box.y1), slice(box.x0, box.x1)
    alpha: Plane = np.empty((0, 0), first.dtype) if samples.alpha is None else samples.alpha
    before = tuple(np.array(one[rows, columns], order="C") for one in (first, alpha))
    axes = _axis(samples.across), _axis(samples.down)
    layer = np.ascontiguousarray(rgba, dtype=np.float32)
    coding = (
        maps.to_linear, maps.to_coded, maps.rgb_from_codes, maps.codes_from_rgb, maps.from_bt709,
        maps.to_bt709,
    )  # fmt: skip
    down = samples.down
    top = (box.y0 + down.phase) // down.step
    coarse = (box.y1 - 1 + down.phase) // down.step + 1 - top

    def composite(band: Band) -> None:
        kernels.composite_over(
            samples.planes, alpha, (samples.associated, of_plate), before, axes,
            (box.y0, box.x0), layer, coding, samples.coding.peak, (top + band[0], top + band[1]),
        )  # fmt: skip

    parallel_for(composite, picture_bands(coarse, box.width * down.step))
