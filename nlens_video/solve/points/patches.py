"""Patches around points, kept from where each was first seen, and found again turned and stretched.

Steps from frame to frame add up their errors; a comparison with the first patch does not. It is
Lucas-Kanade's inverse compositional fit of an affine map (Baker and Matthews, "Lucas-Kanade 20
years on", 2004), all points at once, with each patch's mean and contrast taken out.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float32

_RADIUS_PX = 9
_SPREAD_PX = 5.0  # of the weight around a patch's middle
_ROUNDS = 3
_SETTLED_PX = 0.02
_FARTHEST_PX = 2.0  # from where the last step put it: farther is another thing
_LEAST_ALIKE = 0.75  # correlation of two patches
_LEAST_AREA, _MOST_AREA = 0.6, 1.7  # of a patch by its first one, before it is taken anew [1]
_LEAST_TEXTURE = 1e-3

_GRID = np.mgrid[-_RADIUS_PX : _RADIUS_PX + 1, -_RADIUS_PX : _RADIUS_PX + 1].astype(np.float32)
_X, _Y = _GRID[1].ravel(), _GRID[0].ravel()
_WEIGHT = np.exp(-0.5 * (_X**2 + _Y**2) / _SPREAD_PX**2).astype(np.float32)
_WEIGHT /= _WEIGHT.sum()
_SIDE = 2 * _RADIUS_PX + 1


@dataclass(slots=True)
class Patches:
    """The first patches of points, and how each is turned and stretched now."""

    _patches: Float32 = field(default_factory=lambda: np.zeros((0, _SIDE**2), np.float32))
    _steps: Float32 = field(default_factory=lambda: np.zeros((0, 6, _SIDE**2), np.float32))
    _maps: Float32 = field(default_factory=lambda: np.zeros((0, 2, 2), np.float32))

    def add(self, luma: npt.NDArray[np.uint8], points: Float32) -> None:
        """Keep the patches of new points (N, 2), after those that are there."""
        patches, steps = _prepared(luma, points)
        self._patches = np.concatenate([self._patches, patches])
        self._steps = np.concatenate([self._steps, steps])
        same = np.broadcast_to(np.eye(2, dtype=np.float32), (len(points), 2, 2))
        self._maps = np.concatenate([self._maps, same])

    def keep(self, kept: Bool) -> None:
        """Drop the patches of points that are lost."""
        self._patches, self._steps = self._patches[kept], self._steps[kept]
        self._maps = self._maps[kept]

    def find(self, luma: npt.NDArray[np.uint8], points: Float32) -> tuple[Float32, Bool]:
        """Where the patches lie.

        Args:
            luma: the next picture (H, W).
            points: about where they lie (N, 2), pixel centres at whole numbers [px].

        Returns:
            Places (N, 2) [px], and which of them show what the first patch showed (N,).
        """
        places, maps = points.astype(np.float32), self._maps.copy()
        moving = np.arange(len(points))
        alike = np.zeros(len(points), np.float32)
        for _ in range(_ROUNDS):
            if not len(moving):
                break
            seen = _normal(_sampled(luma, places[moving], maps[moving]))
            away = seen - self._patches[moving]
            alike[moving] = 1.0 - 0.5 * (away**2) @ _WEIGHT
            change = np.einsum("nps,ns->np", self._steps[moving], away)
            undone = np.linalg.inv(np.eye(2, dtype=np.float32) + change[:, 2:].reshape(-1, 2, 2))
            maps[moving] = maps[moving] @ undone
            shift = -np.einsum("nij,nj->ni", maps[moving], change[:, :2])
            places[moving] += shift
            moving = moving[np.abs(shift).max(axis=1) > _SETTLED_PX]
        area = np.linalg.det(maps)
        found = (alike > _LEAST_ALIKE) & (area > 0.25 * _LEAST_AREA) & np.isfinite(area)
        found &= np.linalg.norm(places - points, axis=1) < _FARTHEST_PX
        self._maps = maps
        changed = np.flatnonzero(found & ((area < _LEAST_AREA) | (area > _MOST_AREA)))
        if len(changed):
            self._patches[changed], self._steps[changed] = _prepared(luma, places[changed])
            self._maps[changed] = np.eye(2)
        return places, found


def _sampled(luma: npt.NDArray[np.uint8], places: Float32, maps: Float32) -> Float32:
    """Patches under affine maps (N, S)."""
    x = maps[:, 0, :1] * _X + maps[:, 0, 1:] * _Y + places[:, :1]
    y = maps[:, 1, :1] * _X + maps[:, 1, 1:] * _Y + places[:, 1:]
    found = cv2.remap(luma, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return found.astype(np.float32)


def _normal(patches: Float32) -> Float32:
    """Patches of mean 0 and deviation 1 under the weight."""
    patches = patches - (patches @ _WEIGHT)[:, None]
    spread = np.sqrt(patches**2 @ _WEIGHT)[:, None]
    return np.asarray(patches / np.maximum(spread, _LEAST_TEXTURE))


def _prepared(luma: npt.NDArray[np.uint8], points: Float32) -> tuple[Float32, Float32]:
    """Patches (N, S), and what a difference from them says of shift and stretch (N, 6, S)."""
    same = np.broadcast_to(np.eye(2, dtype=np.float32), (len(points), 2, 2))
    patches = _normal(_sampled(luma, points, same))
    square = patches.reshape(-1, _SIDE, _SIDE)
    down = np.asarray(np.gradient(square, axis=1)).reshape(len(points), -1)
    across = np.asarray(np.gradient(square, axis=2)).reshape(len(points), -1)
    slopes = np.stack([across, down, across * _X, across * _Y, down * _X, down * _Y], axis=1)
    weighed = slopes * _WEIGHT
    normal = np.einsum("nps,nqs->npq", weighed, slopes)
    scale = np.trace(normal[:, :2, :2], axis1=1, axis2=2)[:, None, None]
    guard = np.diag([1e-3, 1e-3, 0.3, 0.3, 0.3, 0.3]).astype(np.float32)
    steps = np.linalg.solve(normal + np.maximum(scale, 1e-6) * guard, weighed)
    return patches, np.asarray(steps, np.float32)
