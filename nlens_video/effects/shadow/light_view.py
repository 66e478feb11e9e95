"""The casters as a point of a light sees them: a shadow map (Williams 1978) of their outline.

The outline is exact, as on the ground. How far off the first surface lies is known on coarse cells
only: it tells things behind the object from things before it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.effects.shadow.ambient import surface_points
from nlens_video.effects.shadow.casters import Occluder
from nlens_video.effects.shadow.coverage import mark_covered
from nlens_video.effects.shadow.transparency import absorb, no_absorption

_LARGEST = 512  # side of a map [px]
_CELLS = 24  # each way, in which the nearest of the sampled points is kept
_WIDEST = 3.0  # tangent of the angle that a near lamp's map reaches to
_NOTHING = np.float32(-3.0e38)
SAMPLES = 2048
"""Points of a caster's surface."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledCasters:
    """Casters at one moment with points of their surfaces.

    Attributes:
        occluder: the casters.
        points: on all their surfaces (P, 3) [scene unit].
    """

    occluder: Occluder
    points: Float64

    @classmethod
    def of(cls, occluder: Occluder | None) -> SampledCasters | None:
        """The casters with their points; None for none."""
        if occluder is None:
            return None
        meshes = (occluder.opaque, *(mesh for mesh, _ in occluder.transparent))
        found = [surface_points(m.vertices, m.faces, SAMPLES) for m in meshes if len(m.faces)]
        return cls(occluder, np.concatenate(found))


@dataclass(frozen=True, slots=True, eq=False)
class LightView:
    """Where the line from a point of a light to any point meets a map of the casters.

    Attributes:
        matrix: world points to homogeneous places in the map and nearness to the light (3, 4):
            (column, row, nearness) of distant light, else (column * w, row * w, w), and the
            nearness is -w.
        far: whether the light is distant.
        size: columns and rows of the map [px].
        at: where in each pixel it is sampled [px].
        casters: what is drawn in it.
        number: of the light's point.
    """

    matrix: Float64
    far: bool
    size: tuple[int, int]
    at: tuple[float, float]
    casters: SampledCasters
    number: int

    @classmethod
    def of(
        cls, light: Float64, casters: SampledCasters, cell: float, at: tuple[float, float],
        number: int,
    ) -> LightView:  # fmt: skip
        """The view from a light (4,).

        Args:
            light: a place (x, y, z, 1), or a direction towards distant light (x, y, z, 0).
            casters: what it sees.
            cell: width of the map's pixels at the casters [scene unit].
            at: where in each pixel it is sampled [px].
            number: of the light's point, which decides where transparent surfaces let light pass.
        """
        bounds, far = casters.occluder.bounds, bool(light[3] == 0.0)
        middle = bounds.mean(axis=0)
        toward = light[:3] - (0.0 if far else middle)
        distance = float(np.linalg.norm(toward))
        axis = toward / max(distance, np.finfo(np.float64).tiny)
        first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(axis, first), axis if far else -axis])
        matrix = np.column_stack([axes, -axes @ (middle if far else light[:3])])
        corners = np.array([[*corner, 1.0] for corner in product(*bounds.T)]) @ matrix.T
        if not far:
            matrix[:2] *= distance
            ahead = np.maximum(corners[:, 2:], distance / _WIDEST)
            corners = distance * corners / ahead
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        if not far:
            low, high = (
                np.clip(end, -_WIDEST * distance, _WIDEST * distance) for end in (low, high)
            )
        cell = max(cell, float((high - low).max()) / _LARGEST)
        matrix[:2] /= cell
        shift = 1.0 - low / cell
        matrix[:2] += shift[:, None] * (np.eye(4)[3] if far else matrix[2])
        columns, rows = (max(1, math.ceil(side / cell)) + 2 for side in high - low)
        return cls(matrix, far, (columns, rows), at, casters, number)

    def places(self, points: Float32) -> tuple[Float32, Float32, Float32]:
        """Columns, rows [px] and nearness to the light of points (h, w, 3), each (h, w)."""
        seen = np.asarray(cv2.transform(points, self.matrix), dtype=np.float32)
        if self.far:
            return seen[..., 0], seen[..., 1], seen[..., 2]
        depth = seen[..., 2]
        before = np.maximum(depth, np.float32(1e-6))
        column = np.where(depth > 0.0, seen[..., 0] / before, np.float32(-1e4))
        return column.astype(np.float32), (seen[..., 1] / before).astype(np.float32), -depth

    def may_block(self, points: Float32) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Where (h, w) points (h, w, 3) may lie in the casters' shadow."""
        column, row, near = self.places(points)
        inside = (column >= 0.0) & (row >= 0.0) & (column <= self.size[0]) & (row <= self.size[1])
        return np.asarray(inside & (near < self._nearness().max()))

    def blocked(self, points: Float32) -> Float32:
        """Share of the light (h, w) that the casters keep from points (h, w, 3) [1]."""
        covered, first = self._map()
        column, row, near = self.places(points)
        column, row = column - np.float32(self.at[0]), row - np.float32(self.at[1])

        def looked_up(values: Float32, beyond: float) -> Float32:
            found = cv2.remap(
                values, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT,
                borderValue=beyond,
            )  # fmt: skip
            return np.asarray(found, dtype=np.float32)

        behind = near < looked_up(first, float(_NOTHING))
        if not self.casters.occluder.transparent:
            return behind.astype(np.float32)
        return looked_up(covered, 0.0) * behind

    def _map(self) -> tuple[Float32, Float32]:
        """Share of each pixel (h, w) that is covered, and the nearness of what covers it."""
        (columns, rows), occluder = self.size, self.casters.occluder
        homogeneous = self.matrix if not self.far else np.stack([*self.matrix[:2], np.eye(4)[3]])
        bits = np.zeros((rows, columns), np.uint8)
        opaque = occluder.opaque
        triangles = (opaque.vertices, opaque.faces, opaque.edges)
        mark_covered(bits, triangles, [(0, homogeneous, self.at)])
        covered = bits.astype(np.float32)
        if occluder.transparent:
            absorption = no_absorption(rows, columns)
            for mesh, opacity in occluder.transparent:
                points = mesh.vertices[:, :3] @ homogeneous[:, :3].T + homogeneous[:, 3]
                surface = np.ascontiguousarray(mesh.vertices[:, 3:])
                texture = (opacity.alpha, opacity.wrap, opacity.cutoff)
                absorb(
                    absorption, (bits, 0), points, surface, mesh.faces, texture, self.number + 1,
                    self.at,
                )  # fmt: skip
            covered += absorption.taken
        return covered, np.where(covered > 0.0, self._first(), _NOTHING)

    def _nearness(self) -> Float64:
        """Nearness to the light of the casters' points (P,)."""
        seen = self.casters.points @ self.matrix[2, :3] + self.matrix[2, 3]
        return np.asarray(seen if self.far else -seen)

    def _first(self) -> Float32:
        """Nearness of the first surface at each pixel of the map (h, w), from coarse cells."""
        columns, rows = self.size
        side = max(1, math.ceil(max(self.size) / _CELLS))
        shape = -(-rows // side), -(-columns // side)
        points = self.casters.points.astype(np.float32)[None]
        column, row, near = (part[0] for part in self.places(points))
        cells = np.full(shape, near.min(), np.float32)
        at = (
            (row / side).astype(int).clip(0, shape[0] - 1),
            (column / side).astype(int).clip(0, shape[1] - 1),
        )
        np.maximum.at(cells, at, near)
        # a cell without a point, or with one on a farther part only, takes its neighbours'
        cells = np.asarray(cv2.dilate(cells, np.ones((3, 3), np.uint8)), dtype=np.float32)
        return np.kron(cells, np.ones((side, side), np.float32))[:rows, :columns]
