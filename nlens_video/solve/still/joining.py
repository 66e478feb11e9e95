"""Segments that lie on one line become one."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Bool, Float64

_PARALLEL = 0.06  # sine of the angle to the line
_OFF = 2.5  # distance from the line, by the error of an end [1]
_TURN = 0.004  # how far off a line may be for each px beyond its ends [1]
_GAP = 0.6  # of the longer one's length
_WIDEST_GAP = 0.08  # of the extent of all segments


def join_segments(ends: Float64, error_px: Float64) -> tuple[Float64, Float64]:
    """Join what lies on one line, longest first.

    Args:
        ends: first and second end (N, 2, 2) [px].
        error_px: standard error of an end across the segment (N,) [px].

    Returns:
        The same of the lines (M, 2, 2) and (M,), M <= N.
    """
    if len(ends) < 2:
        return ends, error_px
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    order = np.argsort(-lengths, kind="stable")
    ends, error_px, lengths = ends[order], error_px[order], lengths[order]
    along = (ends[:, 1] - ends[:, 0]) / lengths[:, None]
    widest = _WIDEST_GAP * float(np.ptp(ends.reshape(-1, 2), axis=0).max())
    free = np.ones(len(ends), np.bool_)
    lines, errors = [], []
    for first in range(len(ends)):
        if not free[first]:
            continue
        free[first] = False
        group, line = [first], ends[first]
        while True:  # it grows at both ends
            added = free & _continues(line, error_px[first], ends, error_px, along, lengths, widest)
            if not added.any():
                break
            free &= ~added
            group += [int(one) for one in np.flatnonzero(added)]
            line = _fitted(ends[group], lengths[group], along[first])
        lines.append(line)
        errors.append(float(error_px[group].max()))
    return np.array(lines), np.array(errors)


def _continues(
    line: Float64, error: float, ends: Float64, errors: Float64, along: Float64, lengths: Float64,
    widest: float,
) -> Bool:  # fmt: skip
    """Which segments lie on a line (2, 2), within it or not far beyond its ends."""
    vector = line[1] - line[0]
    length = float(np.linalg.norm(vector))
    x, y = vector / length
    offset = ends - line.mean(axis=0)
    across = abs(offset @ (-y, x)).max(axis=1)
    at = offset @ (x, y)
    gap = np.maximum(at.min(axis=1), -at.max(axis=1)) - 0.5 * length
    near = across < _OFF * np.maximum(errors, error) + _TURN * np.maximum(gap, 0.0)
    near &= gap < np.minimum(_GAP * np.maximum(lengths, length), widest)
    return np.asarray(near & (abs(along @ (-y, x)) < _PARALLEL))


def _fitted(ends: Float64, lengths: Float64, along: Float64) -> Float64:
    """The line (2, 2) through segments by least squares, as long as all of them."""
    points, weights = ends.reshape(-1, 2), np.repeat(lengths, 2)
    middle = weights @ points / weights.sum()
    offset = points - middle
    direction = np.linalg.eigh((offset * weights[:, None]).T @ offset)[1][:, 1]
    direction *= np.sign(direction @ along) or 1.0
    at = offset @ direction
    return np.asarray(middle + np.outer((at.min(), at.max()), direction))
