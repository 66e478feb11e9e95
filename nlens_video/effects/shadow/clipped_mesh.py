"""Triangles cut at heights: what can throw a shadow from a light on a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Bool, Float64
from nlens_video.effects.shadow.coverage import edges_of
from nlens_video.scene.gltf.meshes import Int32

_GRAZES = 1e-3  # of what stands above


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """Triangles, all of them on one side of a plane.

    Attributes:
        vertices: in the world (V, 3), and after that whatever else each vertex carries (V, 3 + C).
        faces: vertex indices (T, 3).
        edges: of the triangles (E, 4), as `edges_of` gives them.
    """

    vertices: Float64
    faces: Int32
    edges: Int32

    @classmethod
    def above(cls, vertices: Float64, faces: Int32, edges: Int32, height: float) -> Solid:
        """What lies above a height; triangles that cross it are cut.

        Feet that dip in by less than anybody sees are raised instead, which is much quicker.
        """
        above = vertices[:, 1] - height
        if 0.0 < -above.min(initial=0.0) <= _GRAZES * above.max(initial=0.0):
            vertices = vertices.copy()
            np.maximum(vertices[:, 1], height, out=vertices[:, 1])
            above = vertices[:, 1] - height
        return cls(vertices=vertices, faces=faces, edges=edges)._kept(above)

    def below(self, height: float) -> Solid:
        """What lies below a height; triangles that cross it are cut."""
        return self._kept(height - self.vertices[:, 1])

    @property
    def points(self) -> Float64:
        """Where the vertices are (V, 3)."""
        return self.vertices[:, :3]

    def _kept(self, distance: Float64) -> Solid:
        """The side on which the distance (V,) of a plane is not negative."""
        if (distance >= 0.0).all():
            return self
        inside = (distance >= 0.0)[self.faces]
        count = inside.sum(axis=1)
        points, pieces = [self.vertices], [np.zeros((0, 3), np.int32)]
        first = len(self.vertices)
        for wanted in (1, 2):  # corners inside
            crossing = self.faces[count == wanted]
            alone = inside[count == wanted] == (wanted == 1)
            lead = np.argmax(alone, axis=1)
            a, b, c = (crossing[np.arange(len(crossing)), (lead + k) % 3] for k in range(3))
            cuts = [_between(self.vertices, distance, a, other) for other in (b, c)]
            n = len(crossing)
            ab, ac = first + np.arange(n), first + n + np.arange(n)
            points += cuts
            first += 2 * n
            if wanted == 1:
                pieces.append(np.stack([a, ab, ac], axis=1))
            else:
                pieces += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
        cut = np.concatenate(pieces).astype(np.int32)
        whole = count == 3
        more = edges_of(cut)
        more[:, 2:][more[:, 2:] >= 0] += int(whole.sum())
        return Solid(
            vertices=np.concatenate(points),
            faces=np.ascontiguousarray(np.concatenate([self.faces[whole], cut])),
            edges=np.ascontiguousarray(np.concatenate([_without(self.edges, whole), more])),
        )


def _without(edges: Int32, whole: Bool) -> Int32:
    """Edges (E, 4) of those triangles that are left, by their new numbers."""
    number = np.append(np.where(whole, np.cumsum(whole) - 1, -1), -1).astype(np.int32)
    sides = number[edges[:, 2:]]
    left = (sides >= 0).any(axis=1)
    sides, ends = sides[left], edges[left, :2]
    back = sides[:, 0] < 0  # only the triangle that comes back along it is left
    ends[back], sides[back] = ends[back, ::-1], sides[back, ::-1]
    return np.concatenate([ends, sides], axis=1)


def _between(vertices: Float64, distance: Float64, a: Int32, b: Int32) -> Float64:
    part = distance[a] / (distance[a] - distance[b])
    return np.asarray(vertices[a] + part[:, None] * (vertices[b] - vertices[a]))
