"""The object of a scene: parts, paint and file (numpy; pygltflib only to write the file).

Both sides build it from the seed: Blender to render it, the script outside to write the GLB.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from shapes import Floats, Part, ball, merge, tube, turned

from truth.plan import View

Rng = np.random.Generator
Patch = tuple[float, float, float, float]
PAINT_PX = 512
QUARTERS: tuple[Patch, ...] = tuple(
    (0.5 * i + 0.01, 0.5 * j + 0.01, 0.5 * i + 0.49, 0.5 * j + 0.49)
    for i in range(2)
    for j in range(2)
)


def cuboid(size: tuple[float, float, float], patch: Patch) -> Part:
    """A box about the origin; every side wears the whole patch."""
    u0, v0, u1, v1 = patch
    positions, uv, triangles = [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal, right, up = np.zeros(3), np.zeros(3), np.zeros(3)
            normal[axis], right[(axis + 1) % 3], up[(axis + 2) % 3] = sign, sign, 1.0
            start = len(positions)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                positions.append(0.5 * (normal + a * right + b * up) * np.array(size))
                uv.append((u0 if a < 0 else u1, v1 if b < 0 else v0))
            triangles += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
    return Part(np.array(positions), np.array(uv), np.array(triangles))


def _stones(rng: Rng) -> list[Part]:
    """A few boulders, one behind the other."""
    parts = []
    for k in range(int(rng.integers(3, 7))):
        radii = rng.uniform(0.10, 0.24, 3)
        stone = ball((radii[0], radii[1], radii[2]), QUARTERS[k % 4], 24, 36)
        bump = 1.0 + 0.06 * np.sin(stone.positions @ rng.normal(0.0, 18.0, 3))
        stone = Part(stone.positions * bump[:, None], stone.uv, stone.triangles)
        place = (rng.uniform(-0.3, 0.3), rng.uniform(-0.7, 0.7), 0.98 * radii[2])
        parts.append(stone.moved(turned(2, rng.uniform(0, 360)), place))
    return parts


def _arch(rng: Rng) -> list[Part]:
    """A thick hose that rises and falls as it runs away from the camera."""
    t = np.linspace(0.0, 1.0, 90)
    radius = rng.uniform(0.07, 0.13)
    rise = radius + rng.uniform(0.05, 0.25) * np.sin(t * math.pi * rng.integers(1, 4)) ** 2
    centres = np.stack([np.zeros_like(t), 1.4 * (t - 0.5), rise], axis=1)
    radii = radius * np.sqrt(np.clip(1.0 - (2.0 * t - 1.0) ** 8, 0.0, None)) + 1e-4
    body = tube(centres, radii, (0.01, 0.01, 0.99, 0.99), 40)
    return [body.moved(turned(2, rng.uniform(15, 75)), (0.0, 0.0, 0.0))]


def _blocks(rng: Rng) -> list[Part]:
    """Building blocks in a row, some on top of others."""
    parts = []
    for k in range(int(rng.integers(2, 6))):
        size = rng.uniform(0.15, 0.42, 3)
        turn, place = turned(2, rng.uniform(0, 90)), rng.uniform(-0.45, 0.45, 2) * (0.7, 1.6)
        block = cuboid((size[0], size[1], size[2]), QUARTERS[k % 4])
        parts.append(block.moved(turn, (place[0], place[1], 0.5 * size[2])))
        if rng.random() < 0.5:
            top = cuboid((0.6 * size[0], 0.6 * size[1], 0.5 * size[2]), QUARTERS[(k + 1) % 4])
            parts.append(top.moved(turned(2, rng.uniform(0, 90)), (*place, 1.25 * size[2])))
    return parts


def _chair(rng: Rng) -> list[Part]:
    """Seat, four legs, a back of bars: thin parts with the plate between them."""
    deep, seat, leg = rng.uniform(0.45, 0.9), rng.uniform(0.3, 0.45), rng.uniform(0.025, 0.05)
    parts = [cuboid((0.5, deep, 0.05), QUARTERS[0]).moved(np.eye(3), (0.0, 0.0, seat))]
    for x in (-0.22, 0.22):
        for y in (-0.44 * deep, 0.44 * deep):
            part = cuboid((leg, leg, seat), QUARTERS[1])
            parts.append(part.moved(np.eye(3), (x, y, 0.5 * seat)))
    for x in np.linspace(-0.22, 0.22, int(rng.integers(3, 6))):
        bar = cuboid((0.5 * leg, 0.5 * leg, 0.45), QUARTERS[2])
        parts.append(bar.moved(np.eye(3), (float(x), 0.44 * deep, seat + 0.225)))
    rail = cuboid((0.5, 1.2 * leg, 0.08), QUARTERS[3])
    parts.append(rail.moved(np.eye(3), (0.0, 0.44 * deep, seat + 0.45)))
    turn = turned(2, rng.uniform(-70, 70))
    return [part.moved(turn, (0.0, 0.0, 0.0)) for part in parts]


def mesh(view: View) -> Part:
    """The object where it stands, Blender's axes [m]."""
    rng = np.random.default_rng([view.seed, 10])
    build = (_stones, _arch, _blocks, _chair)[int(rng.integers(4))]
    whole = merge(build(rng))
    low, high = whole.positions.min(0), whole.positions.max(0)
    scale = view.size_m / max(high[0] - low[0], 0.8 * (high[2] - low[2]), 0.45 * (high[1] - low[1]))
    foot = np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])
    positions = (whole.positions - foot) * scale + np.array([*view.place, 0.0])
    return Part(positions, whole.uv, whole.triangles)


def depths(view: View, body: Part) -> tuple[float, float, float]:
    """Nearest, median and farthest depth of a mesh's vertices [m]."""
    depth = view.project(body.positions)[:, 2]
    return float(depth.min()), float(np.median(depth)), float(depth.max())


def paint(view: View) -> npt.NDArray[np.uint8]:
    """Base colour (PAINT_PX, PAINT_PX, 3), display-coded sRGB, a pattern in each quarter."""
    rng = np.random.default_rng([view.seed, 11])
    side = PAINT_PX // 2
    v, u = (np.mgrid[0:side, 0:side] + 0.5) / side
    picture = np.empty((PAINT_PX, PAINT_PX, 3))
    for j in range(2):
        for i in range(2):
            turn, count = rng.uniform(0, math.pi), rng.integers(4, 12)
            along = (u * math.cos(turn) + v * math.sin(turn)) * count
            across = (v * math.cos(turn) - u * math.sin(turn)) * count
            kind = rng.integers(4)
            mask = (
                np.float64(along % 1 < 0.5),
                np.float64((along % 1 < 0.5) != (across % 1 < 0.5)),
                np.float64((along % 1 - 0.5) ** 2 + (across % 1 - 0.5) ** 2 < 0.1),
                np.clip(0.5 + 0.3 * _speckle(rng, side), 0.0, 1.0),
            )[kind]
            first, second = rng.uniform(25, 235, 3), rng.uniform(25, 235, 3)
            tile = first + mask[..., None] * (second - first)
            tile += 14.0 * _speckle(rng, side)[..., None]
            picture[j * side : (j + 1) * side, i * side : (i + 1) * side] = tile
    return np.uint8(np.clip(picture, 12, 245))


def _speckle(rng: Rng, side: int) -> Floats:
    """Noise of unit deviation, coarse and fine."""
    coarse = np.kron(rng.standard_normal((side // 8, side // 8)), np.ones((8, 8)))
    return np.asarray((coarse + rng.standard_normal((side, side))) / math.sqrt(2.0))
