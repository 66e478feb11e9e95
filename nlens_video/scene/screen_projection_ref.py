"""Bounds of points on the screen, whole arrays at a time: defines those of `screen`."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float64


def in_camera(points: Float64, lens: Float64) -> Float64:
    """Right, up and depth (N, 3) of world points; `lens` as of `screen.Lens.numbers`."""
    return np.asarray((points - lens[9:12]) @ lens[:9].reshape(3, 3).T * [1.0, 1.0, -1.0])


def misses(points: Float64, lens: Float64, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether all that lies in the hull of points (N, 3) is certain to miss a box of the screen."""
    right, up, depth = in_camera(points, lens).T
    if not len(points):
        return False
    if (depth <= 0.0).all():
        return True
    if not (depth > 0.0).all():
        return False
    x, y = lens[14] + lens[12] * right / depth, lens[15] - lens[13] * up / depth
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return False
    return bool(x.min() > x1 or y.min() > y1 or x.max() < x0 or y.max() < y0)


def travel(points: Float64, lenses: Float64) -> float:
    """What no mean of points (M, N, 3) moves more than from moment to moment, summed up [px]."""
    seen = np.array([in_camera(*moment) for moment in zip(points, lenses, strict=True)])
    depth = seen[..., 2]
    if not (np.isfinite(seen).all() and (depth > 0.0).all()):
        return float("inf")
    slant = np.abs(seen[..., :2] / depth[..., None]).max(axis=(0, 1))
    way = np.abs(np.diff(seen, axis=0)).max(axis=1)
    moved = lenses[0, 12:14] * (way[:, :2] + slant * way[:, 2:]) / depth.min()
    return float(np.hypot(*moved.T).sum())
