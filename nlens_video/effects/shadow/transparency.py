"""Rasterises transparent triangles (alpha masks, alpha blending) for soft shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from nlens_video.core.layers import Float32, Float64
from nlens_video.effects.shadow.coverage import Bits, Int32, edge_functions, extent

REPEATED, MIRRORED, CLAMPED = 0, 1, 2
_Texture = tuple[Float32, tuple[int, int], float]


@dataclass(frozen=True, slots=True, eq=False)
class Absorption:
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
    _absorb(
        (absorption.taken, absorption.left), (absorption.call, *opaque), points, surface, faces,
        texture, call, at,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _texel(index: int, size: int, mode: int) -> int:
    """Index of the texel at any index, wrapped."""
    if mode == CLAMPED:
        return min(max(index, 0), size - 1)
    if mode == MIRRORED:
        index = index % (2 * size)
        return index if index < size else 2 * size - 1 - index
    return index % size


@njit(cache=True, nogil=True)
def _sampled(alpha: Float32, wrap: tuple[int, int], u: float, v: float) -> float:
    """The texture's alpha, bilinear."""
    height, width = alpha.shape
    x, y = u * width - 0.5, v * height - 0.5
    left, top = int(np.floor(x)), int(np.floor(y))
    along, down = x - left, y - top
    i0, i1 = _texel(left, width, wrap[0]), _texel(left + 1, width, wrap[0])
    j0, j1 = _texel(top, height, wrap[1]), _texel(top + 1, height, wrap[1])
    above = alpha[j0, i0] + along * (alpha[j0, i1] - alpha[j0, i0])
    below = alpha[j1, i0] + along * (alpha[j1, i1] - alpha[j1, i0])
    return float(above + down * (below - above))


@njit(cache=True, nogil=True)
def _stopped(
    weights: tuple[float, float, float],
    corners: tuple[Float64, Float64, Float64],
    texture: _Texture,
) -> float:
    """Share of the light that a point of a triangle absorbs [1]."""
    alpha, wrap, cutoff = texture
    a, b, c = corners
    total = weights[0] + weights[1] + weights[2]
    p, q, r = weights[0] / total, weights[1] / total, weights[2] / total
    u = p * a[0] + q * b[0] + r * c[0]
    v = p * a[1] + q * b[1] + r * c[1]
    factor = p * a[2] + q * b[2] + r * c[2]
    share = float(min(max(factor * _sampled(alpha, wrap, u, v), 0.0), 1.0))
    if cutoff >= 0.0:
        return 1.0 if share >= cutoff else 0.0
    return share


_PLANE = "UniTuple(f4[:,::1],2),Tuple((i4[:,::1],u1[:,::1],i8))"
_TEXTURE = "Tuple((f4[:,::1],UniTuple(i8,2),f8))"


@njit(
    f"void({_PLANE},f8[:,::1],f8[:,::1],i4[:,::1],{_TEXTURE},i8,UniTuple(f8,2))",
    cache=True,
    nogil=True,
)
def _absorb(
    sums: tuple[Float32, Float32],
    calls: tuple[Int32, Bits, int],
    points: Float64,
    surface: Float64,
    faces: Int32,
    texture: _Texture,
    call: int,
    at: tuple[float, float],
) -> None:  # fmt: skip
    taken, left = sums
    last, opaque, number = calls
    edge = np.empty((3, 3), np.float64)
    for t in range(faces.shape[0]):
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        inside = extent(points[i], points[j], points[k], taken.shape, at)
        if inside[0] > inside[2] or inside[1] > inside[3]:
            continue
        if not edge_functions(points[i], points[j], points[k], edge):
            continue
        corners = (surface[i], surface[j], surface[k])
        for y in range(inside[1], inside[3] + 1):
            py = y + at[1]
            for x in range(inside[0], inside[2] + 1):
                if (opaque[y, x] >> number) & 1:
                    continue
                px = x + at[0]
                p = edge[0, 0] * px + edge[0, 1] * py + edge[0, 2]
                q = edge[1, 0] * px + edge[1, 1] * py + edge[1, 2]
                r = edge[2, 0] * px + edge[2, 1] * py + edge[2, 2]
                if p < 0.0 or q < 0.0 or r < 0.0 or p + q + r <= 0.0:
                    continue
                if last[y, x] != call:
                    last[y, x] = call
                    left[y, x] = np.float32(1.0)
                stopped = np.float32(_stopped((p, q, r), corners, texture)) * left[y, x]
                taken[y, x] += stopped
                left[y, x] -= stopped


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
