"""Measures lens distortion by the plumb line: how far long straight edges are bent.

Edges that are nearly straight are assumed straight in the scene. Each has a coefficient that
straightens it; under a lens all of them agree, outwards or inwards wherever they lie. In a scene
whose long lines are bent for other reasons they do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.box import undistorted_radius
from nlens_video.core.layers import Float32, Float64, Picture
from nlens_video.core.optics import Distortion
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.plate_pictures import PlatePictures

EFFECT = "distortion"
THRESHOLD_PX = 3.0
_WORK_WIDTH = 960
_SHORTEST = 0.2  # edge that counts [half diagonal]
_MOST_BENT = 0.06  # its sagitta by its length, more is a curve of the scene [1]
_LEAST_EDGES = 8
_LEAST_BETTER = 4
_CLEARLY = 0.8  # of the deviation that it was
_LEAST_CERTAINTY = 15.0
_LEAST_QUADRANTS = 2
_STRAIGHT_PX = 0.45  # what pixels of a straight edge lie off it
_MOST = 0.36  # coefficient
_LEAST_K1 = -4.0 / 27.0  # below it the corners of the frame have no ideal position: no lens
_MS_PER_MEGAPIXEL = 120.0

Edge = Float64
"""Places (N, 2) along an edge from the middle of the picture, columns and rows [half diagonal]."""


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on the first of a shot's pictures."""
    picture = pictures[0]
    half = 0.5 * math.hypot(picture.width, picture.height)
    edges, pixel = _edges(PlatePictures.of(pictures).codes())
    found = _fitted(edges, pixel)
    words = f"{len(edges)} long edges"
    if found is not None:
        words += (
            f": bent by {found.k1 * half:+.1f} px at the corner ({found.certainty:.0f} standard "
            f"errors; {found.better} of them straighter without it, {found.worse} less straight)"
        )
    model = Distortion(k1=found.k1) if found is not None and found.certain else None
    return Measurement(
        effect=EFFECT,
        value=0.0 if model is None else abs(model.k1) * half,
        threshold=THRESHOLD_PX,
        unit="px at the corner",
        evidence=words,
        model=model,
        cost_ms=_MS_PER_MEGAPIXEL * 0.2 * picture.width * picture.height / 1e6,
    )


class _Bent(Struct, frozen=True, kw_only=True):
    """Fit to all edges.

    Attributes:
        k1: coefficient that straightens most of them [1].
        certainty: of it, in standard errors [1].
        better: number of edges that are clearly straighter with it.
        worse: number of edges that are clearly less straight.
        quadrants: number of quadrants in which the better ones lie.
    """

    k1: float
    certainty: float
    better: int
    worse: int
    quadrants: int

    @property
    def certain(self) -> bool:
        return (
            self.k1 > _LEAST_K1
            and self.certainty >= _LEAST_CERTAINTY
            and self.better >= max(_LEAST_BETTER, 3 * self.worse)
            and self.quadrants >= _LEAST_QUADRANTS
        )


def _edges(rgb: Float32) -> tuple[list[Edge], float]:
    """Long and nearly straight edges, and the size of a pixel [half diagonal]."""
    step = max(1, math.ceil(rgb.shape[1] / _WORK_WIDTH))
    height, width = (side // step for side in rgb.shape[:2])
    grey = cv2.cvtColor(rgb[: height * step, : width * step], cv2.COLOR_RGB2GRAY)
    small = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    drawing = cv2.ximgproc.createEdgeDrawing()
    drawing.detectEdges(np.clip(255.0 * small, 0.0, 255.0).astype(np.uint8))
    half = 0.5 * math.hypot(width, height)
    centre = np.array([0.5 * width - 0.5, 0.5 * height - 0.5])
    fewest = max(2.0, _SHORTEST * half)  # neighbours touch: fewer pixels cannot span so much
    edges = []
    for chain in drawing.getSegments():
        if len(chain) >= fewest:
            places = (np.asarray(chain, np.float64).reshape(-1, 2) - centre) / half
            edges.extend(_straight_parts(places, fewest))
    return edges, 1.0 / half


def _straight_parts(places: Edge, fewest: float) -> list[Edge]:
    """The parts of a chain of pixels that are long and nearly straight, of `fewest` at least."""
    if len(places) < fewest:
        return []
    span = float(np.ptp(places, axis=0).max())
    if span < _SHORTEST:
        return []
    chord = places[-1] - places[0]
    length = float(np.hypot(*chord))
    away = np.abs(_cross(chord, places - places[0])) / max(length, 1e-9)
    worst = int(np.argmax(away))
    if length > 0.9 * span and away[worst] <= _MOST_BENT * length:
        inner = places[3:-3]  # corners are rounded
        return [inner] if length >= _SHORTEST and len(inner) > 20 else []
    cut = worst if length > 1e-6 else len(places) // 2
    cut = min(max(cut, 1), len(places) - 1)
    return [*_straight_parts(places[:cut], fewest), *_straight_parts(places[cut:], fewest)]


def _cross(one: Float64, many: Float64) -> Float64:
    return np.asarray(one[0] * many[:, 1] - one[1] * many[:, 0])


class _Lines:
    """All edges, and their deviations from straight lines for a coefficient."""

    def __init__(self, edges: list[Edge], pixel: float) -> None:
        self._places = np.ascontiguousarray(np.concatenate(edges).T)
        self._counts = np.array([len(edge) for edge in edges])
        self._starts = np.cumsum(self._counts) - self._counts
        self._far = np.hypot(*self._places)
        self._pixel = pixel
        self.middles = self._mean(self._places)

    def off_px(self, k1: float) -> Float64:
        """Deviation of each edge (E,) from its own best line [px]."""
        scale = undistorted_radius(k1, 0.0, self._far) / np.maximum(self._far, 1e-9)
        scale = np.where(np.isfinite(scale), scale, 1.0)
        places = self._places * scale
        x, y = places - np.repeat(self._mean(places), self._counts, axis=1)
        xx, xy, yy, shrunk = (self._mean(part) for part in (x * x, x * y, y * y, scale))
        least = 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
        return np.asarray(np.sqrt(np.maximum(least, 0.0)) / (shrunk * self._pixel))

    def cost(self, k1: float) -> float:
        """Misfit, robust against edges that are bent anyway."""
        return float(np.log1p((self.off_px(k1) / _STRAIGHT_PX) ** 2).sum())

    def _mean(self, values: Float64) -> Float64:
        """Means (..., E) of values (..., N) along the edges."""
        return np.asarray(np.add.reduceat(values, self._starts, axis=-1) / self._counts)


def _fitted(edges: list[Edge], pixel: float) -> _Bent | None:
    """The coefficient that straightens most of the edges."""
    if len(edges) < _LEAST_EDGES:
        return None
    lines = _Lines(edges, pixel)
    k1, step = 0.0, _MOST / 30.0
    trials = np.arange(-30, 31) * step
    for _ in range(4):
        k1 = float(min(trials, key=lines.cost))
        trials = k1 + np.linspace(-step, step, 11)
        step /= 5.0
    # curvature of the cost at its minimum, against the slopes of single edges
    near = 3e-3
    parts = [np.log1p((lines.off_px(k1 + d) / _STRAIGHT_PX) ** 2) for d in (-near, 0.0, near)]
    slopes = (parts[2] - parts[0]) / (2.0 * near)
    curvature = float((parts[2] - 2.0 * parts[1] + parts[0]).sum()) / near**2
    error = math.sqrt(float((slopes**2).sum())) / curvature if curvature > 0.0 else math.inf
    before, after = lines.off_px(0.0), lines.off_px(k1)
    better = after < _CLEARLY * before
    worse = (before < _CLEARLY * after) & (after > _STRAIGHT_PX)
    right, low = lines.middles[:, better] > 0
    return _Bent(
        k1=k1,
        certainty=abs(k1) / max(error, 1e-9),
        better=int(better.sum()),
        worse=int(worse.sum()),
        quadrants=len(np.unique(right * 2 + low)),
    )
