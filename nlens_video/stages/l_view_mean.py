"""The mean of an object's pictures from points of the aperture, which the barrel hides in part."""

from __future__ import annotations

import threading

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float32
from nlens_video.core.optics import Aperture
from nlens_video.kernels.scatter.shape import barrel_centre, outer_radius
from nlens_video.stages.l_aperture_samples import LensPoints


class ViewMean:
    """Sums views up in their order, whichever is ready first: any number of threads may add."""

    def __init__(self, frame: Box, points: LensPoints, vignette: Vignette | None) -> None:
        self._frame, self._points, self._vignette = frame, points, vignette
        self._total = np.zeros((frame.height, frame.width, 4), np.float32)
        self._box = Box(0, 0, 0, 0)
        self._ready: dict[int, BlurredLayer] = {}
        self._next = 0
        self._lock = threading.Lock()

    def add(self, at: int, part: BlurredLayer) -> None:
        """Add a view; it is kept until those before it are added."""
        with self._lock:
            self._ready[at] = part
            while self._next in self._ready:
                self._sum_up(self._next, self._ready.pop(self._next))
                self._next += 1

    def _sum_up(self, at: int, part: BlurredLayer) -> None:
        if part.box.empty:
            return
        weight = np.float32(self._points.weights[at])
        shaded = weight if self._vignette is None else self._vignette.weight(at, part.box)
        self._total[part.box.slices_in(self._frame)] += shaded * part.rgba
        self._box = self._box.union(part.box)

    @property
    def layer(self) -> BlurredLayer:
        """The mean, on the pixels that any view reaches."""
        return BlurredLayer(box=self._box, rgba=self._total[self._box.slices_in(self._frame)])


class Vignette:
    """Weights of the views where the barrel hides part of the aperture."""

    def __init__(self, frame: Box, points: LensPoints, aperture: Aperture) -> None:
        self._frame, self._points, self._aperture = frame, points, aperture
        self._rim = outer_radius(aperture)
        self._total = np.zeros((frame.height, frame.width, 1), np.float32)
        for at in range(len(points.weights)):
            self._total += self._seen(at, frame)

    def weight(self, at: int, box: Box) -> Float32:
        """Weight (h, w, 1) of a view on a box of the frame; over all views they sum to 1."""
        return np.asarray(self._seen(at, box) / self._total[box.slices_in(self._frame)])

    def _seen(self, at: int, box: Box) -> Float32:
        # points are places before the focus, the barrel lies as a highlight behind it shows it
        u, v = -self._points.places[at]
        columns = np.arange(box.x0, box.x1, dtype=np.float64) + 0.5
        rows = np.arange(box.y0, box.y1, dtype=np.float64) + 0.5
        size = (self._frame.width, self._frame.height)
        x, y = barrel_centre(self._aperture, columns, rows, size)
        off = np.hypot(u - x[None, :], v - y[:, None])
        share = np.clip((self._rim - off) / (2.0 * self._points.radii[at]) + 0.5, 0.0, 1.0)
        seen = self._points.weights[at] * np.maximum(share, 1e-6)
        return np.asarray(seen[..., None], dtype=np.float32)
