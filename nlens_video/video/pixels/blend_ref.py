"""NumPy reference of `blend`: decodes samples to light and composites over them."""

from __future__ import annotations

from copy import deepcopy

import numpy as np

from nlens_video.core.color import primaries_from_bt709, transfer
from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.video.pixels.samples import (
    Axis,
    Coding,
    Plane,
    Samples,
)


def linear(samples: Samples, box: Box) -> Float64:
    """Scene-linear BT.709 RGB (h, w, 3) of a box inside the frame; chroma is not interpolated."""
    out = np.empty((box.height, box.width, 3))
    to_linear = transfer(samples.coding.tags.transfer).to_linear
    back = np.linalg.inv(primaries_from_bt709(samples.coding.tags.primaries))
    for y in range(box.y0, box.y1):
        for x in range(box.x0, box.x1):
            coded = _rgb(samples.coding, _codes(samples, x, y, _cell(samples, x, y)))
            out[y - box.y0, x - box.x0] = back @ to_linear(coded)
    return out


def downsample(samples: Samples, width: int, height: int) -> Float64:
    """Scene-linear BT.709 RGB (height, width, 3), each of the mean of nine codes of its cell.

    They lie in the middle of its thirds, across and down.
    """
    out = np.empty((height, width, 3))
    to_linear = transfer(samples.coding.tags.transfer).to_linear
    back = np.linalg.inv(primaries_from_bt709(samples.coding.tags.primaries))
    for i in range(height):
        for j in range(width):
            codes = []
            for plane in samples.planes:
                rows = [int((6 * i + part) * plane.shape[0] / (6 * height)) for part in (1, 3, 5)]
                columns = [int((6 * j + part) * plane.shape[1] / (6 * width)) for part in (1, 3, 5)]
                codes.append(_finite(plane[np.ix_(rows, columns)].astype(np.float64)).mean())
            out[i, j] = back @ to_linear(_rgb(samples.coding, np.array(codes)))
    return out


def composite_over(samples: Samples, box: Box, rgba: Float32, *, of_plate: bool = False) -> None:
    """Composite a premultiplied scene-linear BT.709 layer (h, w, 4) over a box inside the frame.

    A chroma sample changes by the filtered change of the codes of the pixels under its filter, all
    of them composited over that sample's own chroma: an opaque layer replaces it completely. It
    stays where the layer does not touch its cell. With `of_plate` the layer's colours are multiples
    of the plate's own light; where they and alpha are so small that integer codes change by less
    than half a step, the layer counts as empty.
    """
    old = deepcopy(samples)
    touched = set()
    for y in range(box.y0, box.y1):
        for x in range(box.x0, box.x1):
            layer = rgba[y - box.y0, x - box.x0].astype(np.float64)
            if _is_empty(layer, old.coding, of_plate=of_plate):
                continue
            cell = _cell(samples, x, y)
            touched.add(cell)
            change = _change(old, (x, y), cell, layer, of_plate=of_plate)
            _put(samples.planes[0], y, x, change[0], samples.coding)
            if samples.alpha is not None and old.alpha is not None:
                full = samples.coding.peak or 1.0
                free = (1.0 - layer[3]) * (1.0 - old.alpha[y, x] / full)
                rise = (1.0 - free) * full - float(old.alpha[y, x])
                _put(samples.alpha, y, x, rise, samples.coding)
    for row, column in touched:
        change = _filtered(old, box, rgba, (row, column), of_plate=of_plate)
        for plane, delta in zip(samples.planes[1:], change, strict=True):
            _put(plane, row, column, delta, samples.coding)


def _filtered(
    old: Samples, box: Box, rgba: Float32, cell: tuple[int, int], *, of_plate: bool
) -> Float64:
    """Change (2,) of the chroma codes of one cell."""
    height, width = old.planes[0].shape
    total, change = 0.0, np.zeros(2)
    for y, down in _taps(old.down, cell[0], height):
        for x, across in _taps(old.across, cell[1], width):
            total += down * across
            if box.x0 <= x < box.x1 and box.y0 <= y < box.y1:
                layer = rgba[y - box.y0, x - box.x0].astype(np.float64)
                if not _is_empty(layer, old.coding, of_plate=of_plate):
                    own = _change(old, (x, y), cell, layer, of_plate=of_plate)
                    change += down * across * own[1:]
    return change / total


def _is_empty(layer: Float64, coding: Coding, *, of_plate: bool) -> bool:
    """Whether a pixel of a layer (4,) leaves the plate as it is."""
    if of_plate and coding.peak:  # a code changes by no larger share than the light
        return bool(np.abs(layer).sum() <= 0.5 / coding.peak)
    return not layer.any()


def _taps(axis: Axis, cell: int, length: int) -> list[tuple[int, float]]:
    """Pixels under the filter of a chroma sample that lie in the frame, with their weights."""
    start = cell * axis.step - axis.phase + axis.first
    taps = [(start + i, weight) for i, weight in enumerate(axis.weights)]
    return [(pixel, weight) for pixel, weight in taps if 0 <= pixel < length]


def _cell(samples: Samples, x: int, y: int) -> tuple[int, int]:
    """Row and column of the chroma sample whose cell holds a pixel."""
    down, across = samples.down, samples.across
    return (y + down.phase) // down.step, (x + across.phase) // across.step


def _codes(samples: Samples, x: int, y: int, cell: tuple[int, int]) -> Float64:
    first, second, third = samples.planes
    return _finite(np.array([first[y, x], second[cell], third[cell]], dtype=np.float64))


def _finite(codes: Float64) -> Float64:
    """Codes of which what is infinite is white, and what is no number black."""
    return np.asarray(np.nan_to_num(codes, nan=0.0, posinf=1.0, neginf=0.0))


def _rgb(coding: Coding, codes: Float64) -> Float64:
    matrix = coding.rgb_from_codes
    return np.asarray(matrix[:, :3] @ codes + matrix[:, 3])


def _change(
    old: Samples, place: tuple[int, int], cell: tuple[int, int], layer: Float64, *, of_plate: bool
) -> Float64:
    """Change (3,) of the codes of a pixel with the chroma of `cell`."""
    coding, (x, y) = old.coding, place
    curve = transfer(coding.tags.transfer)
    plate = _rgb(coding, _codes(old, x, y, cell))
    alpha = 1.0 if old.alpha is None else float(old.alpha[y, x]) / (coding.peak or 1.0)
    gamut = primaries_from_bt709(coding.tags.primaries)
    light = layer[:3]
    if of_plate:
        light = light * (np.linalg.inv(gamut) @ curve.to_linear(plate))
    colour = gamut @ light
    straight = 1.0 if old.associated else alpha
    light = colour + (1.0 - layer[3]) * straight * curve.to_linear(plate)
    covered = layer[3] + (1.0 - layer[3]) * alpha
    if covered > 0.0 and not old.associated:
        light = light / covered
    coded = curve.to_coded(light)
    if coding.bits:  # codes beyond black and white stay, and do not grow
        coded = np.clip(coded, np.minimum(plate, 0.0), np.maximum(plate, 1.0))
    return np.asarray(coding.codes_from_rgb @ (coded - plate))


def _put(plane: Plane, y: int, x: int, change: float, coding: Coding) -> None:
    value = float(plane[y, x]) + change
    if coding.bits:
        value = np.floor(np.clip(value, 0.0, coding.peak) + 0.5)
    plane[y, x] = value
