"""What stands on the ground of a training scene, as triangles: posts, people, trees, walls.

Axes as glTF's: x right, y up, z towards the viewer. A thing stands on y = 0 around the origin and
is about one unit high or wide.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
import trimesh

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Rng = np.random.Generator


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A closed surface of one material.

    Attributes:
        vertices: (V, 3).
        faces: corners (F, 3).
        smooth: whether its normals turn over its faces, as a ball's do.
        material: which of the materials of its thing it has.
    """

    vertices: Floats
    faces: Ints
    smooth: bool = False
    material: int = 0

    def moved(self, turn: Floats, size: float, to: Floats) -> Part:
        """Turned by a matrix (3, 3), enlarged, then shifted (3,)."""
        placed = size * self.vertices @ turn.T + to
        return Part(placed, self.faces, self.smooth, self.material)


def about_y(angle: float) -> Floats:
    """Matrix (3, 3) of a turn about the vertical [rad]."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


@cache
def _unit(kind: str) -> tuple[Floats, Ints]:
    """A box, cylinder, cone or ball of extent 1 around the origin."""
    if kind == "box":
        made = trimesh.creation.box((1.0, 1.0, 1.0))
    elif kind == "ball":
        made = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    elif kind == "cylinder":
        made = trimesh.creation.cylinder(radius=0.5, height=1.0, sections=20)
    else:
        made = trimesh.creation.cone(radius=0.5, height=1.0, sections=20)
        made.apply_translation((0.0, 0.0, -0.5))
    vertices = np.asarray(made.vertices, np.float64)
    if kind in ("cylinder", "cone"):
        vertices = vertices[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
    return vertices, np.asarray(made.faces, np.int64)


def solid(
    kind: str, size: tuple[float, float, float], at: tuple[float, float, float],
    turn: Floats | None = None, material: int = 0,
) -> Part:  # fmt: skip
    """A box, cylinder, cone or ball of some size, its middle at a point.

    Args:
        kind: `box`, `cylinder`, `cone` or `ball`.
        size: along x, y and z.
        at: its middle.
        turn: matrix (3, 3) about its middle, None for none.
        material: which of the materials of its thing it has.
    """
    vertices, faces = _unit(kind)
    placed = vertices * size
    if turn is not None:
        placed = placed @ turn.T
    return Part(placed + at, faces, kind == "ball", material)


def _leaning(rng: Rng, most: float) -> Floats:
    around, lean = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, most)
    cosine, sine = math.cos(lean), math.sin(lean)
    tilt = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return about_y(around) @ tilt @ about_y(-around)


def block(rng: Rng) -> list[Part]:
    """A box, sometimes with a smaller one on top."""
    wide, tall, deep = rng.uniform((0.3, 0.2, 0.3), (1.0, 1.2, 1.0))
    parts = [solid("box", (wide, tall, deep), (0.0, 0.5 * tall, 0.0))]
    if rng.random() < 0.3:
        share = rng.uniform(0.3, 0.9)
        size = share * wide, rng.uniform(0.1, 0.6), share * deep
        parts.append(solid("box", size, (0.0, tall + 0.5 * size[1], 0.0), material=1))
    return parts


def drum(rng: Rng) -> list[Part]:
    """A cylinder or a cone."""
    wide, tall = rng.uniform(0.2, 0.9), rng.uniform(0.2, 1.2)
    kind = "cylinder" if rng.random() < 0.65 else "cone"
    return [solid(kind, (wide, tall, wide), (0.0, 0.5 * tall, 0.0))]


def ball(rng: Rng) -> list[Part]:
    """A ball or an egg that lies on the ground."""
    wide, tall, deep = rng.uniform(0.3, 0.9, 3)
    if rng.random() < 0.5:
        wide = tall = deep
    return [solid("ball", (wide, tall, deep), (0.0, 0.5 * tall, 0.0))]


def post(rng: Rng) -> list[Part]:
    """A post, sometimes with a board or a lamp."""
    wide, tall = rng.uniform(0.02, 0.1), rng.uniform(0.8, 1.5)
    kind = "box" if rng.random() < 0.5 else "cylinder"
    parts = [solid(kind, (wide, tall, wide), (0.0, 0.5 * tall, 0.0), _leaning(rng, 0.08))]
    if rng.random() < 0.4:
        size = rng.uniform(0.15, 0.5), rng.uniform(0.08, 0.4), 0.5 * wide
        parts.append(solid("box", size, (0.0, 0.9 * tall, 0.6 * wide), material=1))
    return parts


def fence(rng: Rng) -> list[Part]:
    """Posts in a row with rails."""
    count, gap, tall = int(rng.integers(4, 14)), rng.uniform(0.08, 0.4), rng.uniform(0.25, 0.7)
    wide = rng.uniform(0.2, 0.6) * gap
    middle = 0.5 * (count - 1) * gap
    parts = [
        solid("box", (wide, tall, 0.03), (k * gap - middle, 0.5 * tall, 0.0)) for k in range(count)
    ]
    for height in rng.uniform(0.2, 0.95, int(rng.integers(1, 3))):
        parts.append(solid("box", (2.0 * middle, 0.06 * tall, 0.03), (0.0, height * tall, 0.03)))
    return parts


def wall(rng: Rng) -> list[Part]:
    """A low wall."""
    size = rng.uniform(0.8, 3.0), rng.uniform(0.15, 0.7), rng.uniform(0.05, 0.2)
    return [solid("box", size, (0.0, 0.5 * size[1], 0.0))]


def person(rng: Rng) -> list[Part]:
    """Legs, body, arms and head."""
    stride, swing = rng.uniform(0.0, 0.25, 2)
    parts = []
    for side in (-1.0, 1.0):
        lean = _about_x(side * stride)
        leg = (0.06 * side, 0.24, 0.22 * side * stride)
        parts.append(solid("cylinder", (0.09, 0.5, 0.1), leg, lean, material=1))
        arm = (0.16 * side, 0.62, -0.15 * side * swing)
        parts.append(solid("cylinder", (0.06, 0.38, 0.06), arm, _about_x(-side * swing)))
    parts.append(solid("ball", (0.3, 0.48, 0.2), (0.0, 0.65, 0.0)))
    parts.append(solid("ball", (0.14, 0.18, 0.16), (0.0, 0.93, 0.0), material=2))
    return parts


def _about_x(angle: float) -> Floats:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def tree(rng: Rng) -> list[Part]:
    """A trunk under a crown of balls, or of loose leaves."""
    trunk, wide = rng.uniform(0.2, 0.6), rng.uniform(0.03, 0.1)
    parts = [solid("cylinder", (wide, trunk, wide), (0.0, 0.5 * trunk, 0.0), material=1)]
    spread = rng.uniform(0.15, 0.4)
    if rng.random() < 0.5:
        for _ in range(int(rng.integers(2, 9))):
            size = rng.uniform(0.2, 0.5, 3)
            x, y, z = rng.normal(0.0, 0.5 * spread, 3)
            parts.append(solid("ball", tuple(size), (x, trunk + spread + y, z)))
    else:
        parts.append(_leaves(rng, 1.3 * spread, (0.0, trunk + spread, 0.0)))
    return parts


def bush(rng: Rng) -> list[Part]:
    """Leaves from the ground on, or low balls."""
    if rng.random() < 0.5:
        return [_leaves(rng, rng.uniform(0.2, 0.5), (0.0, rng.uniform(0.1, 0.4), 0.0))]
    return [
        solid("ball", tuple(rng.uniform(0.2, 0.6, 3)), (x, 0.15, z))
        for x, z in rng.normal(0.0, 0.2, (int(rng.integers(2, 7)), 2))
    ]


def _leaves(rng: Rng, spread: float, at: tuple[float, float, float]) -> Part:
    count = int(rng.integers(150, 700))
    middle = rng.normal(0.0, 0.5 * spread, (count, 1, 3))
    corner = rng.normal(0.0, rng.uniform(0.1, 0.25) * spread, (count, 3, 3))
    vertices = (middle + corner).reshape(-1, 3) + at
    vertices[:, 1] = np.maximum(vertices[:, 1], 0.0)
    return Part(vertices, np.arange(3 * count).reshape(-1, 3))


def table(rng: Rng) -> list[Part]:
    """A board on legs, as tables, benches and chairs are; chairs have a back."""
    wide, deep, tall = rng.uniform((0.3, 0.3, 0.2), (1.2, 0.8, 0.8))
    leg = rng.uniform(0.02, 0.06)
    parts = [solid("box", (wide, 0.04, deep), (0.0, tall, 0.0))]
    for x in (-0.45, 0.45):
        for z in (-0.45, 0.45):
            at = x * wide, 0.5 * tall, z * deep
            parts.append(solid("box", (leg, tall, leg), at, material=1))
    if rng.random() < 0.4:
        parts.append(solid("box", (wide, 0.8 * tall, 0.03), (0.0, 1.4 * tall, 0.5 * deep)))
    return parts


def car(rng: Rng) -> list[Part]:
    """A car, as two boxes on wheels."""
    long, tall = rng.uniform(1.2, 2.2), rng.uniform(0.2, 0.35)
    parts = [
        solid("box", (long, tall, 0.7), (0.0, 0.6 * tall, 0.0)),
        solid("box", (0.55 * long, tall, 0.6), (rng.uniform(-0.1, 0.1), 1.5 * tall, 0.0)),
    ]
    for x in (-0.32, 0.32):
        for z in (-0.35, 0.35):
            wheel = (0.22, 0.08, 0.22)
            parts.append(solid("cylinder", wheel, (x * long, 0.11, z), _about_x(1.5708), 1))
    return parts


def arch(rng: Rng) -> list[Part]:
    """Two pillars with a beam."""
    wide, tall, thick = rng.uniform((0.4, 0.5, 0.05), (1.5, 1.2, 0.2))
    parts = [
        solid("box", (thick, tall, thick), (0.5 * side * wide, 0.5 * tall, 0.0))
        for side in (-1.0, 1.0)
    ]
    return [*parts, solid("box", (wide + thick, thick, thick), (0.0, tall, 0.0))]


def lying(rng: Rng) -> list[Part]:
    """A log or a plank on the ground."""
    long, wide = rng.uniform(0.5, 1.2), rng.uniform(0.04, 0.2)
    tall = wide if rng.random() < 0.5 else 0.3 * wide
    return [solid("box", (long, tall, wide), (0.0, 0.5 * tall, 0.0))]


def stones(rng: Rng) -> list[Part]:
    """Some stones."""
    parts = []
    for x, z in rng.normal(0.0, 0.4, (int(rng.integers(1, 8)), 2)):
        wide, tall, deep = rng.uniform(0.08, 0.5) * rng.uniform(0.5, 1.0, 3)
        parts.append(solid("ball", (wide, tall, deep), (x, 0.3 * tall, z)))
    return parts


def clutter(rng: Rng) -> list[Part]:
    """Boxes and balls in a heap."""
    parts = []
    for _ in range(int(rng.integers(2, 8))):
        size = tuple(rng.uniform(0.1, 0.5, 3))
        at = (rng.normal(0.0, 0.25), rng.uniform(0.05, 0.4), rng.normal(0.0, 0.25))
        kind = str(rng.choice(["box", "ball", "cylinder"]))
        parts.append(solid(kind, size, at, _leaning(rng, 0.6), int(rng.integers(3))))
    return parts


BUILDERS: tuple[Callable[[Rng], list[Part]], ...] = (
    block, drum, ball, post, fence, wall, person, tree, bush, table, car, arch, lying, stones,
    clutter, block, drum, post, person,
)  # fmt: skip
