"""Shot 2, a brick path through an autumn park at noon (runs inside Blender)."""

from __future__ import annotations

import math

import blender_kit as kit
import bpy
import numpy as np
import textures
from shot_list import PARK

SKY = ((0.90, 0.93, 0.96), (0.22, 0.38, 0.68))
SKY_STRENGTH = 0.80
PATH_M = 1.15


def build() -> list[bpy.types.Object]:
    """Build everything but camera, sun and sky; nothing here hides a fairy light."""
    rng = np.random.default_rng(PARK.seed)
    _path()
    _verges(rng)
    _fallen_leaves(rng)
    _bench(0.98, 7.4, -1.25)
    _pumpkins()
    _trees(rng)
    _hedges(rng)
    return []


def _path() -> None:
    colour, height = textures.herringbone_bricks(2560, 16, PARK.seed)
    bricks = kit.ground_material("bricks", colour, height, roughness=0.75, relief_m=0.0015)
    corners = np.array(
        [(-PATH_M, 1.0, 0), (PATH_M, 1.0, 0), (PATH_M, 24.0, 0), (-PATH_M, 24.0, 0)], float
    )
    path = kit.mesh("path", corners, [(0, 1, 2, 3)], bricks)
    layer = path.data.uv_layers.new(name="uv")
    turn = math.radians(45.0)
    for loop, (x, y, _) in zip(layer.data, corners, strict=True):
        loop.uv = (
            (x * math.cos(turn) - y * math.sin(turn)) / 1.3,
            (x * math.sin(turn) + y * math.cos(turn)) / 1.3,
        )
    stone = kit.material("kerb", (0.34, 0.32, 0.29), bump=0.006, mottle=0.5, scale=22)
    for side in (-1.0, 1.0):
        for k in range(30):
            kit.box(
                "kerb",
                (side * (PATH_M + 0.05), 1.3 + 0.6 * k, 0.01),
                (0.10, 0.585, 0.09),
                stone,
                bevel=0.012,
            )


def _verges(rng: np.random.Generator) -> None:
    earth = kit.material("earth", (0.10, 0.085, 0.04), bump=0.03, mottle=0.6, scale=8)
    corners = np.array([(-30, 1, -0.02), (30, 1, -0.02), (30, 40, -0.02), (-30, 40, -0.02)], float)
    kit.mesh("earth", corners, [(0, 1, 2, 3)], earth)
    green = kit.leaf_material("grass", (0.05, 0.12, 0.015), (0.22, 0.30, 0.05), 0.3)
    blades = []
    for side in (-1.0, 1.0):
        count = 26000
        y = 2.0 + 12.0 * rng.uniform(size=count) ** 1.4
        x = side * (PATH_M + 0.12 + 2.4 * rng.uniform(size=count) ** 1.3)
        blades.append(np.stack([x, y, rng.uniform(0.0, 0.05, count)], axis=1))
    kit.leaves("grass", np.concatenate(blades), 0.085, green, rng, width=0.10)


def _fallen_leaves(rng: np.random.Generator) -> None:
    for name, dark, bright, count in (
        ("amber", (0.45, 0.14, 0.015), (0.85, 0.42, 0.04), 900),
        ("rust", (0.22, 0.06, 0.015), (0.58, 0.14, 0.03), 700),
        ("lime", (0.20, 0.20, 0.02), (0.60, 0.50, 0.06), 350),
    ):
        y = 2.2 + 11.0 * rng.uniform(size=count) ** 1.2
        x = rng.uniform(-1.0, 1.0, count)
        x = np.sign(x) * abs(x) ** 0.5 * (PATH_M + 0.25)
        paper = kit.leaf_material(name, dark, bright, 0.25)
        place = np.stack([x, y, rng.uniform(0.004, 0.014, count)], axis=1)
        kit.leaves(name, place, 0.085, paper, rng, flat=0.97, width=0.62)


def _pumpkins() -> None:
    skin = kit.material(
        "pumpkin", (0.72, 0.22, 0.02), roughness=0.4, bump=0.002, mottle=0.25, scale=30
    )
    stalk = kit.material("stalk", (0.12, 0.13, 0.04), bump=0.004, mottle=0.4)
    angle = np.linspace(-math.pi / 2, math.pi / 2, 25)
    for x, y, size in (
        (-0.90, 5.05, 0.17),
        (-0.66, 4.85, 0.11),
        (-0.98, 4.70, 0.12),
        (0.86, 4.35, 0.10),
    ):
        body = [(size * math.cos(a) ** 0.8, 0.72 * size * (1.0 + math.sin(a))) for a in angle]
        fruit = kit.lathe("pumpkin", body, (x, y, 0.0), skin, 96)
        for vertex in fruit.data.vertices:
            turn = math.atan2(vertex.co.y, vertex.co.x)
            rib = 0.90 + 0.10 * abs(math.cos(5.0 * turn)) ** 0.6
            vertex.co.x, vertex.co.y = vertex.co.x * rib, vertex.co.y * rib
        stem = [
            (0.16 * size, 1.38 * size),
            (0.09 * size, 1.6 * size),
            (0.11 * size, 1.8 * size),
            (0.0, 1.8 * size),
        ]
        kit.lathe("stalk", stem, (x, y, 0.0), stalk, 12)


def _bench(x: float, y: float, yaw: float) -> None:
    wood = kit.material("slats", (0.30, 0.14, 0.06), bump=0.004, mottle=0.5, scale=14)
    iron = kit.material("legs", (0.03, 0.04, 0.035), roughness=0.4, metallic=0.6)
    c, s = math.cos(yaw), math.sin(yaw)

    def at(u: float, v: float, z: float) -> tuple[float, float, float]:
        return (x + 0.55 + u * c - v * s, y + u * s + v * c, z)

    for v in (-0.16, -0.05, 0.06, 0.17):
        kit.box("seat", at(0.0, v, 0.44), (1.5, 0.09, 0.03), wood, yaw)
    for z in (0.58, 0.70, 0.82):
        kit.box("back", at(0.0, 0.25, z), (1.5, 0.025, 0.09), wood, yaw)
    for u in (-0.62, 0.62):
        for v, tall in ((-0.16, 0.43), (0.24, 0.88)):
            kit.box("leg", at(u, v, 0.5 * tall), (0.05, 0.05, tall), iron, yaw)


def _trees(rng: np.random.Generator) -> None:
    bark = kit.material("bark", (0.13, 0.095, 0.065), bump=0.05, mottle=0.7, scale=9)
    gold = kit.leaf_material("gold", (0.50, 0.20, 0.01), (0.85, 0.52, 0.05), 0.5)
    for x, y, radius in (
        (-1.75, 8.6, 0.16),
        (-2.6, 12.5, 0.22),
        (2.7, 13.5, 0.24),
        (1.95, 17.0, 0.25),
    ):
        profile = [
            (radius * f, z)
            for f, z in ((1.6, 0.0), (1.15, 0.12), (1.0, 0.5), (0.9, 2.0), (0.7, 4.0))
        ]
        kit.lathe("trunk", profile, (x, y, -0.03), bark, 24)
        crown = kit.in_ellipsoid(2600, (x, y, 3.6), (1.7, 1.7, 1.2), rng)
        kit.leaves("crown", crown, 0.14, gold, rng, width=0.6)


def _hedges(rng: np.random.Generator) -> None:
    tones = (
        ("box", (0.02, 0.06, 0.012), (0.12, 0.19, 0.03)),
        ("beech", (0.16, 0.08, 0.01), (0.42, 0.22, 0.03)),
        ("maple", (0.30, 0.05, 0.01), (0.62, 0.16, 0.03)),
    )
    surfaces = [kit.leaf_material(name, dark, bright, 0.4) for name, dark, bright in tones]
    for x, y, wide, tall, kind in (
        (-5.0, 15.0, 2.0, 1.2, 0),
        (-2.6, 18.5, 1.6, 1.0, 1),
        (0.2, 23.0, 2.2, 1.3, 0),
        (2.3, 18.5, 1.4, 0.9, 2),
        (4.6, 16.0, 2.0, 1.2, 0),
        (-2.9, 10.8, 0.7, 0.5, 2),
        (2.9, 11.0, 0.8, 0.5, 1),
        (-6.5, 26.0, 4.0, 2.2, 1),
        (6.0, 26.0, 4.0, 2.0, 2),
    ):
        count = int(1600 * wide)
        kit.leaves(
            "hedge",
            kit.in_ellipsoid(count, (x, y, 0.45 * tall), (wide, 0.7, 0.75 * tall), rng),
            0.17,
            surfaces[kind],
            rng,
            width=0.6,
        )
