"""Shapes of the built-in scenes, placed by screen position and CoC."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float64
from nlens_video.evaluate.bench.glb_writer import TexturedMesh, UInt8

WIDTH, HEIGHT, FOCAL_PX = 960, 512, 900.0
"""The picture that places are told in [px]."""

YFOV = 2.0 * math.atan(0.5 * HEIGHT / FOCAL_PX)
_SIDES = 16  # of a tube
_TEXTURE_PX = 256


@dataclass(frozen=True, slots=True)
class Place:
    """A point of the scene: where the picture shows it, and how blurred.

    Attributes:
        x: column [px].
        y: row [px].
        coc_px: signed diameter of its CoC [px].
    """

    x: float
    y: float
    coc_px: float


@dataclass(frozen=True, slots=True)
class SceneLens:
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
    total = np.zeros((_TEXTURE_PX, _TEXTURE_PX, 3), np.float32)
    base = rng.permutation([0.3, 0.5, 0.75]).astype(np.float32)
    for side, share in ((4, 0.25), (8, 0.3), (16, 0.25), (64, 0.2)):
        tiles = rng.random((side, side, 3), np.float32)
        whole = (_TEXTURE_PX, _TEXTURE_PX)
        total += share * cv2.resize(tiles, whole, interpolation=cv2.INTER_NEAREST)
    spread = np.clip(base + 1.8 * (total - 0.5), 0.03, 0.97)
    return np.asarray(np.round(255 * spread), np.uint8)


def card(
    optics: SceneLens, corners: Sequence[Place], seed: int, tile: float = 0.25
) -> TexturedMesh:
    """A flat textured card that glows.

    Args:
        optics: the scene's lens.
        corners: four in turn; the CoC must be affine in x and y, or the card is not flat.
        seed: of its texture.
        tile: side of the texture [scene unit].
    """
    points = np.array([optics.point(corner) for corner in corners])
    return TexturedMesh(
        points=points,
        uv=points[:, :2] / tile,
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        texture=texture(seed),
    )


def rectangle(left: Place, right: Place, rows: tuple[float, float]) -> list[Place]:
    """Corners of an upright rectangle whose CoC changes from left to right only.

    Args:
        left: column and CoC of the left side.
        right: column and CoC of the right side.
        rows: top and bottom [px].
    """
    top, bottom = rows
    return [
        Place(left.x, bottom, left.coc_px),
        Place(right.x, bottom, right.coc_px),
        Place(right.x, top, right.coc_px),
        Place(left.x, top, left.coc_px),
    ]


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
    return TexturedMesh(
        points=np.concatenate([rings.reshape(-1, 3), caps]),
        uv=np.concatenate([np.stack([u.ravel(), v.ravel()], axis=1), [[0.5, 0.0], [0.5, v.max()]]]),
        faces=_tube_faces(len(path)),
        texture=texture(seed),
        normals=outward if lit else None,
        joint=carried,
    )


def _tube_faces(rings: int) -> npt.NDArray[np.int64]:
    around = np.arange(_SIDES)
    step = _SIDES + 1
    faces = []
    for ring in range(rings - 1):
        a, b = ring * step + around, (ring + 1) * step + around
        faces += [np.stack([a, b, a + 1], axis=1), np.stack([b, b + 1, a + 1], axis=1)]
    first, last = rings * step, rings * step + 1
    end = (rings - 1) * step + around
    faces.append(np.stack([np.full(_SIDES, first), around, around + 1], axis=1))
    faces.append(np.stack([np.full(_SIDES, last), end + 1, end], axis=1))
    return np.concatenate(faces)
