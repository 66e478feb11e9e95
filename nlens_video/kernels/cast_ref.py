"""`cast` by its definition: solve for each pixel and triangle, slowly."""

from __future__ import annotations

import numpy as np

from nlens_video.frames import Bool, Float64
from nlens_video.kernels.cast import Int32


def covered(size: tuple[int, int], points: Float64, faces: Int32, at: tuple[float, float]) -> Bool:
    """Pixels (h, w) that any triangle covers; arguments as of `cast.count_covered`.

    A pixel (x, y, 1) is covered where it is a sum of the corners with weights that are not
    negative.
    """
    rows, columns = np.indices(size)
    pixels = np.stack([columns + at[0], rows + at[1], np.ones(size)], axis=-1)
    out = np.zeros(size, bool)
    for corners in points[faces]:
        if np.linalg.det(corners) != 0.0:
            out |= (
                (np.linalg.solve(corners.T, pixels.reshape(-1, 3).T) >= 0.0)
                .all(axis=0)
                .reshape(size)
            )
    return out
