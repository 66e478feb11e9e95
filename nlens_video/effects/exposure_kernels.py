"""Change of exposure between two small pictures: numba kernels and their numpy references."""

from __future__ import annotations

import math

import numba
import numpy as np

from nlens_video.core.layers import Float32, Float64

DARKEST, BRIGHTEST = 0.01, 0.8  # light that is far enough from noise and from white [1]


@numba.njit("void(f4[:,:,::1],f4[:,:,::1])", cache=True, nogil=True)
def take_stops(light: Float32, stops: Float32) -> None:
    """Fill in logarithmic light (h, w, 3), NaN where a channel is too dark or too bright."""
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            known = True  # what is no number is not
            for k in range(3):
                known &= np.float32(DARKEST) <= light[i, j, k] <= np.float32(BRIGHTEST)
            for k in range(3):
                stops[i, j, k] = np.log2(light[i, j, k]) if known else np.float32(math.nan)


@numba.njit(cache=True, nogil=True)
def median_of(values: Float32) -> float:
    """The value of rank n // 2 among n finite ones, from 0.

    Halves the range of possible values, since to count those below one takes no branch: to move
    them about, as in a partition, took four times as long.
    """
    half = len(values) // 2
    keys = values.view(np.int32)
    keys = keys ^ ((keys >> 31) & np.int32(0x7FFFFFFF))  # in the order of the values
    low, high = np.int64(keys.min()), np.int64(keys.max())
    while low < high:
        middle = np.int32((low + high) >> 1)
        below = np.int32(0)
        for key in keys:
            below += np.int32(key <= middle)
        if below > half:
            high = np.int64(middle)
        else:
            low = np.int64(middle) + 1
    key = np.int32(low)
    bits = np.int32(key ^ ((key >> 31) & np.int32(0x7FFFFFFF)))
    return bits.view(np.float32)  # type: ignore[return-value]  # single: so is what it is taken off


@numba.njit("b1(f4[:,:,::1],f4[:,:,::1],f8,f8,f8[::1])", cache=True, nogil=True)
def take_change(
    before: Float32, now: Float32, least_share: float, most_spread: float, change: Float64
) -> bool:
    """Fill in the median (3,) of the change from one picture (h, w, 3) to another [stops].

    Args:
        before: stops of the one.
        now: stops of the other.
        least_share: of the picture that must be known in both [1].
        most_spread: median deviation from which on it is not the same in most places.
        change: what is filled in.

    Returns:
        Whether it tells anything.
    """
    places = before.shape[0] * before.shape[1]
    ratios = np.empty((3, places), np.float32)
    count = 0
    for i in range(before.shape[0]):
        for j in range(before.shape[1]):
            if math.isnan(before[i, j, 0]) or math.isnan(now[i, j, 0]):
                continue
            for k in range(3):
                ratios[k, count] = now[i, j, k] - before[i, j, k]
            count += 1
    if count < least_share * places:
        return False
    for k in range(3):
        known = ratios[k, :count]
        middle = median_of(known)
        if not median_of(np.abs(known - middle)) < most_spread:
            return False
        change[k] = middle
    return True


def stops_reference(light: Float32) -> Float64:
    """Logarithmic light (h, w, 3), NaN where a channel is too dark or too bright."""
    lost = (light.min(axis=2) < DARKEST) | (light.max(axis=2) > BRIGHTEST)
    return np.where(lost[..., None], np.nan, np.log2(np.maximum(light, 1e-6, dtype=np.float64)))


def change_reference(
    before: Float32, now: Float32, least_share: float, most_spread: float
) -> Float64 | None:
    """Median (3,) of the change from one picture to another; None where it tells nothing.

    Args:
        before: stops of the one (h, w, 3).
        now: stops of the other.
        least_share: of the picture that must be known in both [1].
        most_spread: median deviation from which on it is not the same in most places.
    """
    ratio = (now - before).reshape(-1, 3)
    known = ratio[np.isfinite(ratio).all(axis=1)]
    if len(known) < least_share * len(ratio):
        return None
    middle = np.sort(known, axis=0)[len(known) // 2]
    spread = np.sort(np.abs(known - middle), axis=0)[len(known) // 2]
    return middle.astype(np.float64) if spread.max() < most_spread else None
