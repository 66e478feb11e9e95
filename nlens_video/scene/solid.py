"""Triangles cut at heights: what can throw a shadow from a light on a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.frames import Float64
from nlens_video.scene.mesh import Int32


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """Triangles, all of them above the ground.

    Attributes:
        vertices: in the world (V, 3), and after that whatever else each vertex carries (V, 3 + C).
        faces: vertex indices (T, 3).
    """

    vertices: Float64
    faces: Int32

    @classmethod
    def above(cls, vertices: Float64, faces: Int32, height: float) -> Solid:
        """What lies above a height; triangles that cross it are cut."""
        return cls._kept(vertices, faces, vertices[:, 1] - height)

    def below(self, height: float) -> Solid:
        """What lies below a height; triangles that cross it are cut."""
        return self._kept(self.vertices, self.faces, height - self.vertices[:, 1])

    @property
    def points(self) -> Float64:
        """Where the vertices are (V, 3)."""
        return self.vertices[:, :3]

    @property
    def used(self) -> Float64:
        """Where the corners of its triangles are (3 T, 3)."""
        return np.asarray(self.points[self.faces.ravel()])

    @classmethod
    def _kept(cls, vertices: Float64, faces: Int32, distance: Float64) -> Solid:
        """The side on which the distance (V,) of a plane is not negative."""
        inside = (distance >= 0.0)[faces]
        count = inside.sum(axis=1)
        kept = [faces[count == 3]]
        points = [vertices]
        first = len(vertices)
        for wanted in (1, 2):  # corners inside
            crossing = faces[count == wanted]
            alone = inside[count == wanted] == (wanted == 1)
            lead = np.argmax(alone, axis=1)
            a, b, c = (crossing[np.arange(len(crossing)), (lead + k) % 3] for k in range(3))
            cuts = [_between(vertices, distance, a, other) for other in (b, c)]
            n = len(crossing)
            ab, ac = first + np.arange(n), first + n + np.arange(n)
            points += cuts
            first += 2 * n
            if wanted == 1:
                kept.append(np.stack([a, ab, ac], axis=1))
            else:
                kept += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
        return cls(
            vertices=np.concatenate(points),
            faces=np.ascontiguousarray(np.concatenate(kept), dtype=np.int32),
        )


def _between(vertices: Float64, distance: Float64, a: Int32, b: Int32) -> Float64:
    part = distance[a] / (distance[a] - distance[b])
    return np.asarray(vertices[a] + part[:, None] * (vertices[b] - vertices[a]))
