"""Which meshes close a body, so that nobody sees their back faces."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import trimesh

from nlens_video.core.layers import Float32
from nlens_video.scene.gltf.meshes import Int32
from nlens_video.scene.posed import PosedMesh


def closed_bodies(meshes: Sequence[PosedMesh]) -> list[bool]:
    """Whether each mesh closes a body, alone or all of them together, faces outwards.

    Exporters call most materials double-sided, closed bodies too. Behind the front of such a body
    lies its own inner side, which no point of a lens sees.

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
    # trimesh takes what is nearer than a fixed distance for one place: in units of the body's own
    # size, a power of two so that places stay as exact as they are
    size = float(np.abs(positions).max(initial=0.0))
    if not 0.0 < size < np.inf:
        return False
    places = np.ldexp(positions.astype(np.float64), -math.frexp(size)[1])
    merged = trimesh.Trimesh(places, faces, process=True)
    corners = np.asarray(merged.faces)
    # what exporters put at the poles of a ball: triangles with two corners in one place
    flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    merged.update_faces(~flat)
    return bool(merged.is_volume)
