"""Compiled kernels that decode samples to light and composite over them, with tabulated curves.

`blend_ref` defines the results.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numba
import numpy as np

from nlens_video.core.layers import Box, Float32
from nlens_video.video.pixels.samples import Axis, Plane, Samples, display_table, tables

# numba's cache on disk depends on this file alone: constants imported from `samples` would become
# stale, so they are repeated here; a test compares both
STEPS_BITS, FIRST_OCTAVE = 7, -40
_SHIFT = 23 - STEPS_BITS
_FIRST_PIECE = (127 + FIRST_OCTAVE) << STEPS_BITS
_SMALLEST = np.float32(2.0**FIRST_OCTAVE)
_MASK = np.int32((1 << _SHIFT) - 1)
_FRACTION = np.float32(2.0**-_SHIFT)
SIDE = 3  # samples across and down of a mean; with 2, pans are measured half as precisely
_inline = numba.njit(inline="always")


# numba infers the types of the kernels' arguments
@_inline
def _look_up(table, value):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """A table at a value of any sign: the float's exponent and mantissa are the position."""
    size = abs(value)
    if size < _SMALLEST:
        result = table[0] + (table[1] - table[0]) * (size / _SMALLEST)
    else:
        bits = np.float32(size).view(np.int32)
        piece = min((bits >> _SHIFT) - _FIRST_PIECE + 1, table.shape[0] - 2)
        low = table[piece]
        result = low + (table[piece + 1] - low) * (np.float32(bits & _MASK) * _FRACTION)
    return result if value >= 0 else -result


@_inline
def _dot(matrix, row, a, b, c):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return matrix[row, 0] * a + matrix[row, 1] * b + matrix[row, 2] * c


def _linear(planes, axes, corner, rgb_from_codes, to_linear, to_bt709, to_display, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill `out` (h, w, 3); `to_display` is a table from light to codes, or empty."""
    first, second, third = planes
    across, down = axes
    display = to_display.shape[0] > 0
    rgb = np.empty(3, np.float32)
    for i in range(out.shape[0]):
        y = corner[0] + i
        row = (y + down[1]) // down[0]
        for j in range(out.shape[1]):
            x = corner[1] + j
            column = (x + across[1]) // across[0]
            a = np.float32(first[y, x])
            b = np.float32(second[row, column])
            c = np.float32(third[row, column])
            for k in range(3):
                coded = _dot(rgb_from_codes, k, a, b, c) + rgb_from_codes[k, 3]
                rgb[k] = _look_up(to_linear, coded)
            for k in range(3):
                value = _dot(to_bt709, k, rgb[0], rgb[1], rgb[2])
                if display:
                    value = _look_up(to_display, min(max(value, np.float32(0)), np.float32(1)))
                out[i, j, k] = value


@_inline
def _mean(plane, rows, columns, i, j):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    total = np.float32(0)
    for p in range(SIDE * i, SIDE * (i + 1)):
        row = rows[p]
        for q in range(SIDE * j, SIDE * (j + 1)):
            total += np.float32(plane[row, columns[q]])
    return total / np.float32(SIDE * SIDE)


def _downsample(planes, rgb_from_codes, to_linear, to_bt709, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """`blend_ref.downsample`, into `out` (h, w, 3)."""
    first, second, third = planes
    picked_rows, picked_columns = SIDE * out.shape[0], SIDE * out.shape[1]
    below, across = np.arange(picked_rows), np.arange(picked_columns)
    rows = (2 * below + 1) * first.shape[0] // (2 * picked_rows)
    columns = (2 * across + 1) * first.shape[1] // (2 * picked_columns)
    coarse_rows = (2 * below + 1) * second.shape[0] // (2 * picked_rows)
    coarse_columns = (2 * across + 1) * second.shape[1] // (2 * picked_columns)
    rgb = np.empty(3, np.float32)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            a = _mean(first, rows, columns, i, j)
            b = _mean(second, coarse_rows, coarse_columns, i, j)
            c = _mean(third, coarse_rows, coarse_columns, i, j)
            for k in range(3):
                coded = _dot(rgb_from_codes, k, a, b, c) + rgb_from_codes[k, 3]
                rgb[k] = _look_up(to_linear, coded)
            for k in range(3):
                out[i, j, k] = _dot(to_bt709, k, rgb[0], rgb[1], rgb[2])


@_inline
def _put(plane, y, x, value, peak):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if peak > 0:
        value = np.floor(min(max(value, np.float32(0)), peak) + np.float32(0.5))
    plane[y, x] = value


# one function: passing an array from kernel to kernel for each pixel updates its reference count,
# which takes longer than the blend
def _composite_over(planes, alpha, flags, before, axes, corner, rgba, tables, peak):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, C901, PLR0915
    """`blend_ref.composite_over`; `before` holds first component and alpha of the box before it."""
    first, second, third = planes
    luma_before, alpha_before = before
    associated, of_plate = flags
    across, down = axes
    to_linear, to_coded, rgb_from_codes, codes_from_rgb, from_bt709, to_bt709 = tables
    height, width = first.shape
    h, w = rgba.shape[:2]
    y0, x0 = corner
    has_alpha = alpha.shape[0] > 0
    full = peak if peak > 0 else np.float32(1)
    zero, one = np.float32(0), np.float32(1)
    change, plate = np.empty(3, np.float32), np.empty(3, np.float32)
    behind, own = np.empty(3, np.float32), np.empty(3, np.float32)
    for row in range((y0 + down[1]) // down[0], (y0 + h - 1 + down[1]) // down[0] + 1):
        top = row * down[0] - down[1]
        for column in range(
            (x0 + across[1]) // across[0], (x0 + w - 1 + across[1]) // across[0] + 1
        ):
            left = column * across[0] - across[1]
            touched = False
            for y in range(max(top, y0), min(top + down[0], y0 + h)):
                for x in range(max(left, x0), min(left + across[0], x0 + w)):
                    v = rgba[y - y0, x - x0]
                    touched |= v[3] != 0 or v[0] != 0 or v[1] != 0 or v[2] != 0
            if not touched:
                continue
            b, c = np.float32(second[row, column]), np.float32(third[row, column])
            total, change_b, change_c = zero, zero, zero
            for p in range(down[3].shape[0]):
                y = top + down[2] + p
                if y < 0 or y >= height:
                    continue
                for q in range(across[3].shape[0]):
                    x = left + across[2] + q
                    if x < 0 or x >= width:
                        continue
                    weight = down[3][p] * across[3][q]
                    total += weight
                    if y < y0 or y >= y0 + h or x < x0 or x >= x0 + w:
                        continue
                    v = rgba[y - y0, x - x0]
                    if v[3] == 0 and v[0] == 0 and v[1] == 0 and v[2] == 0:
                        continue
                    a = np.float32(luma_before[y - y0, x - x0])
                    plate_alpha = one
                    if has_alpha:
                        plate_alpha = np.float32(alpha_before[y - y0, x - x0]) / full
                    free = one - v[3]
                    gain = one
                    if not associated:
                        free *= plate_alpha
                        covered = v[3] + free
                        gain = one / covered if covered > 0 else one
                    for k in range(3):
                        own[k] = v[k]
                        plate[k] = _dot(rgb_from_codes, k, a, b, c) + rgb_from_codes[k, 3]
                        behind[k] = zero
                        if free != 0 or of_plate:
                            behind[k] = _look_up(to_linear, plate[k])
                    if of_plate:
                        for k in range(3):
                            own[k] *= _dot(to_bt709, k, behind[0], behind[1], behind[2])
                    for k in range(3):
                        light = _dot(from_bt709, k, own[0], own[1], own[2]) + free * behind[k]
                        coded = _look_up(to_coded, light * gain)
                        if peak > 0:
                            coded = min(max(coded, min(plate[k], zero)), max(plate[k], one))
                        change[k] = coded - plate[k]
                    change_b += weight * _dot(codes_from_rgb, 1, change[0], change[1], change[2])
                    change_c += weight * _dot(codes_from_rgb, 2, change[0], change[1], change[2])
                    if top <= y < top + down[0] and left <= x < left + across[0]:
                        delta = _dot(codes_from_rgb, 0, change[0], change[1], change[2])
                        _put(first, y, x, a + delta, peak)
                        if has_alpha:
                            bare = (one - v[3]) * (one - plate_alpha)
                            _put(alpha, y, x, (one - bare) * full, peak)
            _put(second, row, column, b + change_b / total, peak)
            _put(third, row, column, c + change_c / total, peak)


@cache
def _compiled(function: Callable[..., None], dtype: str) -> Callable[..., None]:
    """The kernel for one type of samples; strides are free, so that one serves all layouts."""
    kind = {"uint8": "u1", "uint16": "u2", "float32": "f4"}[dtype]
    plane, row, matrix, image = f"{kind}[:,:]", "f4[::1]", "f4[:,::1]", "f4[:,:,::1]"
    planes, axes = f"UniTuple({plane},3)", f"UniTuple(Tuple((i8,i8,i8,{row})),2)"
    head, corner = f"{planes},", f"{axes},UniTuple(i8,2)"
    if function is _linear:
        signature = f"void({head}{corner},{matrix},{row},{matrix},{row},{image})"
    elif function is _downsample:
        signature = f"void({head}{matrix},{row},{matrix},{image})"
    else:
        maps = f"Tuple(({row},{row},{matrix},{matrix},{matrix},{matrix}))"
        before = f"UniTuple({kind}[:,::1],2)"
        signature = f"void({head}{plane},UniTuple(b1,2),{before},{corner},{image},{maps},f4)"
    compiled: Callable[..., None] = numba.njit(signature, cache=True, nogil=True)(function)
    return compiled


def _axis(axis: Axis) -> tuple[int, int, int, Float32]:
    return axis.step, axis.phase, axis.first, np.array(axis.weights, np.float32)


def _decoded(samples: Samples, box: Box, to_display: Float32) -> Float32:
    maps = tables(samples.coding)
    out = np.empty((box.height, box.width, 3), np.float32)
    _compiled(_linear, samples.planes[0].dtype.name)(
        samples.planes, (_axis(samples.across), _axis(samples.down)), (box.y0, box.x0),
        maps.rgb_from_codes, maps.to_linear, maps.to_bt709, to_display, out,
    )  # fmt: skip
    return out


def linear(samples: Samples, box: Box) -> Float32:
    """Scene-linear BT.709 RGB (h, w, 3) of a box inside the frame."""
    return _decoded(samples, box, np.empty(0, np.float32))


def downsample(samples: Samples, width: int, height: int) -> Float32:
    """Scene-linear BT.709 RGB (height, width, 3), each of the mean of nine codes of its cell."""
    maps = tables(samples.coding)
    out = np.empty((height, width, 3), np.float32)
    _compiled(_downsample, samples.planes[0].dtype.name)(
        samples.planes, maps.rgb_from_codes, maps.to_linear, maps.to_bt709, out
    )
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
    _compiled(_composite_over, first.dtype.name)(
        samples.planes, alpha, (samples.associated, of_plate), before,
        (_axis(samples.across), _axis(samples.down)), (box.y0, box.x0),
        np.ascontiguousarray(rgba, dtype=np.float32),
        (
            maps.to_linear, maps.to_coded, maps.rgb_from_codes, maps.codes_from_rgb,
            maps.from_bt709, maps.to_bt709,
        ),
        samples.coding.peak,
    )  # fmt: skip
