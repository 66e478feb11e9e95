"""A scene at one moment: world-space triangles and lights; a cache of the last few moments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.scene.gltf.lights import PosedLight
from nlens_video.scene.gltf.meshes import Geometry, Int32


@dataclass(frozen=True, slots=True, eq=False)
class PosedMesh:
    """One primitive of one instance.

    Attributes:
        geometry: topology, texture coordinates and material; the same object at all times.
        positions: world positions (V, 3) [scene unit].
        normals: unit normals (V, 3) in the world, out of the surface.
        mirrored: whether faces appear clockwise from the front.
    """

    geometry: Geometry
    positions: Float32
    normals: Float32
    mirrored: bool

    @property
    def faces(self) -> Int32:
        """Vertex indices of triangles (F, 3)."""
        return self.geometry.faces


@dataclass(frozen=True, slots=True, eq=False)
class PosedScene:
    """Triangles and lights at one time.

    Attributes:
        time_s: the time [s].
        meshes: primitives in the file's order; the order is the same at all times.
        lights: lights in the file's order.
    """

    time_s: float
    meshes: tuple[PosedMesh, ...]
    lights: tuple[PosedLight, ...]

    def vertices(self) -> Float32:
        """All world positions (V, 3) [scene unit]."""
        return np.concatenate([mesh.positions for mesh in self.meshes])

    def triangles(self) -> tuple[Float32, Int32]:
        """All world positions (V, 3) [scene unit] and the faces (F, 3) that index them."""
        starts = np.cumsum([0] + [len(mesh.positions) for mesh in self.meshes])
        faces = [
            mesh.faces + np.int32(start)
            for mesh, start in zip(self.meshes, starts[:-1], strict=True)
        ]
        return self.vertices(), np.concatenate(faces)

    def bounds(self) -> Float32:
        """Lowest and highest corner (2, 3) of the box around all vertices [scene unit]."""
        lows = [mesh.positions.min(axis=0) for mesh in self.meshes]
        highs = [mesh.positions.max(axis=0) for mesh in self.meshes]
        return np.stack([np.min(lows, axis=0), np.max(highs, axis=0)])


Value = TypeVar("Value")
_MOMENTS = 4  # the frame's own, and the shutter opening and closing


@dataclass(slots=True)
class MomentCache(Generic[Value]):
    """Values of the last few moments, which several stages need."""

    _kept: dict[float, Value] = field(default_factory=dict)

    def at(self, time_s: float, compute: Callable[[float], Value]) -> Value:
        """The same object as before for a moment [s] that is known, else what `compute` gives."""
        known = self._kept.get(time_s)
        if known is None:
            known = compute(time_s)
            if len(self._kept) >= _MOMENTS:
                self._kept.pop(next(iter(self._kept)), None)
            self._kept[time_s] = known
        return known
