"""`raster` by its definition: every sample asks every triangle, slowly."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float64
from nlens_video.render.software.raster import NOTHING, SAMPLE_X, SAMPLE_Y


def seen(
    corners: Float64, size: tuple[int, int], near: float
) -> tuple[npt.NDArray[np.int32], Float64]:
    """Triangle and disparity of each sample (4 h, w); `NOTHING` and 0 where there is none.

    A point of the screen is covered where it is a sum of the corners with weights that are not
    negative; that sum's weights also give its disparity.

    Args:
        corners: homogeneous corners (T, 3, 3), (column * depth, row * depth, depth) [px].
        size: rows and columns of the picture [px].
        near: least depth that is drawn [scene unit].
    """
    height, width = size
    ids = np.full((4 * height, width), NOTHING, np.int32)
    best = np.zeros((4 * height, width))
    lines, columns = np.indices(ids.shape)
    x = columns + np.array(SAMPLE_X)[lines % 4]
    y = lines // 4 + np.array(SAMPLE_Y)[lines % 4]
    samples = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    for number, triangle in enumerate(corners):
        if abs(np.linalg.det(triangle)) < 1e-12:
            continue
        weights = np.linalg.solve(triangle.T, samples.T).T.reshape(*ids.shape, 3)
        disparity = weights.sum(axis=-1)
        drawn = (weights >= 0.0).all(axis=-1) & (disparity <= 1.0 / near) & (disparity >= best)
        ids[drawn], best[drawn] = number, disparity[drawn]
    return ids, best
