"""Closed (watertight) meshes: their back faces are never visible."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import trimesh

from nlens_video.core.layers import Float32
from nlens_video.scene.gltf.meshes import Int32
from nlens_video.scene.posed import PosedMesh


def closed_bodies(meshes: Sequence[PosedMesh]) -> list[bool]:
    """Whether each mesh is watertight with outward faces, alone or all of them together.

    Exporters mark most materials double-sided, also those of closed bodies, whose inner side depth
    peeling would otherwise find behind the front.

    Args:
        meshes: of one moment; they touch at the same places at all times.
    """
    parts = [(mesh.positions, _outward(mesh)) for mesh in meshes]
    starts = np.cumsum([0] + [len(positions) for positions, _ in parts])
    together = (
        np.concatenate([positions for positions, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)]),
    )
    if len(parts) > 1 and _closes(*together):
        return [True] * len(parts)
    return [_closes(*part) for part in parts]


def _outward(mesh: PosedMesh) -> Int32:
    return mesh.faces[:, ::-1] if mesh.mirrored else mesh.faces


def _closes(positions: Float32, faces: Int32) -> bool:
    # trimesh merges vertices closer than a fixed distance, so positions are scaled to unit size,
    # by a power of two, which is exact
    size = float(np.abs(positions).max(initial=0.0))
    if not 0.0 < size < np.inf:
        return False
    places = np.ldexp(positions.astype(np.float64), -math.frexp(size)[1])
    merged = trimesh.Trimesh(places, faces, process=True)
    corners = np.asarray(merged.faces)
    # exporters put degenerate triangles (two equal corners) at the poles of a sphere
    flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    merged.update_faces(~flat)
    return bool(merged.is_volume)
