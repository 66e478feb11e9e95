"""Over the three channels of each pixel: NumPy is slow along so short an axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float32


def channel_max(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Their maximum (h, w)."""
    first = np.maximum(values[..., 0], values[..., 1])
    return np.asarray(np.maximum(first, values[..., 2], out=first))


def channel_sum(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Their sum (h, w)."""
    return np.asarray(values[..., 0] + values[..., 1] + values[..., 2])


def all_channels(flags: Bool) -> Bool:
    """Whether all three are flagged (h, w)."""
    return np.asarray(flags[..., 0] & flags[..., 1] & flags[..., 2])


def any_channel(values: npt.NDArray[Any]) -> Bool:
    """Whether any of all channels, however many, is not 0 (h, w)."""
    found = values[..., 0] != 0
    for channel in range(1, values.shape[-1]):
        found |= values[..., channel] != 0
    return np.asarray(found)


def scaled_pixels(values: Float32, factors: Float32) -> Float32:
    """Values (h, w, c), all channels of a pixel by its factor (h, w)."""
    each = np.repeat(factors, values.shape[2], axis=1)
    return np.asarray(each.reshape(values.shape) * values)


def scaled_channels(values: Float32, factors: Float32) -> Float32:
    """Values (h, w, 3), each channel by its factor (3,)."""
    return _by_rows(np.multiply, values, factors)


def divided_channels(values: Float32, divisors: Float32) -> Float32:
    """Values (h, w, 3), each channel divided by its divisor (3,)."""
    return _by_rows(np.divide, values, divisors)


def _by_rows(operation: np.ufunc, values: Float32, other: Float32) -> Float32:
    rows = np.ascontiguousarray(values).reshape(len(values), -1)
    return np.asarray(operation(rows, np.tile(other, values.shape[1])).reshape(values.shape))
