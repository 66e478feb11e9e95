"""Shadow casters: opaque and transparent triangles above the ground, and their projection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.effects.shadow.coverage import edges_of
from nlens_video.render.base.opacity import Opacities, Opacity
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf.meshes import Geometry, Int32
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.posed import PosedMesh, PosedScene
from nlens_video.scene.welding import welded_faces

_GRAZES = 1e-3  # depth below the plane, by the height above it, that is not seen: raising is quick
_NO_EDGES = np.zeros((0, 4), np.int32)
_TOGETHER = 4096  # vertices of transparent meshes that are drawn at once: they stay in a cache


@dataclass(slots=True, eq=False)
class CasterCache:
    """What is kept from frame to frame: opacities, triangles of opaque geometries, last casters.

    Attributes:
        opacities: of the geometries.
        last: the meshes that were asked for before, and the casters that they make.
    """

    opacities: Opacities = field(default_factory=Opacities)
    last: tuple[tuple[PosedMesh, ...], Casters] | None = None
    _joined: dict[tuple[Geometry, ...], tuple[Int32, Int32]] = field(default_factory=dict)

    def joined(self, geometries: tuple[Geometry, ...]) -> tuple[Int32, Int32]:
        """Faces (T, 3) of all geometries, which index their vertices together, and their edges.

        Of vertices that are repeated at creases one is used, so that triangles share edges there.
        """
        if geometries not in self._joined:
            starts = np.cumsum([0, *(len(one.positions) for one in geometries[:-1])])
            faces = [
                welded_faces(one) + start for one, start in zip(geometries, starts, strict=True)
            ]
            together = np.ascontiguousarray(np.concatenate(faces), dtype=np.int32)
            self._joined[geometries] = together, edges_of(together)
        return self._joined[geometries]


class TransparentCaster(Struct, frozen=True, eq=False):
    """Triangles that are not opaque everywhere.

    Attributes:
        vertices: world position, texture coordinates and factor of alpha (V, 6).
        faces: vertex indices (T, 3).
        opacity: of their surface.
    """

    vertices: Float32 | Float64
    faces: Int32
    opacity: Opacity


class Casters(Struct, frozen=True, eq=False):
    """All shadow casters at one moment.

    Attributes:
        vertices: of the opaque triangles, in the world (V, 3) [scene unit].
        faces: vertex indices of these triangles (T, 3).
        edges: of these triangles, as `edges_of` gives them (E, 4).
        transparent: the other triangles.
    """

    vertices: Float32 | Float64
    faces: Int32
    edges: Int32
    transparent: tuple[TransparentCaster, ...] = ()

    @property
    def count(self) -> int:
        """Number of vertices."""
        return len(self.vertices) + sum(len(one.vertices) for one in self.transparent)

    @classmethod
    def of(cls, posed: PosedScene, cache: CasterCache) -> Casters:
        """What is drawn of a scene; the same object as before while that rests."""
        drawn = posed.drawn
        if cache.last is None or cache.last[0] != drawn:  # meshes are equal by identity
            cache.last = drawn, cls._made_of(drawn, cache)
        return cache.last[1]

    @classmethod
    def _made_of(cls, drawn: tuple[PosedMesh, ...], cache: CasterCache) -> Casters:
        opaque: list[PosedMesh] = []
        transparent: list[TransparentCaster] = []
        for mesh in drawn:
            opacity = cache.opacities.of(mesh.geometry)
            if opacity is None:
                opaque.append(mesh)
            else:
                surface = cache.opacities.texturing(mesh.geometry)
                vertices = np.concatenate([mesh.positions, surface], axis=1)
                transparent.append(TransparentCaster(vertices, mesh.faces, opacity))
        if not opaque:
            return cls(np.zeros((0, 3)), _NO_EDGES[:, :3], _NO_EDGES, tuple(transparent))
        faces, edges = cache.joined(tuple(mesh.geometry for mesh in opaque))
        # one mesh is not copied: the frames between two lanes would hold all moments twice
        alone = len(opaque) == 1
        places = opaque[0].positions if alone else np.concatenate([m.positions for m in opaque])
        return cls(places, faces, edges, tuple(transparent))


class Moment(Struct, frozen=True, eq=False):
    """Shadow casters and camera at one moment."""

    casters: Casters
    camera: Camera


class FrameCasters(Struct, frozen=True, kw_only=True, eq=False):
    """What casts a frame's shadow, and by which light.

    Attributes:
        moments: an odd number of temporal samples; the frame's own time is in the middle.
        light: on the ground.
        pose: the scene at the frame's own time.
        camera: likewise.
    """

    moments: tuple[Moment, ...]
    light: Illumination
    pose: PosedScene
    camera: Camera


class ClippedMesh(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """Triangles, all of them on one side of a horizontal plane.

    Attributes:
        vertices: world positions (V, 3), and further attributes of each vertex (V, 3 + C).
        faces: vertex indices (T, 3).
        edges: of the triangles (E, 4), as `edges_of` gives them.
    """

    vertices: Float64
    faces: Int32
    edges: Int32

    @classmethod
    def above(cls, vertices: Float64, faces: Int32, edges: Int32, height: float) -> ClippedMesh:
        """Triangles clipped to what lies above a height; feet that barely dip in are raised."""
        above = vertices[:, 1] - height
        if 0.0 < -above.min(initial=0.0) <= _GRAZES * above.max(initial=0.0):
            vertices = vertices.copy()
            np.maximum(vertices[:, 1], height, out=vertices[:, 1])
            above = vertices[:, 1] - height
        return cls(vertices=vertices, faces=faces, edges=edges)._clipped(above)

    @classmethod
    def joined(cls, meshes: Sequence[ClippedMesh]) -> ClippedMesh:
        """The triangles of all, in their order, without edges; the same object for a single one."""
        if len(meshes) == 1:
            return meshes[0]
        starts = np.cumsum([0, *(len(one.vertices) for one in meshes[:-1])], dtype=np.int32)
        faces = [one.faces + start for one, start in zip(meshes, starts, strict=True)]
        vertices = np.concatenate([one.vertices for one in meshes])
        return cls(vertices=vertices, faces=np.concatenate(faces), edges=_NO_EDGES)

    @cached_property
    def places(self) -> Float64:
        """World positions and 1 (V, 4), coordinate by coordinate, to be multiplied by matrices."""
        return np.asfortranarray(np.insert(self.vertices[:, :3], 3, 1.0, axis=1))

    @cached_property
    def surface(self) -> Float64:
        """The further attributes (V, C)."""
        return np.ascontiguousarray(self.vertices[:, 3:])

    def below(self, height: float) -> ClippedMesh:
        """The mesh clipped to what lies below a height."""
        return self._clipped(height - self.vertices[:, 1])

    def _clipped(self, distance: Float64) -> ClippedMesh:
        """The side of a plane on which the distance (V,) is not negative."""
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
            points += [_between(self.vertices, distance, a, other) for other in (b, c)]
            n = len(crossing)
            ab, ac = first + np.arange(n), first + n + np.arange(n)
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
    """Edges (E, 4) of the triangles that remain, with their new indices."""
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


class Occluder(Struct, frozen=True, eq=False, dict=True):
    """Shadow casters above a ground plane, at one moment.

    Attributes:
        camera: the camera.
        opaque: the opaque triangles above the ground.
        transparent: the other triangles above the ground, with their opacity.
        ground_y: height of the ground plane [scene unit].
        bounds: least and greatest coordinates of the vertices (2, 3) [scene unit].
    """

    camera: Camera
    opaque: ClippedMesh
    transparent: tuple[tuple[ClippedMesh, Opacity], ...]
    ground_y: float
    bounds: Float64

    @classmethod
    def of(cls, casters: Casters, camera: Camera, ground_y: float) -> Occluder | None:
        """The casters above the ground; None where there are none."""
        vertices = casters.vertices.astype(np.float64)
        opaque = ClippedMesh.above(vertices, casters.faces, casters.edges, ground_y)
        through = ((one.vertices.astype(np.float64), one) for one in casters.transparent)
        transparent = tuple(
            (ClippedMesh.above(places, one.faces, _NO_EDGES, ground_y), one.opacity)
            for places, one in through
        )
        meshes = [mesh for mesh in (opaque, *(one for one, _ in transparent)) if len(mesh.faces)]
        if not meshes:
            return None
        # coordinate by coordinate: NumPy is slow along an axis of three
        x, y, z = np.concatenate([mesh.vertices[:, :3].T for mesh in meshes], axis=1)
        above = y >= ground_y
        kept = (x, y, z) if above.all() else (x[above], y[above], z[above])
        bounds = np.array([[one.min() for one in kept], [one.max() for one in kept]])
        return cls(camera, opaque, transparent, ground_y, bounds)

    @cached_property
    def veils(self) -> tuple[tuple[ClippedMesh, Opacity], ...]:
        """`transparent`, with small meshes joined that follow each other and have one opacity."""
        groups: list[tuple[Opacity, list[ClippedMesh]]] = []
        size = 0
        for mesh, opacity in self.transparent:
            size += len(mesh.vertices)
            if not groups or groups[-1][0] is not opacity or size > _TOGETHER:
                groups.append((opacity, []))
                size = len(mesh.vertices)
            groups[-1][1].append(mesh)
        return tuple((ClippedMesh.joined(meshes), opacity) for opacity, meshes in groups)
