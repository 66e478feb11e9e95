"""Vertex, index and material buffers of the software rasteriser."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.render.base.drawer import closed_bodies
from nlens_video.render.base.shader_inputs import SLOTS, material_params, texture_uses
from nlens_video.render.software.shading_inputs import (
    CUT,
    LAYERED,
    OPAQUE,
    UNLIT,
    Int32,
    MaterialBuffers,
    MeshBuffers,
)
from nlens_video.render.software.textures import Atlas
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.textures import Image
from nlens_video.scene.posed import PosedMesh, PosedScene

_ORDER = ("OPAQUE", "MASK", "BLEND")
_BACK, _MIRRORED = 1, 2


class SceneBuffers:
    """Static data, packed once, and positions and normals, updated in place.

    Attributes:
        positions: in the world (V, 3) [scene unit].
        normals: (V, 4), the last number 0.
        faces: vertex indices (F, 3): opaque triangles, then masked, then blended ones.
        sides: bit 0 whether a triangle's back is drawn, bit 1 whether it is mirrored (F,).
        starts: where in `faces` masked and blended triangles start, and where they end.
        paint: materials and textures.
    """

    positions: Float32
    normals: Float32
    faces: Int32
    sides: npt.NDArray[np.uint8]
    starts: tuple[int, int, int]
    paint: MaterialBuffers

    def __init__(self, posed: PosedScene) -> None:
        self._meshes: tuple[PosedMesh | None, ...] = (None,) * len(posed.meshes)
        self._closed: Bool | None = None  # computed on first use
        counts = [len(mesh.positions) for mesh in posed.meshes]
        self._first = np.cumsum([0, *counts])
        total = int(self._first[-1])
        self.positions = np.zeros((total, 3), np.float32)
        self.normals = np.zeros((total, 4), np.float32)
        self._uv = np.concatenate([mesh.geometry.uv for mesh in posed.meshes])
        self._colors = _colors(posed)
        materials = list(dict.fromkeys(mesh.geometry.material for mesh in posed.meshes))
        self.paint = _paint(materials)
        self._sort(posed, materials)

    def _sort(self, posed: PosedScene, materials: list[Material]) -> None:
        """Lay the triangles out by what their materials do with alpha."""
        modes = [_order(mesh.geometry.material) for mesh in posed.meshes]
        order = sorted(range(len(modes)), key=modes.__getitem__)
        meshes = [posed.meshes[n] for n in order]
        counts = [len(mesh.faces) for mesh in meshes]
        firsts = [np.int32(self._first[n]) for n in order]
        pairs = zip(meshes, firsts, strict=True)
        self.faces = np.concatenate([mesh.faces + first for mesh, first in pairs]).astype(np.int32)
        self._mesh_of = np.repeat(np.array(order), counts)
        numbers = [materials.index(mesh.geometry.material) for mesh in meshes]
        self._material = np.repeat(np.array(numbers, np.int32), counts)
        doubles = [mesh.geometry.material.double_sided for mesh in meshes]
        self._doubles = np.repeat(np.array(doubles, np.uint8) * np.uint8(_BACK), counts)
        self.sides = self._doubles.copy()
        sizes = [
            sum(c for c, n in zip(counts, order, strict=True) if modes[n] <= k) for k in range(3)
        ]
        self.starts = (sizes[0], sizes[1], sizes[2])

    def move(self, posed: PosedScene) -> None:
        """Write the vertices of another moment; meshes at rest are left alone."""
        if self._meshes == posed.meshes:
            return
        for n, (before, mesh) in enumerate(zip(self._meshes, posed.meshes, strict=True)):
            if before is not mesh:
                place = slice(self._first[n], self._first[n + 1])
                self.positions[place], self.normals[place, :3] = mesh.positions, mesh.normals
        self._meshes = posed.meshes
        mirrored = np.array([mesh.mirrored for mesh in posed.meshes], np.uint8)
        self.sides = self._doubles | (mirrored * np.uint8(_MIRRORED))[self._mesh_of]

    def by_alpha(self, kept: Int32, lens: Float64) -> tuple[Int32, Int32, Int32]:
        """Triangles to be drawn, ascending (N,), as opaque, masked and blended ones.

        Those that blend come from near to far: whole meshes by their mean depth, and their
        triangles by that of their centres.

        Args:
            kept: triangles in view.
            lens: camera, as of `screen_projection.pinhole_params` (17,).
        """
        cuts = np.searchsorted(kept, self.starts[:2])
        opaque, masked, blended = np.split(kept, cuts)
        if not len(blended):
            return opaque, masked, blended
        faces = self.faces[self.starts[1] :]
        mesh = self._mesh_of[self.starts[1] :]
        depths = (self.positions - lens[9:12].astype(np.float32)) @ -lens[6:9].astype(np.float32)
        depth = depths[faces].mean(axis=1, dtype=np.float64)
        means = np.bincount(mesh, depth) / np.maximum(np.bincount(mesh), 1)
        own, chosen = depth[blended - self.starts[1]], mesh[blended - self.starts[1]]
        # What is equally far is drawn in the file's order, hence from near to far in the reverse.
        order = np.lexsort((-blended, own, -chosen, means[chosen]))
        return opaque, masked, np.ascontiguousarray(blended[order])

    @property
    def outer_sides(self) -> npt.NDArray[np.uint8]:
        """`sides` without the back faces of closed bodies, which are never visible."""
        if self._closed is None:
            posed = [mesh for mesh in self._meshes if mesh is not None]
            self._closed = np.array(closed_bodies(posed), bool)[self._mesh_of]
        return np.where(self._closed, self.sides & ~np.uint8(_BACK), self.sides)

    def mesh(self, planes: Float32) -> MeshBuffers:
        """The triangles with their planes (F, 16) on the screen."""
        return (
            self.positions, self.normals, self._uv, self._colors, self.faces, self._material, planes
        )  # fmt: skip


def _order(material: Material) -> int:
    """Opaque, masked and see-through materials, in that order."""
    return _ORDER.index("BLEND" if material.see_through else material.alpha_mode)


def _colors(posed: PosedScene) -> Float32:
    """Vertex colours (V, 4); (0, 4) where no mesh has any."""
    if all(mesh.geometry.colors is None for mesh in posed.meshes):
        return np.zeros((0, 4), np.float32)
    parts = [
        np.ones((len(mesh.positions), 4), np.float32)
        if mesh.geometry.colors is None
        else mesh.geometry.colors
        for mesh in posed.meshes
    ]
    return np.concatenate(parts)


def _paint(materials: list[Material]) -> MaterialBuffers:
    images: dict[Image, int] = {}
    maps = np.full((len(materials), len(SLOTS)), -1, np.int32)
    flags = np.zeros(len(materials), np.int32)
    for m, material in enumerate(materials):
        for slot, use in enumerate(texture_uses(material)):
            if use is not None:
                maps[m, slot] = images.setdefault(use.image, len(images))
        flags[m] = (
            LAYERED * bool(material.layers.drawn)
            | UNLIT * material.unlit
            | OPAQUE * (material.alpha_mode == "OPAQUE" or _order(material) == 1)
            | CUT * (material.alpha_mode == "MASK" and material.see_through)
        )
    atlas = Atlas.of(list(images))
    numbers = np.stack([material_params(material) for material in materials])
    return numbers, maps, flags, (atlas.texels, atlas.levels, atlas.table)
