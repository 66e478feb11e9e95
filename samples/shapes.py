"""Parts that the objects are made of, merged into one indexed mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Part:
    """Positions (V, 3) [m], texture coordinates (V, 2), triangles (T, 3)."""

    positions: Floats
    uv: Floats
    triangles: Ints

    def moved(self, matrix: Floats, offset: tuple[float, float, float]) -> Part:
        """The part under a linear map and a shift."""
        return Part(self.positions @ matrix.T + np.array(offset), self.uv, self.triangles)


def grid(rows: int, columns: int) -> Ints:
    """Triangles (T, 3) of a grid of (rows + 1) x (columns + 1) vertices."""
    r, c = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (r * (columns + 1) + c).ravel()
    b, d, e = a + 1, a + columns + 1, a + columns + 2
    return np.concatenate([np.stack([a, d, b], 1), np.stack([b, d, e], 1)])


def ball(
    radii: tuple[float, float, float],
    patch: tuple[float, float, float, float],
    rows: int = 16,
    columns: int = 24,
) -> Part:
    """An ellipsoid whose pole faces +z; `patch` (u0, v0, u1, v1) is painted around that pole."""
    polar = np.linspace(0.0, math.pi, rows + 1)[:, None]
    turn = np.linspace(0.0, 2.0 * math.pi, columns + 1)[None, :]
    flat = np.ones_like(turn)
    unit = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) * flat], axis=-1
    ).reshape(-1, 3)
    reach = 0.48 * polar / math.pi
    u = 0.5 + reach * np.cos(turn)
    v = 0.5 - reach * np.sin(turn)
    u0, v0, u1, v1 = patch
    uv = np.stack([u0 + u * (u1 - u0), v0 + v * (v1 - v0)], axis=-1).reshape(-1, 2)
    return Part(unit * np.array(radii), uv, grid(rows, columns))


def tube(
    centres: Floats, radii: Floats, patch: tuple[float, float, float, float], columns: int = 24
) -> Part:
    """A tube along centres (N, 3) that lie in a plane of constant x; u runs along, v around."""
    tangent = np.gradient(centres, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.array([1.0, 0.0, 0.0])
    over = np.cross(tangent, side)
    turn = np.linspace(0.0, 2.0 * math.pi, columns + 1)
    around = side * np.cos(turn)[None, :, None] + over[:, None, :] * np.sin(turn)[None, :, None]
    positions = centres[:, None, :] + radii[:, None, None] * around
    u0, v0, u1, v1 = patch
    u = np.repeat(np.linspace(u0, u1, len(centres)), columns + 1)
    v = np.tile(np.linspace(v0, v1, columns + 1), len(centres))
    return Part(
        positions.reshape(-1, 3), np.stack([u, v], 1), grid(len(centres) - 1, columns)[:, ::-1]
    )


def spot(patch: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """The middle of a patch of plain paint, safe from its neighbours in small mipmaps."""
    u0, v0, u1, v1 = patch
    du, dv = 0.3 * (u1 - u0), 0.3 * (v1 - v0)
    return (u0 + du, v0 + dv, u1 - du, v1 - dv)


def merge(parts: list[Part]) -> Part:
    """All parts as one mesh, triangles facing outwards as their parts' do."""
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    return Part(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.uv for part in parts]),
        np.concatenate([p.triangles + s for p, s in zip(parts, starts, strict=True)]),
    )


def turned(axis: int, degrees: float) -> Floats:
    """Rotation matrix (3, 3) about x, y or z."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    return matrix
