"""Points that share the frame evenly: what is sharp has most corners, however small it is."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Bool
from nlens_video.solve.points.observations import Table

_GRID = (10, 6)  # columns and rows of cells
_A_CELL = 3  # points of a cell, in a frame


def evenly(table: Table, count: int, size: tuple[int, int]) -> Bool:
    """Observations of points that stand for the frame's area, those seen the longest first (N,).

    Somebody who walks close before the camera gives more points than the room behind, which they
    cover and uncover.

    Args:
        table: observations.
        count: number of frames.
        size: columns and rows [px].
    """
    cells = (table.pixels / size * _GRID).astype(np.int64).clip(0, np.array(_GRID) - 1)
    cells = (table.places * _GRID[1] + cells[:, 1]) * _GRID[0] + cells[:, 0]
    order = np.argsort(table.numbers, kind="stable")
    seen = np.bincount(table.numbers, minlength=len(table.names))
    ends = np.cumsum(seen)
    held = np.zeros(count * _GRID[0] * _GRID[1], np.int64)
    kept = np.zeros(len(seen), np.bool_)
    for point in np.argsort(-seen, kind="stable"):
        here = cells[order[ends[point] - seen[point] : ends[point]]]
        if 2 * np.count_nonzero(held[here] < _A_CELL) > len(here):
            kept[point] = True
            held[here] += 1
    return np.asarray(kept[table.numbers])
