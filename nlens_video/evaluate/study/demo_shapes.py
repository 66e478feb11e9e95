"""Table, wall and balls of the demonstration, camera-space: x right, y up, looking along -z."""

from __future__ import annotations

import math

import cv2
import numpy as np

from nlens_video.evaluate.bench.glb_writer import TexturedMesh, UInt8

YFOV = 0.8
_GROUND, _RADIUS, _WALL, _NEAR, _WIDE, _HIGH = -0.25, 0.07, 3.0, 0.35, 5.0, 3.0
_AROUND, _UP = 48, 24  # facets of a ball
_COLOURS = {
    "red": (190, 30, 30), "green": (25, 140, 60), "yellow": (225, 180, 30),
    "blue": (30, 60, 170), "orange": (230, 110, 25), "purple": (95, 40, 130),
}  # fmt: skip


def ball(at: tuple[float, float], colour: str) -> TexturedMesh:
    """A ball on the table, a stripe about it.

    Args:
        at: x and depth of its middle [scene unit].
        colour: its name.
    """
    turn, rise = np.meshgrid(
        np.linspace(0, 2 * math.pi, _AROUND + 1), np.linspace(0, math.pi, _UP + 1)
    )
    normals = np.stack(
        [np.sin(rise) * np.cos(turn), np.cos(rise), np.sin(rise) * np.sin(turn)], axis=-1
    ).reshape(-1, 3)
    corner = np.arange(_UP)[:, None] * (_AROUND + 1) + np.arange(_AROUND)
    a, b = corner.ravel(), corner.ravel() + _AROUND + 1
    texture = np.full((64, 8, 3), _COLOURS[colour], np.uint8)
    texture[28:36] = 235
    return TexturedMesh(
        points=np.array([at[0], _GROUND + _RADIUS, -at[1]]) + _RADIUS * normals,
        uv=np.stack([turn / (2 * math.pi), rise / math.pi], axis=-1).reshape(-1, 2),
        faces=np.concatenate(
            [np.stack([a, a + 1, b], axis=1), np.stack([a + 1, b + 1, b], axis=1)]
        ),
        texture=texture,
        normals=normals,
    )


def room() -> list[TexturedMesh]:
    """The table's cloth and the wall behind it, which glow: they cast and take no shadow."""
    table = [(-_WIDE, _GROUND, -_NEAR), (_WIDE, _GROUND, -_NEAR),
             (_WIDE, _GROUND, -_WALL), (-_WIDE, _GROUND, -_WALL)]  # fmt: skip
    wall = [(-_WIDE, _GROUND, -_WALL), (_WIDE, _GROUND, -_WALL),
            (_WIDE, _HIGH, -_WALL), (-_WIDE, _HIGH, -_WALL)]  # fmt: skip
    return [
        _sheet(np.array(table), (0, 2), _woven((40, 105, 75), 1)),
        _sheet(np.array(wall), (0, 1), _woven((150, 130, 110), 2)),
    ]


def _sheet(points: np.ndarray, axes: tuple[int, int], texture: UInt8) -> TexturedMesh:
    return TexturedMesh(
        points=points,
        uv=points[:, axes] / 0.5,
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        texture=texture,
    )


def _woven(colour: tuple[int, int, int], seed: int) -> UInt8:
    """Detail of every size about a colour (h, w, 3); it tiles."""
    rng = np.random.default_rng(seed)
    light = np.zeros((512, 512), np.float32)
    for side in (8, 32, 128, 256):
        tiles = rng.random((side, side), np.float32) - 0.5
        light += cv2.resize(tiles, (512, 512), interpolation=cv2.INTER_NEAREST)
    shaded = np.array(colour) * (1 + 0.6 * light)[..., None]
    return np.asarray(np.clip(np.round(shaded), 8, 247), np.uint8)
