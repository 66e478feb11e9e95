"""Vertices that count for a surface: those that are one point of it, and those that are none.

glTF repeats vertices where normals or textures part. Triangles that share vertices share edges, and
shared edges cost a shadow next to nothing.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from nlens_video.core.layers import Bool
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.meshes import Geometry, Int32, TriangleMesh

_NO_AREA = 1e-12  # of a triangle by the product of two of its edges [1]


def welded_faces(geometry: Geometry) -> Int32:
    """Triangles (F, 3) that share the first of all vertices that are in one place at all times.

    Such vertices agree in their place at rest and in all that moves them, bit for bit, so the
    surface stays what it was.
    """
    movers: list[npt.NDArray[np.generic]] = [geometry.positions + np.float32(0.0)]  # no -0
    movers += [part for part in (geometry.weights, geometry.joints) if part is not None]
    movers += [] if geometry.targets is None else list(geometry.targets)
    bits = np.concatenate([np.ascontiguousarray(one).view(np.uint32) for one in movers], axis=1)
    # one number a vertex, because rows take much longer to sort
    factors = np.random.default_rng(0).integers(2**63, size=bits.shape[1], dtype=np.uint64)
    keys = (bits * factors).sum(axis=1, dtype=np.uint64)
    _, first, group = np.unique(keys, return_index=True, return_inverse=True)
    own = first[group]
    other = (bits != bits[own]).any(axis=1)  # the same number by chance
    own[other] = np.flatnonzero(other)
    return own[geometry.faces].astype(np.int32)


def without_strays(mesh: TriangleMesh, document: Document) -> TriangleMesh:
    """The mesh without vertices far out that belong to no triangle with an area.

    A primitive of no others is left out, with a warning.
    """
    found = [_without_strays(geometry) for geometry in mesh.geometries]
    for geometry, kept in zip(mesh.geometries, found, strict=True):
        if kept is None:
            document.warn(f"mesh '{geometry.name}': a primitive without area is not drawn")
    return replace(mesh, geometries=tuple(one for one in found if one is not None))


def _without_strays(geometry: Geometry) -> Geometry | None:
    faces = geometry.faces
    used = np.zeros(len(geometry.positions), dtype=bool)
    used[faces[_have_area(geometry)]] = True
    if used.all():
        return geometry
    if not used.any():
        return None
    among, kept = geometry.positions, geometry.positions[used]
    if (kept.min(axis=0) <= among.min(axis=0)).all() and (
        kept.max(axis=0) >= among.max(axis=0)
    ).all():
        return geometry  # where they lie they change no bounds
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    targets, normals = geometry.targets, geometry.target_normals
    at_nodes = {node: _without_strays(one) for node, one in geometry.at_nodes.items()}
    return replace(
        geometry,
        positions=kept,
        normals=geometry.normals[used],
        faces=number[faces[used[faces].all(axis=1)]],
        uv=geometry.uv[used],
        colors=None if geometry.colors is None else geometry.colors[used],
        joints=None if geometry.joints is None else geometry.joints[used],
        weights=None if geometry.weights is None else geometry.weights[used],
        targets=None if targets is None else targets[:, used],
        target_normals=None if normals is None else normals[:, used],
        at_nodes={node: one for node, one in at_nodes.items() if one is not None},
    )


def _have_area(geometry: Geometry) -> Bool:
    """Which triangles have an area (F,), or may get one by joints or morph targets."""
    if geometry.joints is not None or geometry.targets is not None:
        return np.ones(len(geometry.faces), dtype=bool)
    a, b, c = (geometry.positions[corner].astype(np.float64) for corner in geometry.faces.T)
    one, other = b - a, c - a
    area2 = (np.cross(one, other) ** 2).sum(axis=1)
    least2 = _NO_AREA**2 * (one**2).sum(axis=1) * (other**2).sum(axis=1)
    return np.asarray(area2 > least2)
