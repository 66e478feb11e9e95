"""Compiled kernels that decode samples to light and composite over them, with tabulated curves.

`blend_ref` defines the results.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.thread_pool import Band, parallel_for, picture_bands
from nlens_video.native import kernels
from nlens_video.video.pixels.samples import Axis, Plane, Samples, display_tables, tables

_AS_LIGHT = np.empty(0, np.float32)  # a table from light to codes, in place of one


@lru_cache(maxsize=64)
def _axis(axis: Axis) -> tuple[int, int, int, Float32]:
    return axis.step, axis.phase, axis.first, np.array(axis.weights, np.float32)


def _decoded(
    samples: Samples, box: Box, to_display: Float32, to_linear: Float32 | None = None
) -> Float32:
    maps = tables(samples.coding)
    to_linear = maps.to_linear if to_linear is None else to_linear
    axes = _axis(samples.across), _axis(samples.down)
    out = np.empty((box.height, box.width, 3), np.float32)

    def decode(band: Band) -> None:
        kernels.linear(
            samples.planes, axes, (box.y0 + band[0], box.x0), maps.rgb_from_codes, to_linear,
            maps.to_bt709, to_display, out[slice(*band)],
        )  # fmt: skip

    parallel_for(decode, picture_bands(box.height, box.width))
    return out


def linear(samples: Samples, box: Box) -> Float32:
    """Scene-linear BT.709 RGB (h, w, 3) of a box inside the frame."""
    return _decoded(samples, box, _AS_LIGHT)


def green_patches(samples: Samples, corners: Sequence[tuple[int, int]], side: int) -> Float32:
    """Scene-linear BT.709 green (N, side, side) of squares whose top left pixels are given."""
    maps = tables(samples.coding)
    out = np.empty((len(corners), side, side), np.float32)
    kernels.green_patches(
        samples.planes, (_axis(samples.across), _axis(samples.down)),
        np.array(corners, np.int32).reshape(-1, 2), maps.rgb_from_codes, maps.to_linear,
        maps.to_bt709, out,
    )  # fmt: skip
    return out


def downsample(samples: Samples, width: int, height: int) -> Float32:
    """Scene-linear BT.709 RGB (height, width, 3), each of the mean of nine codes of its cell."""
    maps = tables(samples.coding)
    out = np.empty((height, width, 3), np.float32)
    kernels.downsample(samples.planes, maps.rgb_from_codes, maps.to_linear, maps.to_bt709, out)
    return out


def srgb(samples: Samples) -> Float32:
    """Display-coded sRGB in [0, 1] of the whole frame (H, W, 3)."""
    return _decoded(samples, _frame(samples), display_tables()[1])


def shown(samples: Samples) -> Float32:
    """The whole frame as players show it (H, W, 3), in [0, 1]."""
    to_linear, to_display = display_tables()
    as_coded = is_shown_as_coded(samples.coding.tags.transfer)
    return _decoded(samples, _frame(samples), to_display, to_linear if as_coded else None)


def is_shown_as_coded(transfer: str) -> bool:
    """Whether players take codes of a transfer function for those of sRGB.

    They do not convert between the curves of video and of sRGB, but HDR and linear light to it.
    """
    return transfer not in ("linear", "smpte2084", "arib-std-b67")


def _frame(samples: Samples) -> Box:
    height, width = samples.planes[0].shape
    return Box(0, 0, width, height)


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
