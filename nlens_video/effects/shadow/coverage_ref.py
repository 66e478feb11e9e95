"""`cast` by its definition: solve for each pixel and triangle, slowly."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.effects.shadow.coverage import Int32


def covered(size: tuple[int, int], points: Float64, faces: Int32, at: tuple[float, float]) -> Bool:
    """Pixels (h, w) that any triangle covers; positions homogeneous (V, 3), see `cast`.

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


def stopped(
    size: tuple[int, int],
    points: Float64,
    surface: Float64,
    faces: Int32,
    texture: tuple[Float32, tuple[int, int], float],
    at: tuple[float, float],
) -> Float64:
    """Share (h, w) of the light that triangles with holes stop; arguments as of `count_veiled`.

    Light passes one triangle after the other.
    """
    alpha, wrap, cutoff = texture
    left = np.ones(size)
    for face in faces:
        if np.linalg.det(points[face]) == 0.0:
            continue
        for y in range(size[0]):
            for x in range(size[1]):
                weights = np.linalg.solve(points[face].T, [x + at[0], y + at[1], 1.0])
                if (weights < 0.0).any():
                    continue
                u, v, factor = weights / weights.sum() @ surface[face]
                share = min(max(factor * _bilinear(alpha, wrap, u, v), 0.0), 1.0)
                if cutoff >= 0.0:
                    share = float(share >= cutoff)
                left[y, x] *= 1.0 - share
    return 1.0 - left


def _bilinear(alpha: Float32, wrap: tuple[int, int], u: float, v: float) -> float:
    height, width = alpha.shape
    x, y = u * width - 0.5, v * height - 0.5
    total = 0.0
    for j in (math.floor(y), math.floor(y) + 1):
        for i in (math.floor(x), math.floor(x) + 1):
            near = max(0.0, 1.0 - abs(x - i)) * max(0.0, 1.0 - abs(y - j))
            total += near * alpha[_wrapped(j, height, wrap[1]), _wrapped(i, width, wrap[0])]
    return float(total)


def _wrapped(index: int, size: int, mode: int) -> int:
    there = list(range(size))
    row = {0: there, 1: there + there[::-1]}.get(mode)
    return row[index % len(row)] if row else there[min(max(index, 0), size - 1)]
