"""Jumps and flicker of a series: how far each value lies from its neighbours' mean."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float64

_WINDOW = 4  # frames to either side that say how restless a series is

_LEAST_STRETCH = 6  # frames that go up and down; fewer may do so by chance


def second_difference(values: Float64) -> Float64:
    """Each value minus the mean of its two neighbours: minus half the second difference.

    A steady change gives 0, a single value off by e gives e with -e/2 on both sides, values off by
    +a and -a in turn give 2 a. The ends give 0, neighbours of what is not a number no number.

    Args:
        values: (n,) or (n, parts), NaN where there is none.

    Returns:
        The same shape, in the unit of the values.
    """
    bent = np.zeros(values.shape)
    if len(values) > 2:
        bent[1:-1] = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    return bent


def standard_error(bent: Float64) -> Float64:
    """How far the bend of a whole can be trusted, judged by how its parts differ.

    Args:
        bent: bend of each part, (n, parts), NaN where there is none.

    Returns:
        Standard error of the parts' mean, (n,), 0 where none is known.
    """
    known = np.isfinite(bent)
    filled = np.where(known.any(axis=1, keepdims=True), bent, 0.0)
    middle = np.nanmedian(filled, axis=1, keepdims=True)
    spread = 1.4826 * np.nanmedian(np.abs(filled - middle), axis=1)
    return np.asarray(spread / np.sqrt(np.maximum(known.sum(axis=1), 1)), np.float64)


def restlessness(bent: Float64) -> Float64:
    """Median of |bend| round each value, (n,); itself and what it bends beside it are left out."""
    size = np.abs(bent)
    result = np.zeros(len(size))
    for at in range(len(size)):
        around = (*size[max(0, at - _WINDOW) : max(0, at - 1)], *size[at + 2 : at + _WINDOW + 1])
        result[at] = np.median(around) if around else 0.0
    return result


def outliers(bent: Float64, limit: float, error: Float64 | float = 0.0) -> list[tuple[int, float]]:
    """Single values that jump out: position and how far, the farthest of neighbours only.

    Args:
        bent: bend of the series, (n,).
        limit: the least jump; four times the restlessness around is asked for as well.
        error: standard error of the bends, two of which are asked for as well.
    """
    size = np.abs(bent)
    least = limit + 4.0 * restlessness(bent) + 2.0 * np.broadcast_to(error, bent.shape)
    return [
        (at, float(bent[at]))
        for at in range(1, len(size) - 1)
        if size[at] > least[at] and size[at] >= size[at - 1 : at + 2].max()
    ]


def steps(values: Float64, limit: float) -> list[tuple[int, float]]:
    """Where a series goes to another level within one frame: position and how far.

    What comes back with the next frame is a jump (`outliers`), not a step.

    Args:
        values: (n,), NaN where there is none.
        limit: the least step; three times how unevenly it goes around is asked for as well.
    """
    change = np.diff(values, prepend=np.nan)
    found = []
    for at in range(_WINDOW, len(values) - _WINDOW + 1):
        around = np.array([*change[max(1, at - _WINDOW) : at], *change[at + 1 : at + _WINDOW + 1]])
        known = around[np.isfinite(around)]
        if len(known) < _WINDOW:
            continue
        usual = float(np.mean(np.sort(known)[len(known) // 4 : -(len(known) // 4)]))
        uneven = float(np.median(np.abs(known - usual)))
        size = float(change[at]) - usual
        levels = np.mean(values[at : at + _WINDOW]) - np.mean(values[at - _WINDOW : at])
        lasting = (float(levels) - _WINDOW * usual) * np.sign(size) > 0.5 * abs(size)
        if abs(size) > limit + 3.0 * uneven and lasting:
            found.append((at, size))
    return found


def flicker(
    bent: Float64, limit: float, error: Float64 | float = 0.0
) -> list[tuple[int, int, float]]:
    """Stretches whose values go up and down: first and last position, median amplitude.

    Args:
        bent: bend of the series, (n,).
        limit: the least amplitude, half of what a value differs from its neighbours.
        error: standard error of the bends; one and a half of it make no flicker.
    """
    calm = 0.5 * restlessness(bent)
    doubt = 0.75 * restlessness(np.broadcast_to(np.asarray(error, np.float64), bent.shape))
    restless = np.flatnonzero(calm > np.maximum(limit, doubt))
    stretches = np.split(restless, np.flatnonzero(np.diff(restless) > 1) + 1)
    return [
        (int(one[0]), int(one[-1]), float(np.median(calm[one])))
        for one in stretches
        if len(one) >= _LEAST_STRETCH
    ]


def freezes(motion: Float64, still: float) -> list[tuple[int, int]]:
    """Where what moves before and after stands still: first and last position, five at most.

    Args:
        motion: change since the value before, (n,), NaN where there is none [level].
        still: change that the encoder alone makes [level].
    """
    found, at, count = [], 1, len(motion)
    while at < count - 1:
        end = at
        before = motion[at - 1]
        while end < count and motion[end] < max(0.25 * before, still):
            end += 1
        if at < end < count and end - at <= 5 and min(before, motion[end]) > 4.0 * still:
            found.append((at, end - 1))
        at = max(end, at) + 1
    return found
