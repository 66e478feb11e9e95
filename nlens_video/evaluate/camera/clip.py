"""A solved path against the true one: points of the ground followed through a clip."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.layers import Bool, Float64
from nlens_video.evaluate.camera.truth import Known
from nlens_video.scene import Camera


def path_figures(known: Known, found: SolvedCamera) -> dict[str, float]:
    """How far points chosen on the ground of the first frame drift from where they truly are.

    Each point is taken at its true pixel of the first frame, put on the solved ground there, and
    seen by the solved camera of each frame in which the truth shows it.

    Returns:
        Over all points and frames `ground_px`, the root mean square distance; `worst_px`, that of
        the worst point; `fov_percent`, the largest error of the field of view of a frame, with its
        sign, by the true one. Infinite where a point lies above the solved horizon.
    """
    times = [key.pts_s for key in known.camera.keys]
    true = [known.camera.at(time) for time in times]
    points = known.ground_points
    starts, shown = _seen(true[0], points)
    points, starts = points[shown], starts[shown]
    placed, _ = found.at(times[0]).ground_seen_at(starts, found.ground_y)
    if np.isnan(placed).any() or not len(points):
        return {"ground_px": math.inf if len(points) else math.nan}
    squares = np.zeros(len(points))
    counts = np.zeros(len(points))
    for camera, time in zip(true, times, strict=True):
        truth, there = _seen(camera, points)
        pixels, before = _pixels(found.at(time), placed)
        distance = np.where(before, np.linalg.norm(pixels - truth, axis=1), np.inf)
        squares[there] += distance[there] ** 2
        counts[there] += 1.0
    ratios = [
        100.0 * (_fov(found.at(time)) / _fov(camera) - 1.0)
        for camera, time in zip(true, times, strict=True)
    ]
    return {
        "ground_px": math.sqrt(float(squares.sum() / counts.sum())),
        "worst_px": math.sqrt(float((squares / counts).max())),
        "fov_percent": max(ratios, key=abs),
    }


def _fov(camera: Camera) -> float:
    return math.atan(0.5 * camera.width / camera.fx)


def _seen(camera: Camera, points: Float64) -> tuple[Float64, Bool]:
    """Pixels (N, 2) of world points (N, 3), and which of them the frame shows (N,)."""
    pixels, before = _pixels(camera, points)
    inside = (pixels >= 0.0).all(axis=1) & (pixels <= (camera.width, camera.height)).all(axis=1)
    return pixels, before & inside


def _pixels(camera: Camera, points: Float64) -> tuple[Float64, Bool]:
    """Pixels (N, 2) of world points (N, 3), and which of them lie before the camera (N,)."""
    seen = camera.to_camera(points)
    before = seen[:, 2] < 0.0
    seen[~before] = (0.0, 0.0, -1.0)
    return camera.pixels(seen), before
