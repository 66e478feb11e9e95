"""Meshes: a primitive's attributes as triangles, ready to be deformed and drawn."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field
from msgspec.structs import replace

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float32, Float64
from nlens_video.scene.gltf.accessors import DRACO, AccessorReader, DracoReader
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields, check_range
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.nodes import mesh_scales

Int32 = npt.NDArray[np.int32]
WITHOUT_NORMALS = "export normals too, for without them each corner of a triangle is a vertex"
_MODES = {0: "points", 1: "lines", 2: "line loops", 3: "line strips"}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


class Geometry(Struct, frozen=True, kw_only=True, eq=False):
    """A primitive: what stays the same at all times. Shared by all instances.

    Attributes:
        name: name of its mesh, for messages.
        positions: rest positions (V, 3) in the mesh's own space [scene unit].
        normals: unit normals (V, 3).
        faces: vertex indices of triangles (F, 3), counter-clockwise seen from the front.
        uv: texture coordinates 0 and 1 (V, 4), zero where absent.
        colors: vertex colours (V, 4), linear RGBA, or None.
        material: what it looks like.
        flat: whether normals are those of the faces (the file has none).
        joints: indices into the skin's joints (V, K), or None.
        weights: their weights (V, K), summing to 1, or None.
        targets: morph displacements (T, V, 3), or None [scene unit].
        target_normals: displacements of the normals (T, V, 3), or None.
        at_nodes: what stands for it at nodes whose scale changes what it looks like.
    """

    name: str
    positions: Float32
    normals: Float32
    faces: Int32
    uv: Float32
    colors: Float32 | None
    material: Material
    flat: bool
    joints: Int32 | None
    weights: Float32 | None
    targets: Float32 | None
    target_normals: Float32 | None
    at_nodes: Mapping[int, Geometry] = field(default_factory=dict)


class TriangleMesh(Struct, frozen=True, eq=False):
    """Primitives under one name.

    Attributes:
        geometries: its triangle primitives.
        weights: rest weights of the morph targets.
    """

    geometries: tuple[Geometry, ...]
    weights: tuple[float, ...]


def face_normals(positions: Float32, faces: Int32) -> Float32:
    """Unit normals (F, 3) of triangles; +Y where a triangle has no area."""
    # in float64: coordinates of 1e20 overflow when multiplied
    a, b, c = (positions[faces[:, corner]].astype(np.float64) for corner in range(3))
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    return unit(np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1))


def unit(vectors: Float32 | Float64) -> Float32:
    """Vectors (N, 3) scaled to length 1; +Y where they have none."""
    # In float64: the cross product of micrometres would underflow when squared.
    x, y, z = vectors.T.astype(np.float64)
    length = np.sqrt(x * x + y * y + z * z)
    none = length == 0.0
    scale = 1.0 / np.where(none, 1.0, length)
    result = np.empty((len(vectors), 3), np.float32)
    for column, values in enumerate((x, y, z)):
        np.multiply(values, scale, out=result[:, column], casting="same_kind")
    result[none] = (0.0, 1.0, 0.0)
    return result


def read_meshes(
    document: Document, accessors: AccessorReader, materials: tuple[Material, ...]
) -> tuple[TriangleMesh, ...]:
    """All meshes of the file as triangles.

    Raises:
        SceneError: attributes missing, of the wrong kind or length, or indices out of range.
    """
    reader = _PrimitiveReader(document, accessors, materials, DracoReader(document, accessors))
    meshes = tuple(reader.mesh(item) for item in document.items("meshes"))
    if not any(any(material.layers.depth) for material in materials):
        return meshes
    scales = mesh_scales(document, accessors)
    made: dict[tuple[Material, float], Material] = {}
    return tuple(
        replace(
            mesh,
            geometries=tuple(_scaled(one, scales.get(number, {}), made) for one in mesh.geometries),
        )
        for number, mesh in enumerate(meshes)
    )


def _scaled(
    geometry: Geometry, scales: dict[int, float], made: dict[tuple[Material, float], Material]
) -> Geometry:
    """The same with its volume as thick as each node's scale makes it; `made`: shared ones."""
    if not any(geometry.material.layers.depth):
        return geometry
    own = geometry.material
    at_scales = {
        scale: replace(geometry, material=made.setdefault((own, scale), own.at_scale(scale)))
        for scale in set(scales.values()) - {1.0}
    }
    at_nodes = {node: at_scales[scale] for node, scale in scales.items() if scale in at_scales}
    return replace(geometry, at_nodes=at_nodes)


class _PrimitiveReader(Struct, frozen=True):
    document: Document
    accessors: AccessorReader
    materials: tuple[Material, ...]
    draco: DracoReader

    def mesh(self, item: Fields) -> TriangleMesh:
        name = item.name or item.place
        made = (self.primitive(primitive, name) for primitive in item.children("primitives"))
        return TriangleMesh(tuple(g for g in made if g is not None), item.numbers("weights"))

    def primitive(self, item: Fields, name: str) -> Geometry | None:
        mode = item.integer("mode", below=7, default=_TRIANGLES)
        if mode in _MODES:
            self.document.warn(f"mesh '{name}': {_MODES[mode]} are not drawn, only triangles")
            return None
        attributes = item.child("attributes")
        if "POSITION" not in attributes:
            self.document.warn(f"mesh '{name}': a primitive without POSITION is not drawn")
            return None
        compressed = item.extension(DRACO)
        if compressed is not None:
            self.draco.provide(item, compressed)
        positions = self._floats(attributes, "POSITION", 3)  # before: what is read counts
        self._spend(item, attributes)
        check_range(positions, f"a position of {attributes.place}")
        count = len(positions)
        faces = self._faces(item, mode, count)
        if not len(faces):
            self.document.warn(f"mesh '{name}': a primitive without triangles is not drawn")
            return None
        joints, weights = self._influences(attributes, count)
        normals = self._optional(attributes, "NORMAL", 3, count)
        material = item.reference("material", len(self.materials) - 1)
        geometry = Geometry(
            name=name,
            positions=positions,
            normals=positions if normals is None else unit(normals),
            faces=faces,
            uv=self._uv(attributes, count),
            colors=self._colors(attributes, count),
            material=self.materials[-1 if material is None else material],
            flat=normals is None,
            joints=joints,
            weights=weights,
            targets=self._targets(item, "POSITION", count),
            target_normals=None if normals is None else self._targets(item, "NORMAL", count),
        )
        return _unwelded(geometry) if geometry.flat else geometry

    def _spend(self, item: Fields, attributes: Fields) -> None:
        """Count what the primitive will take: many can share the same few accessors."""
        count = self.accessors.length(self._index(attributes, "POSITION"))
        indexed = "indices" in item
        corners = self.accessors.length(self._index(item, "indices")) if indexed else count
        split = 0 if "NORMAL" in attributes else corners  # a vertex for each corner
        each = 64 + 24 * len(item.children("targets")) + 8 * len(attributes.data)
        remedy = f"; {WITHOUT_NORMALS}" if split else ""
        self.document.spend((count + split) * each + 16 * corners, item.place, remedy)

    def _index(self, owner: Fields, key: str) -> int:
        return owner.integer(key, below=self.accessors.count)

    def _floats(self, attributes: Fields, key: str, width: int) -> Float32:
        return self.accessors.floats(self._index(attributes, key), width)

    def _optional(self, owner: Fields, key: str, width: int, count: int) -> Float32 | None:
        if key not in owner:
            return None
        values = self._floats(owner, key, width)
        if len(values) != count:
            raise SceneError(
                f"{owner.place}.{key} has {len(values)} elements, POSITION {count}; export again"
            )
        check_range(values, f"a value of {owner.place}.{key}")
        return values

    def _faces(self, item: Fields, mode: int, count: int) -> Int32:
        indices = np.arange(count)
        if "indices" in item:
            indices = self.accessors.integers(self._index(item, "indices")).ravel()
            if int(indices.max()) >= count or int(indices.min()) < 0:
                raise SceneError(
                    f"{item.place}.indices points to vertex {int(indices.max())} of {count}; "
                    "the file is damaged"
                )
        return _triangles(indices, mode).astype(np.int32)

    def _uv(self, attributes: Fields, count: int) -> Float32:
        uv = np.zeros((count, 4), np.float32)
        for number in range(2):
            values = self._optional(attributes, f"TEXCOORD_{number}", 2, count)
            if values is not None:
                uv[:, 2 * number : 2 * number + 2] = values
        return uv

    def _colors(self, attributes: Fields, count: int) -> Float32 | None:
        if "COLOR_0" not in attributes:
            return None
        width = self.accessors.width(self._index(attributes, "COLOR_0"))
        values = self._optional(attributes, "COLOR_0", 4 if width == 4 else 3, count)
        colors = np.ones((count, 4), np.float32)
        colors[:, : min(width, 4)] = values
        return colors

    def _influences(self, attributes: Fields, count: int) -> tuple[Int32 | None, Float32 | None]:
        joints: list[npt.NDArray[np.int64]] = []
        weights: list[Float32] = []
        number = 0
        while f"JOINTS_{number}" in attributes and f"WEIGHTS_{number}" in attributes:
            chosen = self.accessors.integers(self._index(attributes, f"JOINTS_{number}"))
            weight = self._optional(attributes, f"WEIGHTS_{number}", 4, count)
            if weight is None or chosen.shape != weight.shape:
                raise SceneError(
                    f"{attributes.place}.JOINTS_{number} must be {count} times 4 joints"
                )
            joints.append(chosen)
            weights.append(weight)
            number += 1
        if not joints:
            return None, None
        joined = np.maximum(np.concatenate(weights, axis=1), np.float32(0.0))
        total = joined.sum(axis=1, keepdims=True)
        joined = np.divide(joined, np.where(total > 0.0, total, np.float32(1.0)))
        return np.concatenate(joints, axis=1).astype(np.int32), joined

    def _targets(self, item: Fields, key: str, count: int) -> Float32 | None:
        targets = item.children("targets")
        if not any(one in target for target in targets for one in {"NORMAL", key}):
            return None  # places stay at 0 where normals alone move
        found = [self._optional(target, key, 3, count) for target in targets]
        zero = np.zeros((count, 3), np.float32)
        return np.stack([zero if values is None else values for values in found])


def _triangles(indices: npt.NDArray[np.int64], mode: int) -> npt.NDArray[np.int64]:
    """Vertex indices (F, 3) of a triangle list, strip or fan, winding kept."""
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(0, len(indices) - 2)
    first = np.arange(count)
    if mode == _FAN:
        corners = np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)
    else:
        odd = first % 2
        corners = np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)
    faces = indices[corners]
    # Strips are stitched with triangles of no area; they would only cost.
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (a != c)] if count else faces.reshape(0, 3)


def _unwelded(geometry: Geometry) -> Geometry:
    """The same with a vertex of its own for each corner, so that each face can have its normal."""
    corners = geometry.faces.ravel()
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    positions = geometry.positions[corners]
    targets = None if geometry.targets is None else geometry.targets[:, corners]
    by_vertex = {
        name: values[corners]
        for name in ("uv", "colors", "joints", "weights")
        if (values := getattr(geometry, name)) is not None
    }
    normals = np.repeat(face_normals(positions, faces), 3, axis=0)
    return replace(
        geometry, positions=positions, normals=normals, faces=faces, targets=targets, **by_vertex
    )
