"""Rectangles of whole pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of whole pixels, [x0, x1) by [y0, y1); it may reach beyond the frame [px]."""

    x0: int
    y0: int
    x1: int
    y1: int

    @classmethod
    def of(cls, mask: npt.NDArray[np.bool_]) -> Box:
        """The least box that holds all of a mask (h, w), from its corner; an empty one for none."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if not rows.size:
            return cls(0, 0, 0, 0)
        return cls(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)

    @property
    def width(self) -> int:
        """Columns, 0 where the box is empty [px]."""
        return max(0, self.x1 - self.x0)

    @property
    def height(self) -> int:
        """Rows, 0 where the box is empty [px]."""
        return max(0, self.y1 - self.y0)

    @property
    def empty(self) -> bool:
        """Whether it holds no pixel."""
        return self.x1 <= self.x0 or self.y1 <= self.y0

    def expanded(self, margin: int) -> Box:
        """The box with `margin` more pixels on every side [px]."""
        return Box(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def moved(self, columns: int, rows: int) -> Box:
        """The box so many pixels farther to the right and down [px]."""
        return Box(self.x0 + columns, self.y0 + rows, self.x1 + columns, self.y1 + rows)

    def union(self, other: Box) -> Box:
        """The least box that holds both."""
        if self.empty or other.empty:
            return other if self.empty else self
        return Box(
            min(self.x0, other.x0),
            min(self.y0, other.y0),
            max(self.x1, other.x1),
            max(self.y1, other.y1),
        )

    def intersection(self, other: Box) -> Box:
        """The pixels in both boxes."""
        return Box(
            max(self.x0, other.x0),
            max(self.y0, other.y0),
            min(self.x1, other.x1),
            min(self.y1, other.y1),
        )

    def slices_in(self, outer: Box) -> tuple[slice, slice]:
        """Row and column slices that pick this box out of an array that covers `outer`."""
        return (
            slice(self.y0 - outer.y0, self.y1 - outer.y0),
            slice(self.x0 - outer.x0, self.x1 - outer.x0),
        )
