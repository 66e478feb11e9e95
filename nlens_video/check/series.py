"""Jumps, steps, flicker and freezes of time series.

The bend of a value is its difference from the line through both neighbours.
"""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float64

_WINDOW = 4  # frames to either side to which a value is compared
_WAY = 6  # frames to either side whose motion tells how evenly an object moves
_UNEVEN_OFFSET, _UNEVEN_BEND = 1.5, 2.0  # by which their offsets and their bends raise the limit
_MOST_BESIDE = 2.0  # times what a neighbour's bend tells that a value may be off alone
_LEAST_RUN = 6  # frames of flicker; fewer may go up and down by chance


def second_difference(values: Float64, times: Float64 | None = None) -> Float64:
    """The bend: each value minus that of a line through its neighbours at its time.

    A linear change gives 0, a single value off by e gives e with -e/2 on both sides, values off by
    +a and -a in turn give 2 a. The ends give 0; NaN spreads to its neighbours.

    Args:
        values: (n,) or (n, parts), NaN where there is none.
        times: of the values, (n,), NaN where there is none; None where they are even.

    Returns:
        The same shape, in the unit of the values.
    """
    bend = np.zeros(values.shape)
    if len(values) > 2:
        even = np.full(len(values) - 2, 0.5)
        share = even if times is None else (times[1:-1] - times[:-2]) / (times[2:] - times[:-2])
        later = share.reshape(-1, *(1,) * (values.ndim - 1))
        bend[1:-1] = values[1:-1] - ((1.0 - later) * values[:-2] + later * values[2:])
    return bend


def undone(bend: Float64) -> Float64:
    """The part of a bend that both neighbours undo.

    A value that is off alone bends its neighbours by half as much the other way, one that goes to
    and fro bends them by as much. What speeds up, turns round or stops at once does not.

    Args:
        bend: of the series, (n,).

    Returns:
        The bend beyond that of the series around it, 0 where a neighbour does not undo it, (n,).
    """
    count = len(bend)
    result = np.zeros(count)
    pairs = 0.5 * (bend[:-1] + bend[1:])  # what goes to and fro cancels
    for at in range(1, count - 1):
        around = (*pairs[max(0, at - _WINDOW) : max(0, at - 2)], *pairs[at + 2 : at + _WINDOW])
        usual = float(np.median(around)) if around else 0.0
        before, own, after = bend[at - 1 : at + 2] - usual
        if own * before < 0.0 and own * after < 0.0:
            result[at] = np.sign(own) * min(abs(own), 2.0 * abs(before), 2.0 * abs(after))
    return result


def lone_offset(bend: Float64, times: Float64 | None = None) -> Float64:
    """How far each value alone lies off the curve through its neighbours, two to either side.

    A value that is off alone bends both its neighbours the other way, by half as much where times
    are even: it is no further off than twice what the lesser of these bends tells. A curve of third
    order gives 0.

    Args:
        bend: of the series, (n,).
        times: of the values, (n,), NaN where there is none; None where they are even.
    """
    offset = np.zeros(len(bend))
    if len(bend) < 5:
        return offset
    at = np.arange(len(bend), dtype=np.float64) if times is None else times
    step = np.diff(at)
    first, second, third, fourth = step[:-3], step[1:-2], step[2:-1], step[3:]
    before, own, after = bend[1:-3], bend[2:-2], bend[3:-1]
    # the second divided differences of a cubic are linear in the mean of their three times
    early, late = at[3:-1] - at[:-4], at[4:] - at[1:-3]
    share = late / (early + late)
    curve = share * before / (first * second) + (1.0 - share) * after / (third * fourth)
    weight = 1.0 / (second * third)
    weight += share / ((first + second) * second) + (1.0 - share) / (third * (third + fourth))
    size = np.abs(own / (second * third) - curve) / weight
    beside = np.minimum(
        np.abs(before) * (first + second) / first, np.abs(after) * (third + fourth) / fourth
    )
    lone = (own * before < 0.0) & (own * after < 0.0)
    size = np.minimum(size, _MOST_BESIDE * beside)
    offset[2:-2] = np.nan_to_num(np.where(lone, np.copysign(size, own), 0.0))
    return offset


def lone_jumps(offset: Float64, bend: Float64, limit: float) -> list[tuple[int, float]]:
    """Values that lie off their way alone: position and offset, the largest of neighbours only.

    Args:
        offset: by `lone_offset`, (n,).
        bend: of the series, (n,).
        limit: least offset of a series that is even; it grows with the offsets and the bends
            around, since what hops or starts at once is off any curve by itself.
    """
    size, found = np.abs(offset), []
    for at in range(1, len(size) - 1):
        offsets, bends = _around(size, at, 2), _around(np.abs(bend), at, 1)
        uneven = _UNEVEN_OFFSET * np.quantile(offsets, 0.8) + _UNEVEN_BEND * np.median(bends)
        if size[at] > limit + uneven and size[at] >= size[at - 1 : at + 2].max():
            found.append((at, float(offset[at])))
    return found


def _around(values: Float64, at: int, without: int) -> Float64:
    """The values round one, but for itself and `without` of them to either side; 0 for none."""
    before, after = values[max(0, at - _WAY) : max(0, at - without)], values[at + without + 1 :]
    return np.array([*before, *after[: _WAY - without]] or [0.0])


def standard_error(bend: Float64) -> Float64:
    """Standard error of the bend of a whole, from the spread of its parts.

    Args:
        bend: of each part, (n, parts), NaN where there is none.

    Returns:
        Standard error of the parts' mean, (n,), 0 where none is known.
    """
    known = np.isfinite(bend)
    filled = np.where(known.any(axis=1, keepdims=True), bend, 0.0)
    middle = np.nanmedian(filled, axis=1, keepdims=True)
    spread = 1.4826 * np.nanmedian(np.abs(filled - middle), axis=1)
    return np.asarray(spread / np.sqrt(np.maximum(known.sum(axis=1), 1)), np.float64)


def _surrounding_bend(bend: Float64) -> Float64:
    """Median |bend| round each value, (n,), without itself and the neighbours that it bends."""
    size = np.abs(bend)
    result = np.zeros(len(size))
    for at in range(len(size)):
        around = (*size[max(0, at - _WINDOW) : max(0, at - 1)], *size[at + 2 : at + _WINDOW + 1])
        result[at] = np.median(around) if around else 0.0
    return result


def outliers(bend: Float64, limit: float, error: Float64 | float = 0.0) -> list[tuple[int, float]]:
    """Jumps of single values: position and size, the largest of neighbours only.

    Args:
        bend: of the series, (n,).
        limit: least jump, beyond four times the bend around it and two standard errors.
        error: standard error of the bend.
    """
    size = np.abs(bend)
    least = limit + 4.0 * _surrounding_bend(bend) + 2.0 * np.broadcast_to(error, bend.shape)
    return [
        (at, float(bend[at]))
        for at in range(1, len(size) - 1)
        if size[at] > least[at] and size[at] >= size[at - 1 : at + 2].max()
    ]


def steps(values: Float64, limit: float) -> list[tuple[int, float]]:
    """Lasting changes of level within one frame: position and size.

    A change that is undone on the next frame is a jump (`outliers`), not a step.

    Args:
        values: (n,), NaN where there is none.
        limit: least step, beyond three times the deviation of the changes around it.
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
        levels = np.median(values[at : at + _WINDOW]) - np.median(values[at - _WINDOW : at])
        lasting = (float(levels) - _WINDOW * usual) * np.sign(size) > 0.5 * abs(size)
        if abs(size) > limit + 3.0 * uneven and lasting:
            found.append((at, size))
    return found


def flicker(
    bend: Float64, limit: float, error: Float64 | float = 0.0
) -> list[tuple[int, int, float]]:
    """Runs of values that go up and down: first and last position, median amplitude.

    Args:
        bend: of the series, (n,).
        limit: least amplitude, half of a value's difference from its neighbours.
        error: standard error of the bend; 1.5 of it are no flicker.
    """
    amplitude = 0.5 * _surrounding_bend(bend)
    doubt = 0.75 * _surrounding_bend(np.broadcast_to(np.asarray(error, np.float64), bend.shape))
    unsteady = np.flatnonzero(amplitude > np.maximum(limit, doubt))
    found = np.split(unsteady, np.flatnonzero(np.diff(unsteady) > 1) + 1)
    return [
        (int(run[0]), int(run[-1]), float(np.median(amplitude[run])))
        for run in found
        if len(run) >= _LEAST_RUN
    ]


def freezes(motion: Float64, still: float) -> list[tuple[int, int]]:
    """Runs of still values between moving ones: first and last position.

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
        if at < end < count and min(before, motion[end]) > 4.0 * still:
            found.append((at, end - 1))
        at = max(end, at) + 1
    return found
