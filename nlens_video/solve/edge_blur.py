"""CoC at the edges of a marker, from how light rises across them: a slanted edge seen by a lens.

Across the straight edge of a black square the light of a disc of confusion rises as the disc's area
beyond a line. So the width of the rise is the diameter, with no network in between.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.optimize import least_squares

from nlens_video.core.layers import Float32, Float64
from nlens_video.solve.marker_edges import sampled

PARTS = 3  # of an edge, each measured by itself
_ALONG = 12  # profiles of a part, which are averaged
_ENDS = 0.14  # of an edge, left out at both ends
_CELL = 1.0 / 8.0  # of a marker's side: its black border is at least so wide
_STEP_PX = 0.25
_PIXEL_PX = 0.52  # deviation of the light within a pixel, and of interpolation between them
_LEAST_CONTRAST = 0.05  # between paper and ink, by the paper's light [1]
_LEAST_REACH_PX, _ROUNDS = 1.5, 3
_FLOOR_PX = 0.15  # error of a diameter, at least: paper, ink and tone curve are not ideal
_SHARP_PX, _SHARP_ERROR_PX = 1.3, 0.6  # pixels hide the diameter of smaller discs
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)


class EdgeBlurs(Struct, frozen=True, eq=False):
    """Parts of the edges of a marker; all arrays of N.

    Attributes:
        share: where on the marker: across and down, each 0 to 1 of the side (N, 2).
        coc_px: diameter of the disc of confusion (N,) [px].
        error_px: its standard error (N,) [px].
    """

    share: Float64
    coc_px: Float64
    error_px: Float64


def edge_blurs(light: Float32, corners: Float64) -> EdgeBlurs:
    """Measure the blur of the edges of one marker.

    Edges without contrast, and those more blurred than the border is wide, are left out.

    Args:
        light: scene-linear, of one channel (H, W).
        corners: from the marker's upper left clockwise (4, 2), pixel centres at +0.5 [px].
    """
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    ends = np.linspace(_ENDS, 1.0 - _ENDS, PARTS + 1)
    found = []
    for number in range(4):
        start, end = corners[number], corners[(number + 1) % 4]
        along = (end - start) / np.linalg.norm(end - start)
        outward = np.array([along[1], -along[0]])  # of a clockwise square, y down
        deep = -0.5 * sum(float((corners[(number + k) % 4] - start) @ outward) for k in (2, 3))
        border = _CELL * deep
        for low, high in zip(ends[:-1], ends[1:], strict=True):
            shares = np.linspace(low, high, _ALONG)[:, None]
            steps = np.arange(-border, border + 0.5 * _STEP_PX, _STEP_PX)
            spots = start + shares * (end - start)
            across = spots[:, None] + steps[None, :, None] * outward
            profile = sampled(light, across).mean(axis=0, dtype=np.float64)
            measured = _measured(profile, steps, border)
            if measured is not None:
                middle = 0.5 * (low + high)
                place = square[number] + middle * (square[(number + 1) % 4] - square[number])
                found.append((*place, *measured))
    rows = np.array(found).reshape(-1, 4)
    return EdgeBlurs(rows[:, :2], rows[:, 2], rows[:, 3])


def _measured(profile: Float64, steps: Float64, border: float) -> tuple[float, float] | None:
    """Diameter and standard error [px]; None where more than the edge takes part.

    Light of the marker's inside and from beyond its paper reaches half a diameter into the border
    and the margin, so as much of them is left out.
    """
    reach, measured = 0.7 * border, None
    for _ in range(_ROUNDS):
        if reach < _LEAST_REACH_PX:
            return None
        near = np.abs(steps) <= reach
        measured = _disc_of(profile[near], steps[near])
        if measured is None:
            return None
        reach = border - 0.5 * measured[0] - _PIXEL_PX
    return measured


def _disc_of(profile: Float64, steps: Float64) -> tuple[float, float] | None:
    """Diameter and standard error [px] of the disc that makes this rise; None without all of it."""
    reach = float(steps[-1])
    dark, bright = float(profile[:3].mean()), float(profile[-3:].mean())
    if bright - dark < _LEAST_CONTRAST * max(bright, 1e-6):
        return None

    def off(values: Float64) -> Float64:
        middle, diameter, low, high = values
        rise = _edge((steps - middle), abs(diameter))
        return np.asarray((low + (high - low) * rise - profile) / (bright - dark))

    fits = [
        least_squares(off, [0.0, diameter, dark, bright], x_scale=[1.0, 1.0, 0.1, 0.1])
        for diameter in (1.0, 0.5 * reach, 1.5 * reach)
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    middle, diameter = float(best.x[0]), abs(float(best.x[1]))
    if abs(middle) + 0.5 * diameter > reach or best.x[3] <= best.x[2]:
        return None
    # neighbouring samples are interpolated from the same pixels
    independent = max(len(steps) * _STEP_PX - 4.0, 1.0)
    noise = 2.0 * float(best.cost) / independent
    jacobian = np.asarray(best.jac, np.float64)
    spread = np.linalg.pinv(jacobian.T @ jacobian) * noise / _STEP_PX
    floor = _FLOOR_PX if diameter > _SHARP_PX else _SHARP_ERROR_PX
    return diameter, float(np.hypot(np.sqrt(max(spread[1, 1], 0.0)), floor))


def _edge(distance: Float64, diameter: float) -> Float64:
    """Share 0 to 1 of a pixel's light from beyond an edge, seen through a disc of confusion."""
    radius = max(0.5 * diameter, 1e-3)
    share = np.zeros_like(distance)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        u = np.clip((distance + _PIXEL_PX * node) / radius, -1.0, 1.0)
        share += weight * (0.5 + (u * np.sqrt(1.0 - u * u) + np.arcsin(u)) / np.pi)
    return np.asarray(share / _WEIGHTS.sum())
