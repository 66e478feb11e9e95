"""Newton's method by differences, for a function that takes many places at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlens_video.core.layers import Float64

Function = Callable[[Float64], Float64]
"""Places (…, P) to values (…,)."""
_STEPS, _TRIES = 6, 5
_LARGEST_STEP = 0.1
_GAIN = 1e-3  # steps that gain less end the climb


def climb(function: Function, place: Float64) -> Float64:
    """The place (P,) of a maximum near a place; each step gains."""
    value, damping = float(function(place)), 1e-2
    for _ in range(_STEPS):
        slope, curvature = derivatives(function, place, 2e-4)
        values, axes = np.linalg.eigh(-curvature)
        gained = 0.0
        for _ in range(_TRIES):
            step = axes @ ((axes.T @ slope) / (np.maximum(abs(values), 1.0) + damping))
            tried = place + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            found = float(function(tried))
            if found > value:
                place, gained, value, damping = tried, found - value, found, 0.3 * damping
                break
            damping = max(10.0 * damping, 10.0)
        if gained < _GAIN:
            break
    return place


def derivatives(function: Function, place: Float64, step: float) -> tuple[Float64, Float64]:
    """Gradient (P,) and Hessian (P, P) at a place (P,), by central differences."""
    count = len(place)
    shifts = step * np.eye(count)
    pairs = [(i, j) for i in range(count) for j in range(i)]
    places = [place, *(place + shifts), *(place - shifts)]
    for i, j in pairs:
        both, apart = shifts[i] + shifts[j], shifts[i] - shifts[j]
        places += [place + both, place - both, place + apart, place - apart]
    values = function(np.array(places))
    up, down = values[1 : 1 + count], values[1 + count : 1 + 2 * count]
    hessian = np.diag((up + down - 2.0 * values[0]) / step**2)
    mixed = values[1 + 2 * count :].reshape(-1, 4)
    for (i, j), (a, b, c, d) in zip(pairs, mixed, strict=True):
        hessian[i, j] = hessian[j, i] = (a + b - c - d) / (4.0 * step**2)
    return (up - down) / (2.0 * step), hessian
