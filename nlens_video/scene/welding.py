"""Vertices that are one point of the surface: glTF repeats them where normals or textures part.

Triangles that share vertices share edges, and shared edges cost a shadow next to nothing.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.scene.gltf.meshes import Geometry, Int32


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
