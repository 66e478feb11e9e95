"""Rasterises transparent triangles (alpha masks, alpha blending) for soft shadows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64
from nlens_video.effects.shadow.casters import ClippedMesh
from nlens_video.effects.shadow.coverage import Bits, Int32
from nlens_video.kernels.scratch import scratch
from nlens_video.native import kernels
from nlens_video.render.base.opacity import Opacity

REPEATED, MIRRORED, CLAMPED = 0, 1, 2
_Texture = tuple[Float32, tuple[int, int], float]


class Absorption(Struct, frozen=True, eq=False):
    """Light absorbed by transparent triangles, accumulated projection by projection.

    Attributes:
        taken: sum over the projections (h, w), each 0 to 1 [1].
        left: share that the last projection leaves so far (h, w) [1].
        call: number of that projection (h, w).
    """

    taken: Float32
    left: Float32
    call: Int32


def no_absorption(height: int, width: int) -> Absorption:
    """The start of an accumulation."""
    taken, left = np.zeros((2, height, width), np.float32)
    return Absorption(taken, left, np.zeros((height, width), np.int32))


def absorb_veils(
    absorption: Absorption,
    opaque: tuple[Bits, int],
    veils: Sequence[tuple[ClippedMesh, Opacity]],
    matrix: Float64,
    call: int,
    at: tuple[float, float],
) -> None:
    """Add the absorption of meshes in one projection, as `absorb` does.

    Args:
        absorption: of the projections so far; changed.
        opaque: as of `absorb`.
        veils: the meshes, whose vertices have texture coordinates and a factor of alpha.
        matrix: from the world to homogeneous positions (3, 4).
        call: as of `absorb`.
        at: likewise.
    """
    most = max((len(mesh.places) for mesh, _ in veils), default=0)
    held = scratch("points", (most, 3), np.float64)
    for mesh, opacity in veils:
        points = held[: len(mesh.places)]
        np.matmul(mesh.places, matrix.T, out=points)
        texture = (opacity.alpha, opacity.wrap, opacity.cutoff)
        absorb(absorption, opaque, points, mesh.surface, mesh.faces, texture, call, at)


def absorb(
    absorption: Absorption,
    opaque: tuple[Bits, int],
    points: Float64,
    surface: Float64,
    faces: Int32,
    texture: _Texture,
    call: int,
    at: tuple[float, float],
) -> None:  # fmt: skip
    """Add the absorption of triangles in one projection; light passes one after the other.

    Args:
        absorption: of the projections so far; changed.
        opaque: bits of `mark_covered`, and the number of this projection's: where it is set, no
            light is left.
        points: homogeneous positions (V, 3), (column * w, row * w, w), before the camera where
            w > 0 [px].
        surface: texture coordinates and factor of alpha at each vertex (V, 3).
        faces: vertex indices of triangles (T, 3).
        texture: alpha (H, W), wrapping along u and v (`REPEATED`, `MIRRORED`, `CLAMPED`), and the
            alpha from which on it is opaque; negative for alpha blending [1].
        call: number of this projection, from 1 on.
        at: where in each pixel it is sampled [px].
    """
    sums = (absorption.taken, absorption.left, absorption.call)
    kernels.absorb(sums, opaque, points, surface, faces, texture, call, at)


def absorb_reference(
    size: tuple[int, int],
    points: Float64,
    surface: Float64,
    faces: Int32,
    texture: tuple[Float32, tuple[int, int], float],
    at: tuple[float, float],
) -> Float64:
    """NumPy reference of `absorb` for one projection: the share of the light (h, w)."""
    alpha, wrap, cutoff = texture
    left = np.ones(size)
    for face in faces:
        if np.linalg.det(points[face]) == 0.0:
            continue
        for y in range(size[0]):
            for x in range(size[1]):
                weights = np.linalg.solve(points[face].T, [x + at[0], y + at[1], 1.0])
                if (weights < 0.0).any():
                    continue
                u, v, factor = weights / weights.sum() @ surface[face]
                share = min(max(factor * _sampled_reference(alpha, wrap, u, v), 0.0), 1.0)
                if cutoff >= 0.0:
                    share = float(share >= cutoff)
                left[y, x] *= 1.0 - share
    return 1.0 - left


def _sampled_reference(alpha: Float32, wrap: tuple[int, int], u: float, v: float) -> float:
    height, width = alpha.shape
    x, y = u * width - 0.5, v * height - 0.5
    total = 0.0
    for j in (math.floor(y), math.floor(y) + 1):
        for i in (math.floor(x), math.floor(x) + 1):
            near = max(0.0, 1.0 - abs(x - i)) * max(0.0, 1.0 - abs(y - j))
            total += near * alpha[_wrapped(j, height, wrap[1]), _wrapped(i, width, wrap[0])]
    return float(total)


def _wrapped(index: int, size: int, mode: int) -> int:
    if mode == CLAMPED:
        return min(max(index, 0), size - 1)
    texels = [*range(size), *reversed(range(size))] if mode == MIRRORED else range(size)
    return texels[index % len(texels)]
