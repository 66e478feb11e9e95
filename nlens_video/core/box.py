"""Rectangles of whole pixels, and the radial coordinates of their pixels.

Radii are in half diagonals: 0 in the middle of the frame, 1 in its corners. Pixels are assumed
square.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from msgspec import Struct

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]
Int64 = npt.NDArray[np.int64]


class Box(Struct, frozen=True):
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
    def shape(self) -> tuple[int, int]:
        """Rows and columns, as of an array that covers the box [px]."""
        return self.height, self.width

    @property
    def area(self) -> int:
        """Pixels, 0 where the box is empty."""
        if self.x1 <= self.x0 or self.y1 <= self.y0:
            return 0
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    @property
    def empty(self) -> bool:
        """Whether it holds no pixel."""
        return self.x1 <= self.x0 or self.y1 <= self.y0

    def expanded(self, margin: int) -> Box:
        """The box with `margin` more pixels on every side [px]."""
        return Box(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def translated(self, columns: int, rows: int) -> Box:
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


def half_diagonal(frame: Box) -> float:
    """From the middle of a frame to its corner [px]."""
    return 0.5 * math.hypot(frame.width, frame.height)


def from_middle(box: Box, frame: Box) -> tuple[Float32, Float32]:
    """Columns (w,) and rows (h,) of a box's pixel centres from the frame's middle [px]."""
    columns = np.arange(box.x0, box.x1, dtype=np.float32) + np.float32(
        0.5 - 0.5 * (frame.x0 + frame.x1)
    )
    rows = np.arange(box.y0, box.y1, dtype=np.float32) + np.float32(
        0.5 - 0.5 * (frame.y0 + frame.y1)
    )
    return columns, rows


def square_radius(box: Box, frame: Box) -> Float32:
    """Square of the radius of each pixel of a box (h, w) [half diagonal^2]."""
    columns, rows = from_middle(box, frame)
    scale = np.float32(1.0 / half_diagonal(frame) ** 2)
    return np.asarray((rows * rows)[:, None] * scale + (columns * columns)[None, :] * scale)


def undistorted_radius(k1: float, k2: float, distorted: Float64) -> Float64:
    """Inverse of `optics.Distortion`: undistorted radii, infinite where there is none.

    Interpolated between 16384 radii.

    Args:
        k1: as of `Distortion` [1].
        k2: likewise [1].
        distorted: radii, any shape, in half diagonals or focal lengths.
    """
    limit = 4.0 * float(np.max(distorted, initial=0.0)) + 1e-6
    r = np.linspace(0.0, limit, 16384)
    grows = r * (1.0 + k1 * r**2 + k2 * r**4)
    turn = int(np.argmax(np.diff(grows) <= 0.0)) + 1 if (np.diff(grows) <= 0.0).any() else len(r)
    return np.asarray(np.interp(distorted, grows[:turn], r[:turn], right=np.inf))
