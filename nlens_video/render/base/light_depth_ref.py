"""Definitions of the kernels of `light_depth`, one point at a time in float64."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.render.base.light_depth import CELL, LightDepth
from nlens_video.scene.gltf.meshes import Int32

_SHARPEST, _NARROW = 1.0, 6.0
_BIAS, _SLOPE_BIAS, _STEEPEST = 1.0, 0.5, 64.0


def nearness(places: Float32, faces: Int32, side: int) -> Float64:
    """The nearness of the surface nearest to the light at each pixel's centre, -inf for nothing.

    Args:
        places: corners (V, 3): column, row, nearness [px].
        faces: their numbers (F, 3).
        side: width and height of the map [px].
    """
    found = np.full((side, side), -np.inf)
    row, column = np.mgrid[:side, :side] + 0.5
    for a, b, c in places.astype(np.float64)[faces]:
        area = _side(a, b, c[0], c[1])
        if area == 0.0:
            continue
        weights = [_side(p, q, column, row) / area for p, q in ((b, c), (c, a), (a, b))]
        inside = np.min(weights, axis=0) >= 0.0
        there = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]
        found = np.where(inside, np.maximum(found, there), found)
    return found


def _side(p: Float64, q: Float64, x: Float64, y: Float64) -> Float64:
    return np.asarray((q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1]))


def visible(
    depth: LightDepth, number: int, place: Float64, facet: Float64, toward: Float64
) -> float:
    """The share of a light that reaches a point.

    Args:
        depth: maps of the lights.
        number: of the map.
        place: of the point in the world (3,) [scene unit].
        facet: normal of its triangle, facing the eye (3,).
        toward: direction to the light (3,).
    """
    traits = depth.rows(np.zeros(3))[number, 28:].astype(np.float64)
    softness, lift, softest, _ = traits
    seen = depth.matrices[number] @ np.append(place, 1.0)
    column, row, near = seen[:3] / seen[3]
    side = depth.nearness.shape[1]
    if seen[3] <= 0.0 or not (0.0 <= column < side and 0.0 <= row < side):
        return 1.0
    slope, bias = np.zeros(2), lift
    if facet @ toward > 0.0:
        plane = np.linalg.inv(depth.matrices[number]).T @ np.append(facet, -facet @ place)
        change = -plane[:2] / plane[2]
        if np.abs(change).sum() < _STEEPEST:
            slope, bias = change, min(_BIAS + _SLOPE_BIAS * np.abs(change).sum(), lift)

    def before(x: int, y: int) -> float:
        """How much nearer than the point a pixel is; 0 where it does not block the light."""
        at = float(slope @ (x + 0.5 - column, y + 0.5 - row))
        there = float(depth.nearness[number, y, x] - near)
        return there if there > max(at, 0.0) + bias else 0.0

    def taps(radius: float, count: int, shift: float) -> list[tuple[float, float]]:
        places = [_disc(i, count) * radius + (column + shift, row + shift) for i in range(count)]
        return [(x, y) for x, y in np.clip(places, 0.0, side - 2.0)]

    def radius(nearer: float) -> float:
        return float(min(max(softness * nearer, _SHARPEST), softest))

    highest = float(depth.highest[number, int(row) // CELL, int(column) // CELL])
    widest = radius(highest - near)
    searched = taps(widest, 16 if widest <= _NARROW else 32, 0.0)
    blockers = [before(int(x), int(y)) for x, y in searched]
    blockers = [one for one in blockers if one > 0.0]
    if not blockers:
        return 1.0
    own = radius(sum(blockers) / len(blockers))
    count, blocked = 8 if own <= 2.0 else 16 if own <= 6.0 else 32, 0.0
    for x, y in taps(own, count, -0.5):
        left, top = int(x), int(y)
        for across, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
            share = abs(1 - across - (x - left)) * abs(1 - down - (y - top))
            blocked += share * (before(left + across, top + down) > 0.0)
    return float(1.0 - blocked / count)


def _disc(number: int, count: int) -> Float64:
    """A point of the unit disc (2,), of so many of equal areas (Vogel 1979)."""
    turn = number * math.pi * (3.0 - math.sqrt(5.0))
    return math.sqrt((number + 0.5) / count) * np.array([math.cos(turn), math.sin(turn)])
