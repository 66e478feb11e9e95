"""Textured shapes of the scenes of `bench` and of the study, camera-space: y up, looking along -z.

The shapes of `bench` are placed by screen position and CoC.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64, UInt8
from nlens_video.evaluate.bench.glb_writer import TexturedMesh

WIDTH, HEIGHT, FOCAL_PX = 960, 512, 900.0
"""The picture in whose pixels places are given [px]."""

YFOV = 2.0 * math.atan(0.5 * HEIGHT / FOCAL_PX)
_SIDES = 16  # of a tube
_AROUND, _UP = 48, 24  # facets of a ball


class Place(Struct, frozen=True):
    """A point of the scene by its column, row and signed CoC diameter in the picture [px]."""

    x: float
    y: float
    coc_px: float


class SceneLens(Struct, frozen=True):
    """The lens of a scene: coc_px = slope * disparity + intercept on the picture of 960x512."""

    slope: float
    intercept: float

    def point(self, place: Place) -> Float64:
        """A place as a camera-space point (3,) [scene unit]."""
        depth = self.slope / (place.coc_px - self.intercept)
        x, y = (place.x - 0.5 * WIDTH) / FOCAL_PX, (0.5 * HEIGHT - place.y) / FOCAL_PX
        return depth * np.array([x, y, -1.0])

    def size(self, place: Place, pixels: float) -> float:
        """What spans so many pixels at a place [scene unit]."""
        return pixels * self.slope / (place.coc_px - self.intercept) / FOCAL_PX


def texture(seed: int) -> UInt8:
    """Detail of every size about a colour of its own, display-coded (h, w, 3); it tiles."""
    rng = np.random.default_rng(seed)
    base = rng.permutation([0.3, 0.5, 0.75]).astype(np.float32)
    total = np.zeros((256, 256, 3), np.float32)
    for side, share in ((4, 0.25), (8, 0.3), (16, 0.25), (64, 0.2)):
        total += share * _tiled(rng.random((side, side, 3), np.float32), 256)
    spread = np.clip(base + 1.8 * (total - 0.5), 0.03, 0.97)
    return np.asarray(np.round(255 * spread), np.uint8)


def woven(colour: tuple[int, int, int], seed: int) -> UInt8:
    """Detail of every size about a colour, display-coded (h, w, 3); it tiles."""
    rng = np.random.default_rng(seed)
    light = np.zeros((512, 512), np.float32)
    for side in (8, 32, 128, 256):
        light += _tiled(rng.random((side, side), np.float32) - 0.5, 512)
    shaded = np.array(colour) * (1 + 0.6 * light)[..., None]
    return np.asarray(np.clip(np.round(shaded), 8, 247), np.uint8)


def _tiled(tiles: Float32, side: int) -> Float32:
    resized = cv2.resize(tiles, (side, side), interpolation=cv2.INTER_NEAREST)
    return np.asarray(resized, np.float32)


def sheet(
    points: Float64, pixels: UInt8, tile: float, axes: tuple[int, int] = (0, 1)
) -> TexturedMesh:
    """A flat quadrilateral of corners (4, 3) that glows: it casts and takes no shadow.

    Its texture, display-coded `pixels` (h, w, 3), repeats every `tile` scene units along two axes.
    """
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return TexturedMesh(points=points, uv=points[:, axes] / tile, faces=faces, texture=pixels)


def card(
    optics: SceneLens, corners: Sequence[Place], seed: int, tile: float = 0.25
) -> TexturedMesh:
    """A sheet between four places, whose CoC must be affine in x and y, or it is not flat."""
    return sheet(np.array([optics.point(corner) for corner in corners]), texture(seed), tile)


def rectangle(left: Place, right: Place, rows: tuple[float, float]) -> list[Place]:
    """Corners of an upright rectangle between two columns, its CoC the same along each.

    Top and bottom are `rows` [px]; those of the two places are not used.
    """
    top, bottom = rows
    ways = ((left, bottom), (right, bottom), (right, top), (left, top))
    return [Place(side.x, row, side.coc_px) for side, row in ways]


def ball(middle: Float64, radius: float, pixels: UInt8) -> TexturedMesh:
    """A ball about a centre (3,) [scene unit]; lights shine on it.

    Rows of its texture, display-coded `pixels` (h, w, 3), lie from pole to pole.
    """
    turn, rise = np.meshgrid(
        np.linspace(0, 2 * math.pi, _AROUND + 1), np.linspace(0, math.pi, _UP + 1)
    )
    normals = np.stack(
        [np.sin(rise) * np.cos(turn), np.cos(rise), np.sin(rise) * np.sin(turn)], axis=-1
    ).reshape(-1, 3)
    a, b = _lattice(_UP, _AROUND)
    return TexturedMesh(
        points=middle + radius * normals,
        uv=np.stack([turn / (2 * math.pi), rise / math.pi], axis=-1).reshape(-1, 2),
        faces=_faces((a, a + 1, b), (a + 1, b + 1, b)),
        texture=pixels,
        normals=normals,
    )


def tube(
    path: Float64,
    radii: Sequence[float],
    seed: int,
    *,
    joints: Sequence[int] | None = None,
    lit: bool = True,
) -> TexturedMesh:
    """A round tube, closed at its ends.

    Args:
        path: points along its axis (P, 3) [scene unit].
        radii: at each of them [scene unit].
        seed: of its texture.
        joints: joint that carries each of them, if any does.
        lit: whether lights shine on it; else it glows.
    """
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, [0.31, 0.17, 0.93])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    up = np.cross(aside, along)
    turn = 2.0 * math.pi * np.arange(_SIDES + 1) / _SIDES  # the seam twice, for the texture
    normals = (
        np.cos(turn)[None, :, None] * aside[:, None] + np.sin(turn)[None, :, None] * up[:, None]
    )
    rings = path[:, None] + np.asarray(radii)[:, None, None] * normals
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    girth = max(2.0 * math.pi * max(radii), 1e-9)
    u, v = np.meshgrid(turn / (2.0 * math.pi), way / girth)
    caps = [path[0], path[-1]]
    outward = np.concatenate([normals.reshape(-1, 3), [-along[0], along[-1]]])
    carried = None
    if joints is not None:
        ends = [joints[0], joints[-1]]
        carried = np.concatenate([np.repeat(joints, _SIDES + 1), ends]).astype(np.int64)
    first, last = rings.shape[0] * rings.shape[1] + np.arange(2)
    start, end = np.arange(_SIDES), (len(path) - 1) * (_SIDES + 1) + np.arange(_SIDES)
    a, b = _lattice(len(path) - 1, _SIDES)
    return TexturedMesh(
        points=np.concatenate([rings.reshape(-1, 3), caps]),
        uv=np.concatenate([np.stack([u.ravel(), v.ravel()], axis=1), [[0.5, 0.0], [0.5, v.max()]]]),
        faces=_faces(
            (a, b, a + 1), (b, b + 1, a + 1), (first, start, start + 1), (last, end + 1, end)
        ),
        texture=texture(seed),
        normals=outward if lit else None,
        joint=carried,
    )


def _lattice(rows: int, columns: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First vertices of each quad of a lattice of (rows + 1) x (columns + 1), and those below."""
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    return a, a + columns + 1


def _faces(*triangles: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]) -> npt.NDArray[np.int64]:
    """Triangles (T, 3) of vertices one, two and three, (n,) or the same for all."""
    return np.concatenate([np.stack(np.broadcast_arrays(*three), axis=1) for three in triangles])
