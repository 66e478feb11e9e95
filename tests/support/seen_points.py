"""Observations of known points, for tests that solve the camera from them."""

from __future__ import annotations

import numpy as np

from nlens_video.solve.points.observations import Observations


def observed(frames: list[tuple[np.ndarray, np.ndarray]]) -> Observations:
    """Observations from each frame's pixels of all points (P, 2) and which are seen (P,)."""
    found = Observations()
    for pixels, seen in frames:
        numbers = np.flatnonzero(seen)
        found.add(numbers, pixels[numbers].astype(np.float32))
    return found
