"""A lens that breathes: its picture grows or shrinks while its focus is pulled.

Told from a zoom by the focus that is followed, with which the size of the picture then goes. Only
sums are kept, so that the length of a clip does not matter.
"""

from __future__ import annotations

import math

_SEEN, _MOST = 0.008, 0.2  # change of the size that shows, and of which lenses breathe at most
_PULLED = 0.15  # change of the disparity in focus, as a share of the largest: the focus was pulled
_IN_STEP = 0.9  # correlation of size and focus; what else changes the size seldom goes with it
_FEWEST = 4  # frames


class Breathing:
    """Compares the size of a plate's picture with the focus of its lens."""

    def __init__(self) -> None:
        self._count = 0
        self._means = [0.0, 0.0]
        self._sums = [0.0, 0.0, 0.0]  # of squares of focus and size, and of products, about means
        self._far = self._near = (0.0, 0.0)

    def add(self, focus: float, log_size: float) -> None:
        """Add a frame.

        Args:
            focus: disparity in focus [1 / scene unit].
            log_size: logarithm of the picture's size by that of the first frame, less that of the
                camera's focal length [1].
        """
        self._count += 1
        here = focus, log_size
        self._far = min(self._far, here) if self._count > 1 else here
        self._near = max(self._near, here) if self._count > 1 else here
        before = [value - mean for value, mean in zip(here, self._means, strict=True)]
        self._means = [
            mean + away / self._count for mean, away in zip(self._means, before, strict=True)
        ]
        after = [value - mean for value, mean in zip(here, self._means, strict=True)]
        self._sums[0] += before[0] * after[0]
        self._sums[1] += before[1] * after[1]
        self._sums[2] += before[0] * after[1]

    @property
    def growth(self) -> float:
        """Logarithm of the size at the nearest focus by that at the farthest; 0: not seen [1]."""
        (far, far_size), (near, near_size) = self._far, self._near
        if self._count < _FEWEST or near - far < _PULLED * max(abs(near), abs(far)):
            return 0.0
        together = self._sums[2] / max(math.sqrt(self._sums[0] * self._sums[1]), 1e-300)
        grown = near_size - far_size
        return grown if abs(together) >= _IN_STEP and _SEEN <= abs(grown) <= _MOST else 0.0

    def describe(self) -> str:
        """Words on a lens that is seen to breathe, empty for others."""
        if not self.growth:
            return ""
        percent = 100.0 * abs(math.expm1(self.growth))
        ends = [
            f"depth {1.0 / at:.3g}" if at > 0.0 else "infinity" for at, _ in (self._far, self._near)
        ]
        return (
            f"the lens breathes: focused at {ends[1]}, the plate shows things {percent:.1f} % "
            f"{'larger' if self.growth > 0.0 else 'smaller'} than focused at {ends[0]}, which the "
            "GLB's camera does not follow: animate its field of view likewise"
        )
