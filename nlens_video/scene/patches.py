"""Patches of the object's surface that send diffuse light to the ground (Goral et al. 1984)."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.color import transfer
from nlens_video.core.layers import Float32, Float64
from nlens_video.scene.gltf.meshes import Geometry, Int32
from nlens_video.scene.gltf.textures import TextureUse
from nlens_video.scene.posed import PosedScene

Index = npt.NDArray[np.int64]

COUNT = 128
"""Patches of a scene; rounding up gives each of its meshes one more at most."""
_INWARD = 0.02  # from its place to the middle of its triangle [1]
_TEXELS = 32  # side of the picture that a texture is averaged to: a patch is no smaller [px]
_LOOKED_AT = 256  # texels of its longer side of which that is the mean [px]
R2 = (0.7548776662466927, 0.5698402909980532)
"""Of Roberts' low-discrepancy sequence."""


class PosedPatches(Struct, frozen=True, eq=False):
    """Patches at one moment.

    Attributes:
        points: in the world (P, 3) [scene unit].
        normals: unit vectors out of the surface (P, 3).
        areas: (P,) [square of the scene unit].
        colors: share of light that is sent back, in linear RGB (P, 3) [1].
    """

    points: Float64
    normals: Float64
    areas: Float64
    colors: Float64


class Patches(Struct, frozen=True, eq=False):
    """Patches, spread evenly over the object's surface and carried by it, mesh by mesh.

    Attributes:
        corners: by mesh, its place among the scene's, and vertices of the triangle that each of
            its patches lies on (N, 3).
        weights: of these vertices (P, 3) [1].
        areas: of the patch by that of the triangle, without node and skin (P,) [1].
        colors: see `PosedPatches`.
    """

    corners: tuple[tuple[int, Int32], ...]
    weights: Float64
    areas: Float64
    colors: Float64

    @classmethod
    def of(cls, posed: PosedScene) -> Patches:
        """Spread patches over a scene's triangles, evenly by their area at that moment."""
        sizes = np.array([_areas(one.positions[one.faces]).sum() for one in posed.meshes])
        # what has no extent yet, as what grows from nothing, is taken for one of mean size
        sizes = np.where(sizes > 0.0, sizes, sizes.mean() or 1.0)
        found = []
        weights, areas, colors = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros((0, 3))]
        for number, (mesh, size) in enumerate(zip(posed.meshes, sizes, strict=True)):
            own = _areas(mesh.geometry.positions[mesh.faces])
            if own.sum() <= 0.0:
                continue
            count = math.ceil(COUNT * size / sizes.sum())
            chosen, along, aside = points_by_area(own, count)
            # off the edges of triangles, where a texture may begin anew
            inner = np.stack([1.0 - along - aside, along, aside], axis=1)
            inner += _INWARD * (1.0 / 3.0 - inner)
            corners = mesh.faces[chosen]
            found.append((number, corners))
            weights.append(inner)
            areas.append(own.sum() / count / own[chosen])
            colors.append(_colors(mesh.geometry, corners, inner))
        return cls(
            tuple(found), np.concatenate(weights), np.concatenate(areas), np.concatenate(colors)
        )

    def at(self, posed: PosedScene) -> PosedPatches:
        """The patches at another moment of the same scene."""
        none = np.zeros((0, 3, 3), np.float32)
        places, turned = [none], [none]
        for number, corners in self.corners:
            mesh = posed.meshes[number]
            places.append(mesh.positions[corners])
            turned.append(mesh.normals[corners])
        # all at once: NumPy takes as long for the few patches of one mesh as for those of all
        triangles = np.concatenate(places)
        normals = _mixed(np.concatenate(turned), self.weights)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals /= np.maximum(length, np.finfo(np.float64).tiny)
        points, areas = _mixed(triangles, self.weights), self.areas * _areas(triangles)
        return PosedPatches(points, normals, areas, self.colors)


def points_by_area(areas: Float64, count: int) -> tuple[Index, Float64, Float64]:
    """Points on triangles, evenly by their area: where some have extent, none on the others.

    Args:
        areas: of the triangles (T,), one at least.
        count: of the points, N.

    Returns:
        The triangle of each (N,), and how far it lies along the triangle's first side and along its
        other side from the first vertex (N,), together 1 at most [1].
    """
    sums = np.cumsum(areas)
    number = np.arange(count)
    at = np.searchsorted(sums, (number + 0.5) / count * sums[-1])
    along, aside = (number * R2[0]) % 1.0, (number * R2[1]) % 1.0
    over = along + aside > 1.0
    return at, np.where(over, 1.0 - along, along), np.where(over, 1.0 - aside, aside)


def _areas(triangles: Float32) -> Float64:
    """Areas (T,) of triangles (T, 3, 3)."""
    first, second, third = triangles.astype(np.float64).swapaxes(0, 1)
    return np.asarray(0.5 * np.linalg.norm(np.cross(second - first, third - first), axis=1))


def _mixed(values: Float32, weights: Float64) -> Float64:
    """Weighted means (P, C) of what the vertices of each triangle have (P, 3, C)."""
    return np.asarray(np.einsum("pvc,pv->pc", values.astype(np.float64), weights))


def _colors(geometry: Geometry, corners: Int32, weights: Float64) -> Float64:
    """Share of light (P, 3) that patches send back [1].

    A metal's reflection is spread over all directions; what lets light through sends less back.
    """
    material = geometry.material
    base = np.array(material.base_color, np.float64)
    colors = np.broadcast_to(base[:3], (len(corners), 3)).copy()
    if geometry.colors is not None:
        colors *= _mixed(geometry.colors[corners], weights)[:, :3]
    use = material.base_color_texture
    if use is not None:
        colors *= _texels(use, _mixed(geometry.uv[corners], weights))
    return np.clip(colors, 0.0, 1.0) * material.opacity


def _texels(use: TextureUse, uv: Float64) -> Float64:
    """Colours (P, 3) of a texture around places on it (P, 4), the texture coordinates 0 and 1."""
    sample = use.image.picture.sample
    step = max(1, max(sample.shape[:2]) // _LOOKED_AT)
    pixels = sample[::step, ::step, :3]
    linear = transfer("iec61966-2-1").to_linear(np.arange(256) / 255.0).astype(np.float32)
    size = tuple(min(side, _TEXELS) for side in pixels.shape[1::-1])
    few = cv2.resize(linear[pixels], size, interpolation=cv2.INTER_AREA)
    rows = np.array(use.transform)
    places = uv[:, 2 * use.uv_set : 2 * use.uv_set + 2] @ rows[:, :2].T + rows[:, 2]
    column, row = ((places % 1.0) * size).astype(int).T
    at = np.minimum(row, size[1] - 1), np.minimum(column, size[0] - 1)
    return np.asarray(few[at], np.float64)
