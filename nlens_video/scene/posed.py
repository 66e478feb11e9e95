"""Posed geometry: world-space vertices at one moment (morph, then skin or node)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeVar, cast

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.native import kernels
from nlens_video.scene.gltf.animation_kernels import normal_matrices
from nlens_video.scene.gltf.meshes import Geometry, Int32, face_normals
from nlens_video.scene.gltf.nodes import Skin
from nlens_video.scene.illumination import PosedLight

_Points = TypeVar("_Points", Float32, Float64)
_SINGULAR = 1e-9  # size along an axis by that along the longest, which is none [1]
_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T  # of a box, 0 for the lower end of an axis


class PosedMesh(Struct, frozen=True, eq=False):
    """One primitive of one instance.

    Attributes:
        geometry: topology, texture coordinates and material; the same object at all times.
        positions: world positions (V, 3) [scene unit].
        normals: unit normals (V, 3) in the world, out of the surface.
        mirrored: whether faces appear clockwise from the front.
        drawn: whether any of its triangles may have an area, which a scale of 0 takes from all.
        near: the same with the scene's `origin` as that of the world; None where it has none.
    """

    geometry: Geometry
    positions: Float32
    normals: Float32
    mirrored: bool
    drawn: bool = True
    near: PosedMesh | None = None

    @property
    def faces(self) -> Int32:
        """Vertex indices of triangles (F, 3)."""
        return self.geometry.faces

    def exact(self, origin: Float64 | None) -> Float64:
        """World positions (V, 3), for the scene's `origin` [scene unit]."""
        if self.near is None or origin is None:
            return self.positions.astype(np.float64)
        return self.near.positions + origin


class PosedScene(Struct, frozen=True, eq=False):
    """Triangles and lights at one time.

    Attributes:
        time_s: the time [s].
        meshes: primitives in the file's order; the order is the same at all times.
        lights: lights in the file's order.
        origin: a point (3,) in the midst of a scene that lies so far from the world's origin that
            float32 holds its positions badly; None for others [scene unit].
    """

    time_s: float
    meshes: tuple[PosedMesh, ...]
    lights: tuple[PosedLight, ...]
    origin: Float64 | None = None

    def about_origin(self) -> PosedScene:
        """The same in a world with `origin` as its own, whose positions float32 holds well."""
        if self.origin is None:
            return self
        lights = (replace(one, position=one.position - self.origin) for one in self.lights)
        meshes = tuple(mesh.near or mesh for mesh in self.meshes)
        return PosedScene(self.time_s, meshes, tuple(lights))

    @property
    def drawn(self) -> tuple[PosedMesh, ...]:
        """Those of the meshes that are drawn; none where all are scaled to 0."""
        return tuple(mesh for mesh in self.meshes if mesh.drawn)

    def vertices(self) -> Float32:
        """World positions (V, 3) of what is drawn, of all where nothing is [scene unit].

        In float64 where float32 holds them badly.
        """
        return self._positions(self.drawn or self.meshes)

    def points(self) -> tuple[Float32, Bool]:
        """All positions (V, 3), as many at all times, and which of them are drawn (V,)."""
        drawn = np.repeat(
            [mesh.drawn for mesh in self.meshes], [len(mesh.positions) for mesh in self.meshes]
        )
        return self._positions(self.meshes), drawn

    def _positions(self, meshes: Sequence[PosedMesh]) -> Float32:
        if self.origin is None:
            return np.concatenate([mesh.positions for mesh in meshes])
        # few callers ask for the type, and those convert
        return cast("Float32", np.concatenate([mesh.exact(self.origin) for mesh in meshes]))

    def triangles(self) -> tuple[Float32, Int32]:
        """All world positions (V, 3) [scene unit] and the faces (F, 3) that index them."""
        counts = [len(mesh.positions) for mesh in self.meshes]
        starts = np.cumsum([0, *counts[:-1]], dtype=np.int32)
        faces = [mesh.faces + start for mesh, start in zip(self.meshes, starts, strict=True)]
        return self._positions(self.meshes), np.concatenate(faces)

    def bounds(self) -> Float32:
        """Lowest and highest corner (2, 3) of the box around `vertices` [scene unit]."""
        return bounds_of(self.vertices())


def bounds_of(points: _Points) -> _Points:
    """Lowest and highest corner (2, N) of the box around points (V, N), V > 0."""
    columns = np.ascontiguousarray(points.T)  # NumPy is slow along an axis of two or three
    return np.stack([columns.min(axis=1), columns.max(axis=1)])


class Carriers(Struct, frozen=True, eq=False, dict=True):
    """All nodes of a file at one moment.

    Attributes:
        world: their matrices (N, 4, 4).
    """

    world: Float64

    @cached_property
    def turns(self) -> tuple[Float64, Bool, Bool]:
        """Matrices (N, 3, 3) that turn normals; which nodes mirror, which leave any area (N,).

        A scale of 0 along two axes leaves none.
        """
        linear = self.world[:, :3, :3]
        determinants = np.linalg.det(linear)
        drawn = np.abs(determinants) > _SINGULAR * np.abs(linear).max(axis=(1, 2)) ** 3
        sizes = np.linalg.svd(linear[~drawn], compute_uv=False)
        drawn[~drawn] = sizes[:, 1] > _SINGULAR * sizes[:, 0]
        return normal_matrices(linear), determinants < 0.0, drawn


@dataclass(slots=True, eq=False)
class Instance:
    """A geometry where a node places it.

    Attributes:
        geometry: what is placed.
        node: index of the node.
        skin: joints that carry it instead of the node, or None.
        weights: morph weights without animation (T,).
    """

    geometry: Geometry
    node: int
    skin: Skin | None
    weights: Float64
    _influence: tuple[Int32, Float32] | None = field(init=False, default=None)
    _carried: Float64 | None = field(init=False, default=None)  # weight of each joint (J,)
    _last: tuple[bytes, PosedMesh] | None = field(init=False, default=None)
    _boxes: Float64 | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.geometry = self.geometry.at_nodes.get(self.node, self.geometry)
        joints, weights = self.geometry.joints, self.geometry.weights
        if self.skin is None or joints is None or weights is None:
            self.skin = None
            return
        count = len(self.skin.joints)
        if int(joints[weights > 0.0].max(initial=0)) >= count or int(joints.min()) < 0:
            raise SceneError(
                f"mesh '{self.geometry.name}' points beyond its skin's {count} joints; "
                "export the file again"
            )
        # joints of no weight may point anywhere
        kept = np.where(weights > 0.0, weights, 0.0).astype(np.float32)
        self._influence = np.ascontiguousarray(joints, np.int32), kept
        held = kept > 0.0
        self._carried = np.zeros(count)
        np.add.at(self._carried, joints[held], kept[held])

    def place(
        self, carriers: Carriers, weights: Float64 | None, origin: Float64 | None = None
    ) -> PosedMesh:
        """The geometry in the world; the very same object while nothing moves.

        Args:
            carriers: the nodes.
            weights: animated morph weights (T,), or None for those of the file.
            origin: as of `PosedScene`.
        """
        amounts = self.weights if weights is None else weights
        world = carriers.world
        matrices = world[self.node] if self.skin is None else self.skin.matrices(world)
        key = matrices.tobytes() + amounts.tobytes()
        if origin is not None:
            key += origin.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self._placed(carriers, matrices, amounts, origin))
        return self._last[1]

    def boxes(self, weights: Float64 | None) -> tuple[list[int], Float64]:
        """Boxes round all vertices for morph weights as of `place`, each carried by a node.

        A skinned vertex is a mean of what its joints make of it, so it lies in the hull of the
        boxes round the vertices of each joint, carried by that joint.

        Returns:
            The nodes (B,), and corners in the space of each, homogeneous, as columns (B, 4, 8).
        """
        if self._boxes is None:
            self._boxes = self._rest_boxes()
        amounts = self.weights if weights is None else weights
        boxes = self._boxes + self._morph_reach(amounts)
        corners = np.ones((len(boxes), 4, 8))
        corners[:, :3] = np.swapaxes(boxes[:, _CORNERS, np.arange(3)], 1, 2)
        if self.skin is None:
            return [self.node], corners
        held = np.flatnonzero((self._boxes[:, 0] <= self._boxes[:, 1]).all(axis=1))
        bound = self.skin.inverse_bind[held] @ corners[held]
        return [self.skin.joints[joint] for joint in held], bound

    def _rest_boxes(self) -> Float64:
        """Lowest and highest corner (J, 2, 3) of each joint's vertices, infinite where none are."""
        positions = self.geometry.positions.astype(np.float64)
        if self._influence is None:
            return bounds_of(positions)[None]
        joints, weights = self._influence
        boxes = np.full((0 if self.skin is None else len(self.skin.joints), 2, 3), np.inf)
        boxes[:, 1] = -np.inf
        vertices, places = np.nonzero(weights)
        held = joints[vertices, places]
        np.minimum.at(boxes[:, 0], held, positions[vertices])
        np.maximum.at(boxes[:, 1], held, positions[vertices])
        return boxes

    def _morph_reach(self, amounts: Float64) -> Float64:
        """How far the morph targets may move a vertex down and up (2, 3)."""
        reach = np.zeros((2, 3))
        if self.geometry.targets is None:
            return reach
        for target, amount in zip(self.geometry.targets, amounts, strict=True):
            if amount:
                ends = bounds_of(target) * amount
                reach += np.sort(ends, axis=0)
        return reach

    def _placed(
        self, carriers: Carriers, matrices: Float64, amounts: Float64, origin: Float64 | None
    ) -> PosedMesh:
        if origin is None:
            return self._deformed(carriers, matrices, amounts)
        moved = matrices.copy()
        moved[..., :3, 3] -= origin
        near = self._deformed(carriers, moved, amounts)
        return replace(near, positions=(near.positions + origin).astype(np.float32), near=near)

    def _deformed(self, carriers: Carriers, matrices: Float64, amounts: Float64) -> PosedMesh:
        """By the matrix of its node (4, 4), or by those of its joints (J, 4, 4)."""
        positions, normals = map(np.ascontiguousarray, self._morphed(amounts))
        placed, turned = np.empty_like(positions), np.empty_like(normals)
        if self._influence is None or self._carried is None:
            turners, mirrors, keeps_areas = carriers.turns
            kernels.carry(positions, normals, matrices[:3], turners[self.node], placed, turned)
            mirrored, drawn = bool(mirrors[self.node]), bool(keeps_areas[self.node])
        else:
            rows = matrices[:, :3, :].reshape(-1, 12).astype(np.float32)
            kernels.skin(positions, normals, *self._influence, rows, placed, turned)
            # by sides alone: a joint that is scaled up carries no more of the surface
            sides = np.sign(np.linalg.det(matrices[:, :3, :3]))
            mirrored = bool(sides @ self._carried < 0.0)
            drawn = not _in_one_point(matrices[self._carried > 0.0])
        if self.geometry.flat and (self._influence is not None or len(amounts)):
            turned = np.repeat(face_normals(placed, self.geometry.faces), 3, axis=0)
            turned = -turned if mirrored else turned
        return PosedMesh(self.geometry, placed, turned, mirrored, drawn)

    def _morphed(self, weights: Float64) -> tuple[Float32, Float32]:
        own, active = self.geometry, weights.nonzero()[0]
        if not len(active):
            return own.positions, own.normals
        amounts = weights[active].astype(np.float32)

        def morphed(rest: Float32, targets: Float32 | None) -> Float32:
            if targets is None:
                return rest
            return np.asarray(rest + np.tensordot(amounts, targets[active], axes=1))

        return morphed(own.positions, own.targets), morphed(own.normals, own.target_normals)


def _in_one_point(joints: Float64) -> bool:
    """Whether joints (J, 4, 4) carry all they hold to the same point."""
    return not joints[:, :3, :3].any() and bool((joints == joints[:1]).all())
