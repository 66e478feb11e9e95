"""What stands about in a scene (runs inside Blender): shapes of about one unit, placed and scaled.

A builder returns objects that stand on z = 0 about the origin, within radius 0.5; `scene.py` turns,
scales and moves them. Of its three surfaces the third is foliage.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import blender_kit as kit
import bpy
import numpy as np

Rng = np.random.Generator
Surface = bpy.types.Material
Objects = list[bpy.types.Object]
Builder = Callable[[Rng, list[Surface]], Objects]


def boxes(rng: Rng, surfaces: list[Surface]) -> Objects:
    """One box, or a pile of them."""
    parts, top = [], 0.0
    for k in range(int(rng.choice([1, 1, 2, 4]))):
        size = (rng.uniform(0.4, 0.75), rng.uniform(0.4, 0.75), rng.uniform(0.12, 0.9))
        centre = (*rng.normal(0, 0.03, 2), top + 0.5 * size[2])
        bevel = float(rng.choice([0.004, 0.03]))
        parts.append(kit.box("box", centre, size, surfaces[k % 2], rng.uniform(0, 3), bevel))
        top += size[2]
    return parts


def vessel(rng: Rng, surfaces: list[Surface]) -> Objects:
    """A vase, bottle or bowl turned on a lathe."""
    heights = np.linspace(0.0, rng.uniform(0.3, 1.6), 14)
    swing = np.sin(heights * rng.uniform(2, 5) + rng.uniform(0, 6))
    radii = np.clip(0.28 + 0.17 * swing, 0.05, 0.48)
    profile = [(0.0, 0.0), *zip(radii, heights, strict=True), (radii[-1] - 0.03, heights[-1])]
    return [kit.lathe("vessel", [*profile, (0.0, 0.4 * heights[-1])], (0, 0, 0), surfaces[0], 40)]


def round_thing(rng: Rng, surfaces: list[Surface]) -> Objects:
    """A ball, drum, cone or ring."""
    kind = rng.integers(4)
    angle = np.linspace(-math.pi / 2, math.pi / 2, 24)
    tall = rng.uniform(0.3, 1.4)
    profile = [
        [(0.45 * math.cos(a), 0.45 + 0.45 * math.sin(a)) for a in angle],
        [(0.0, 0.0), (0.4, 0.0), (0.4, tall), (0.0, tall)],
        [(0.0, 0.0), (0.42, 0.0), (0.0, tall)],
        [(0.34 + 0.12 * math.cos(a), 0.12 + 0.12 * math.sin(a)) for a in 2 * angle + math.pi],
    ][kind]
    return [kit.lathe("round", profile, (0.0, 0.0, 0.0), surfaces[0], 48)]


def monkey(rng: Rng, surfaces: list[Surface]) -> Objects:
    """Blender's monkey, sitting."""
    bpy.ops.mesh.primitive_monkey_add(size=0.8)
    made = bpy.context.object
    made.data.materials.append(surfaces[0])
    made.data.polygons.foreach_set("use_smooth", [True] * len(made.data.polygons))
    made.rotation_euler = (-0.6, 0.0, rng.uniform(-1.5, 1.5))
    turn = made.rotation_euler.to_matrix()
    made.location = (0.0, 0.0, 0.01 - min((turn @ v.co).z for v in made.data.vertices))
    made.modifiers.new("smooth", "SUBSURF").render_levels = 2
    return [made]


def poles(rng: Rng, surfaces: list[Surface]) -> Objects:
    """Thin rods, upright or leaning, or a piece of fence."""
    thick, count = rng.uniform(0.015, 0.06), int(rng.integers(1, 7))
    tall, lean = rng.uniform(0.8, 2.5), rng.normal(0, 0.12) if rng.random() < 0.5 else 0.0
    parts = []
    for x in np.linspace(-0.42, 0.42, count) if count > 1 else [0.0]:
        parts.append(
            kit.box("pole", (float(x), 0.0, 0.5 * tall), (thick, thick, tall), surfaces[0])
        )
        parts[-1].rotation_euler = (0.0, lean, 0.0)
    if count > 2:
        for height in (0.3 * tall, 0.8 * tall):
            rail = (0.9, 0.5 * thick, 1.5 * thick)
            parts.append(kit.box("rail", (0.0, 0.0, height), rail, surfaces[1]))
    return parts


def plant(rng: Rng, surfaces: list[Surface]) -> Objects:
    """A bush of leaves, with or without a pot."""
    potted, tall = rng.random() < 0.5, rng.uniform(0.5, 1.2)
    foot = 0.35 if potted else 0.0
    radii = (0.36, 0.36, 0.5 * tall)
    points = kit.in_ellipsoid(int(rng.integers(150, 1500)), (0, 0, foot + 0.5 * tall), radii, rng)
    green = kit.leaves("leaf", points, rng.uniform(0.06, 0.2), surfaces[2], rng, width=0.4)
    profile = [(0.0, 0.0), (0.2, 0.0), (0.27, 0.38), (0.23, 0.38), (0.0, 0.34)]
    stem = kit.box("stem", (0, 0, 0.5 * (foot + tall)), (0.04, 0.04, foot + tall), surfaces[1])
    pot = [kit.lathe("pot", profile, (0, 0, 0), surfaces[0], 32)] if potted else []
    return [green, stem, *pot]


def debris(rng: Rng, surfaces: list[Surface]) -> Objects:
    """Chips and crumbs on the ground, one mesh."""
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    sides = np.array([[x, y, z] for x in (0, 1) for y in (2, 3) for z in (4, 5)])
    vertices, faces = [], []
    for k in range(int(rng.integers(20, 90))):
        size = 0.5 * 10 ** rng.uniform(-2.0, -0.9)
        chip = corners * rng.uniform(0.4, 1.0, (6, 3)) * size + rng.normal(0, 0.1 * size, (6, 3))
        chip += (*rng.uniform(-0.45, 0.45, 2), 0.3 * size)
        vertices.append(chip)
        faces.append(sides + 6 * k)
    return [kit.mesh("debris", np.concatenate(vertices), np.concatenate(faces), surfaces[0])]


def rack(rng: Rng, surfaces: list[Surface]) -> Objects:
    """A small shelf or table: boards on legs, something on each board."""
    parts, boards, tall = [], int(rng.integers(1, 4)), rng.uniform(0.5, 1.3)
    for x in (-0.42, 0.42):
        for y in (-0.22, 0.22):
            parts.append(kit.box("leg", (x, y, 0.5 * tall), (0.04, 0.04, tall), surfaces[1]))
    for height in np.linspace(tall, 0.25, boards):
        parts.append(kit.box("board", (0, 0, height), (0.95, 0.55, 0.03), surfaces[0]))
        for x in np.arange(-0.35, 0.4, 0.17):
            size = (rng.uniform(0.05, 0.13), rng.uniform(0.1, 0.3), rng.uniform(0.08, 0.25))
            centre = (x, rng.normal(0, 0.05), height + 0.015 + 0.5 * size[2])
            parts.append(kit.box("item", centre, size, surfaces[int(rng.integers(2))], bevel=0.006))
    return parts


BUILDERS: tuple[Builder, ...] = (
    boxes,
    boxes,
    vessel,
    round_thing,
    round_thing,
    monkey,
    poles,
    plant,
    debris,
    rack,
)
