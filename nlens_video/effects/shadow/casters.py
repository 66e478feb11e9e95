"""Shadow casters: opaque and partly transparent triangles, clipped at heights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.effects.shadow.coverage import edges_of
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.meshes import Geometry, Int32
from nlens_video.scene.posed import PosedMesh, PosedScene

MIRRORED, CLAMPED = 33648, 33071  # glTF's codes of what lies beyond a texture's edge
_OPAQUE = 254.5 / 255.0


@dataclass(frozen=True, slots=True, eq=False)
class Opacity:
    """How much light a surface stops.

    Attributes:
        alpha: of its texture (H, W), row 0 at v = 0; one texel of 1 where it has none [1].
        wrap: what lies beyond the texture's edges along u and v: 0 repeated, 1 mirrored, 2 clamped.
        cutoff: alpha from which on it stops all, below which none; negative: it stops its alpha.
    """

    alpha: Float32
    wrap: tuple[int, int]
    cutoff: float


@dataclass(frozen=True, slots=True, eq=False)
class CasterGeometry:
    """What is the same of a geometry at all times.

    Attributes:
        opacity: how much light it stops, None where it stops all.
        edges: of its triangles, as `edges_of` gives them; none where they are not asked for (E, 4).
    """

    opacity: Opacity | None
    edges: Int32

    @classmethod
    def of(cls, geometry: Geometry) -> CasterGeometry:
        """See what a geometry is to light."""
        opacity = opacity_of(geometry)
        faces = geometry.faces
        return cls(opacity, edges_of(faces if opacity is None else faces[:0]))


@dataclass(frozen=True, slots=True, eq=False)
class TransparentCaster:
    """Triangles that are not opaque everywhere.

    Attributes:
        vertices: place in the world, texture coordinates and factor of alpha (V, 6).
        faces: vertex indices (T, 3).
        opacity: how much they stop.
    """

    vertices: Float64
    faces: Int32
    opacity: Opacity


@dataclass(frozen=True, slots=True, eq=False)
class Casters:
    """All that throws a shadow at one moment.

    Attributes:
        vertices: of what is opaque, in the world (V, 3) [scene unit].
        faces: vertex indices of its triangles (T, 3).
        edges: of its triangles, as `edges_of` gives them (E, 4).
        veils: the rest.
    """

    vertices: Float64
    faces: Int32
    edges: Int32
    veils: tuple[TransparentCaster, ...] = ()

    @classmethod
    def of(cls, posed: PosedScene, surfaces: dict[Geometry, CasterGeometry]) -> Casters:
        """Sort a scene's triangles.

        Args:
            posed: the scene.
            surfaces: kept from one moment to the next: what is known of each geometry; filled in.
        """
        solid: list[PosedMesh] = []
        veils: list[TransparentCaster] = []
        for mesh in posed.meshes:
            geometry = mesh.geometry
            if geometry not in surfaces:
                surfaces[geometry] = CasterGeometry.of(geometry)
            opacity = surfaces[geometry].opacity
            if opacity is None:
                solid.append(mesh)
            else:
                carried = np.concatenate([mesh.positions, _carried(geometry)], axis=1)
                veils.append(TransparentCaster(carried.astype(np.float64), mesh.faces, opacity))
        if not solid:
            nothing = np.zeros((0, 4), np.int32)
            return cls(np.zeros((0, 3)), nothing[:, :3], nothing, tuple(veils))
        vertices, faces = PosedScene(posed.time_s, tuple(solid), ()).triangles()
        edges = _joined([surfaces[mesh.geometry].edges for mesh in solid], solid)
        return cls(vertices.astype(np.float64), faces, edges, tuple(veils))


def _joined(edges: list[Int32], meshes: list[PosedMesh]) -> Int32:
    """Edges of meshes, by the numbers that vertices and triangles have in all of them together."""
    vertex = triangle = 0
    moved = []
    for own, mesh in zip(edges, meshes, strict=True):
        sides = np.where(own[:, 2:] >= 0, own[:, 2:] + triangle, -1)
        moved.append(np.concatenate([own[:, :2] + vertex, sides], axis=1))
        vertex += len(mesh.positions)
        triangle += len(mesh.faces)
    return np.ascontiguousarray(np.concatenate(moved), dtype=np.int32)


def opacity_of(geometry: Geometry) -> Opacity | None:
    """How much light a geometry stops; None where it stops all."""
    material = geometry.material
    if material.alpha_mode == "OPAQUE":
        return None
    use = material.base_color_texture
    alpha = np.ones((1, 1), np.float32)
    wrap = (0, 0)
    if use is not None:
        alpha = use.image.pixels[..., 3].astype(np.float32) / np.float32(255.0)
        wrap = (_wrapped(use.image.wrap[0]), _wrapped(use.image.wrap[1]))
    cutoff = material.alpha_cutoff if material.alpha_mode == "MASK" else -1.0
    least = float(alpha.min()) * float(_factor(geometry, material).min(initial=1.0))
    if least >= (cutoff if cutoff >= 0.0 else _OPAQUE):
        return None
    return Opacity(np.ascontiguousarray(alpha), wrap, cutoff)


def _wrapped(code: int) -> int:
    return {MIRRORED: 1, CLAMPED: 2}.get(code, 0)


def _factor(geometry: Geometry, material: Material) -> Float32:
    """What the texture's alpha is multiplied by at each vertex (V,) [1]."""
    factor = np.full(len(geometry.positions), material.base_color[3], np.float32)
    return factor if geometry.colors is None else factor * geometry.colors[:, 3]


def _carried(geometry: Geometry) -> Float32:
    """Texture coordinates, as the picture has them, and factor of alpha (V, 3)."""
    use = geometry.material.base_color_texture
    uv = np.zeros((len(geometry.positions), 2), np.float32)
    if use is not None:
        own = geometry.uv[:, 2 * use.uv_set : 2 * use.uv_set + 2]
        rows = np.array(use.transform, np.float32)
        uv = own @ rows[:, :2].T + rows[:, 2]
    return np.column_stack([uv, _factor(geometry, geometry.material)])


_GRAZES = 1e-3  # of what stands above


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClippedMesh:
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
    def above(cls, vertices: Float64, faces: Int32, edges: Int32, height: float) -> ClippedMesh:
        """What lies above a height; triangles that cross it are cut.

        Feet that dip in by less than anybody sees are raised instead, which is much quicker.
        """
        above = vertices[:, 1] - height
        if 0.0 < -above.min(initial=0.0) <= _GRAZES * above.max(initial=0.0):
            vertices = vertices.copy()
            np.maximum(vertices[:, 1], height, out=vertices[:, 1])
            above = vertices[:, 1] - height
        return cls(vertices=vertices, faces=faces, edges=edges)._kept(above)

    def below(self, height: float) -> ClippedMesh:
        """What lies below a height; triangles that cross it are cut."""
        return self._kept(height - self.vertices[:, 1])

    @property
    def points(self) -> Float64:
        """Where the vertices are (V, 3)."""
        return self.vertices[:, :3]

    def _kept(self, distance: Float64) -> ClippedMesh:
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
        return ClippedMesh(
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
