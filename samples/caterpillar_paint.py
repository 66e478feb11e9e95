"""The caterpillar's texture: rings and eyespots along the body, a face, plain patches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from glb import Floats
from textures import put, spectral_noise

SPINE = 12
"""Joints along the body; its rings are painted between them [1]."""
BODY, FACE, EYE = (0.0, 0.0, 1.0, 0.5), (0.0, 0.5, 0.5, 1.0), (0.5, 0.5, 0.75, 0.75)
SHOE, HORN, TIP = (0.75, 0.5, 1.0, 0.75), (0.5, 0.75, 0.75, 1.0), (0.75, 0.75, 1.0, 1.0)
"""Where the parts lie in the atlas (u0, v0, u1, v1) [1]."""


def paint() -> np.ndarray[Any, np.dtype[np.uint8]]:
    """The atlas (512, 512, 3), sRGB: body above, face, eye and plain patches below."""
    size = 512
    picture = np.zeros((size, size, 3))
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(256) + 0.5) / 256)
    _body(picture[:256], u, v)
    x, y = np.meshgrid(np.linspace(-1, 1, 256), np.linspace(-1, 1, 256))
    _face(picture[256:, :256], x, y)
    _eye(picture[256:384, 256:384], x[::2, ::2], y[::2, ::2])
    for patch, colour in (
        (SHOE, (0.86, 0.24, 0.36)),
        (HORN, (0.22, 0.13, 0.40)),
        (TIP, (0.98, 0.55, 0.12)),
    ):
        row, column = int(patch[1] * size), int(patch[0] * size)
        picture[row : row + 128, column : column + 128] = colour
    grain = spectral_noise(size, 0.5, 3) * 0.035 + spectral_noise(size, 1.2, 4) * 0.03
    return np.rint(255.0 * np.clip(picture * (1.0 + grain[..., None]), 0.0, 1.0)).astype(np.uint8)


def _body(picture: Floats, u: Floats, v: Floats) -> None:
    back = np.cos(2.0 * math.pi * (v - 0.25))[..., None]
    green, teal, belly = (
        np.array((0.52, 0.80, 0.16)),
        np.array((0.10, 0.55, 0.42)),
        np.array((0.93, 0.90, 0.52)),
    )
    picture[:] = green + np.clip(back, 0, 1) * (teal - green) * 0.75
    picture += np.clip(-1.6 * back - 0.3, 0, 1) * (belly - picture)
    segment = (u * (SPINE - 1)) % 1.0 - 0.5
    put(picture, abs(abs(segment) - 0.5) - 0.10, (0.98, 0.80, 0.15), 0.02)
    put(picture, abs(abs(segment) - 0.5) - 0.035, (0.16, 0.30, 0.20), 0.02)
    for angle, size, colour in (
        (0.25, 0.20, (0.36, 0.13, 0.50)),
        (0.10, 0.15, (0.95, 0.42, 0.10)),
        (0.40, 0.15, (0.95, 0.42, 0.10)),
    ):
        distance = np.hypot(segment, 3.6 * (v - angle))
        put(picture, distance - size, (0.98, 0.95, 0.80), 0.03)
        put(picture, distance - 0.72 * size, colour, 0.03)
    for angle in (0.175, 0.325):
        put(
            picture,
            np.hypot(abs(segment) - 0.24, 3.6 * (v - angle)) - 0.055,
            (0.98, 0.97, 0.85),
            0.03,
        )


def _face(picture: Floats, x: Floats, y: Floats) -> None:
    picture[:] = (0.55, 0.82, 0.18)
    put(picture, -y - 0.28 + 0.0 * x, (0.72, 0.88, 0.34), 0.5)
    for side in (-1.0, 1.0):
        put(picture, np.hypot(x - 0.33 * side, y - 0.16) - 0.085, (0.98, 0.46, 0.42), 0.06)
    smile = np.hypot(x, y - 0.06) - 0.20
    put(picture, np.maximum(abs(smile) - 0.018, 0.14 - y), (0.30, 0.08, 0.10), 0.016)
    rng = np.random.default_rng(5)
    for px, py in rng.uniform(-0.9, 0.9, (60, 2)):
        if math.hypot(px, py) > 0.48:
            put(
                picture,
                np.hypot(x - px, y - py) - rng.uniform(0.015, 0.045),
                (0.20, 0.50, 0.16),
                0.02,
            )


def _eye(picture: Floats, x: Floats, y: Floats) -> None:
    picture[:] = (0.97, 0.97, 0.94)
    for radius, colour in (
        (0.38, (0.10, 0.32, 0.50)),
        (0.33, (0.16, 0.52, 0.72)),
        (0.23, (0.02, 0.02, 0.03)),
    ):
        put(picture, np.hypot(x, y) - radius, colour, 0.03)
    put(picture, np.hypot(x + 0.12, y + 0.13) - 0.09, (1.0, 1.0, 1.0), 0.03)
