"""Shot 1, a tiled table on a terrace in the last sun (runs inside Blender)."""

from __future__ import annotations

import math

import blender_kit as kit
import bpy
import numpy as np
import textures
from shot_list import TERRACE, bulbs

SKY = ((0.50, 0.36, 0.30), (0.16, 0.24, 0.42))
SKY_STRENGTH = 0.55


def build() -> list[bpy.types.Object]:
    """Build everything but camera, sun and sky; return what hides the fairy lights."""
    rng = np.random.default_rng(TERRACE.seed)
    near = [_table(), *_pots(rng), *_lantern(), *_fruit(rng), *_cup(), *_jug()]
    _garden(rng)
    for index, (x, y, z, *colour) in enumerate(bulbs(TERRACE)[::3]):
        lamp = kit.lamp(f"bulb {index}", "POINT", (x, y, z), 3.0, tuple(colour))
        lamp.lightgroup = "lamps"
    return near


def _table() -> bpy.types.Object:
    colour, height = textures.encaustic_tiles(2700, 6, TERRACE.seed)
    tiles = kit.ground_material("tiles", colour, height, roughness=0.55, relief_m=0.0005)
    corners = np.array([(-1.7, 0.2, 0), (1.7, 0.2, 0), (1.7, 2.75, 0), (-1.7, 2.75, 0)], float)
    table = kit.mesh("table", corners, [(0, 1, 2, 3)], tiles)
    layer = table.data.uv_layers.new(name="uv")
    for loop, corner in zip(layer.data, corners, strict=True):
        loop.uv = ((corner[0] + 0.06) / 1.08, corner[1] / 1.08)
    stone = kit.material("stone", (0.36, 0.31, 0.25), bump=0.01, scale=30)
    kit.box("edge", (0.0, 2.775, -0.032), (3.4, 0.05, 0.06), stone)
    return table


def _pots(rng: np.random.Generator) -> list[bpy.types.Object]:
    clay = kit.material("clay", (0.46, 0.17, 0.08), bump=0.004, mottle=0.35, scale=18)
    glaze = kit.material("glaze", (0.04, 0.16, 0.22), roughness=0.2, scale=25)
    soil = kit.material("soil", (0.05, 0.03, 0.02), bump=0.02, scale=60)
    herb = kit.leaf_material("herb", (0.05, 0.12, 0.03), (0.20, 0.30, 0.10))
    bloom = kit.leaf_material("bloom", (0.55, 0.04, 0.10), (0.85, 0.16, 0.22), 0.5)
    profile = [
        (0.0, 0.0),
        (0.085, 0.0),
        (0.115, 0.19),
        (0.128, 0.19),
        (0.130, 0.235),
        (0.115, 0.235),
        (0.110, 0.20),
        (0.0, 0.20),
    ]
    parts = []
    for place, scale, surface in (
        ((-0.60, 2.35, 0.0), 0.70, clay),
        ((-0.84, 2.10, 0.0), 0.55, glaze),
    ):
        pot = kit.lathe("pot", [(r * scale, z * scale) for r, z in profile], place, surface)
        crown = (place[0], place[1], place[2] + 0.33 * scale)
        green = kit.in_ellipsoid(1500, crown, (0.21 * scale, 0.20 * scale, 0.17 * scale), rng)
        parts += [pot, kit.leaves("herb", green, 0.055, herb, rng, width=0.4)]
        parts += [
            kit.lathe("soil", [(0.108 * scale, 0.205 * scale), (0.0, 0.21 * scale)], place, soil)
        ]
    flowers = kit.in_ellipsoid(110, (-0.60, 2.32, 0.25), (0.15, 0.13, 0.11), rng)
    return [*parts, kit.leaves("bloom", flowers, 0.05, bloom, rng, width=0.9)]


def _lantern() -> list[bpy.types.Object]:
    iron = kit.material("iron", (0.05, 0.045, 0.04), roughness=0.4, metallic=0.7)
    wax = kit.material("wax", (0.75, 0.66, 0.50), roughness=0.5)
    flame = kit.emitter("flame", (1.0, 0.55, 0.16), 3.2)
    x, y, yaw = 0.58, 2.28, 0.5
    half = 0.075
    turned = [
        (x + c * math.cos(yaw) - s * math.sin(yaw), y + c * math.sin(yaw) + s * math.cos(yaw))
        for c in (-half, half)
        for s in (-half, half)
    ]
    parts = [kit.box("post", (px, py, 0.14), (0.014, 0.014, 0.25), iron, yaw) for px, py in turned]
    for z, size in ((0.012, 0.19), (0.265, 0.19), (0.290, 0.14), (0.315, 0.08)):
        parts.append(kit.box("plate", (x, y, z), (size, size, 0.025), iron, yaw))
    ring = [(0.03 + 0.006 * math.cos(a), 0.006 * math.sin(a)) for a in np.linspace(0, 6.283, 17)]
    handle = kit.lathe("handle", ring, (x, y, 0.355), iron)
    handle.rotation_euler = (math.pi / 2.0, 0.0, yaw)
    candle = kit.lathe("candle", [(0.034, 0.02), (0.034, 0.105), (0.0, 0.10)], (x, y, 0.0), wax)
    tongue = [(0.0, 0.0), (0.008, 0.010), (0.010, 0.022), (0.005, 0.042), (0.0, 0.058)]
    light = kit.lathe("flame", tongue, (x, y, 0.108), flame)
    light.lightgroup = "candle"
    light.visible_shadow = False
    glow = kit.lamp("candle", "POINT", (x, y, 0.14), 0.75, (1.0, 0.55, 0.20), radius=0.012)
    glow.lightgroup = "candle"
    return [*parts, handle, candle, light]


def _fruit(rng: np.random.Generator) -> list[bpy.types.Object]:
    peel = kit.material(
        "lemon", (0.82, 0.50, 0.04), roughness=0.38, bump=0.0005, mottle=0.12, scale=160
    )
    orange = kit.material(
        "orange", (0.80, 0.25, 0.02), roughness=0.38, bump=0.0005, mottle=0.12, scale=160
    )
    leaf = kit.leaf_material("lemon leaf", (0.03, 0.10, 0.02), (0.10, 0.22, 0.05), 0.2)
    angle = np.linspace(-math.pi / 2, math.pi / 2, 25)
    body = [(0.031 * math.cos(a), 0.038 * math.sin(a) + 0.006 * math.sin(a) ** 9) for a in angle]
    parts = []
    for x, y, yaw, scale, surface in (
        (0.275, 0.98, 0.4, 1.1, peel),
        (0.37, 1.13, 2.1, 1.0, peel),
        (0.345, 1.03, 1.2, 1.15, orange),
        (-0.40, 2.02, 0.9, 1.0, peel),
        (-0.32, 2.10, 2.5, 1.1, orange),
    ):
        fruit = kit.lathe(
            "fruit", [(r * scale, z * scale) for r, z in body], (x, y, 0.031 * scale), surface
        )
        fruit.rotation_euler = (math.pi / 2, 0.0, yaw)
        parts.append(fruit)
    spray = np.array(
        [(0.27, 1.05, 0.03), (0.25, 1.00, 0.02), (0.30, 1.06, 0.07), (0.32, 1.10, 0.02)]
    )
    return [*parts, kit.leaves("lemon leaf", spray, 0.075, leaf, rng, flat=0.8)]


def _cup() -> list[bpy.types.Object]:
    china = kit.material("china", (0.70, 0.66, 0.58), roughness=0.15, mottle=0.06, scale=90)
    coffee = kit.material("coffee", (0.05, 0.018, 0.007), roughness=0.08, mottle=0.1)
    wood = kit.material("wood", (0.22, 0.11, 0.05), bump=0.003, mottle=0.5, scale=25)
    x, y = -0.36, 1.37
    saucer = [
        (0.0, 0.004),
        (0.035, 0.004),
        (0.074, 0.015),
        (0.073, 0.018),
        (0.036, 0.009),
        (0.0, 0.009),
    ]
    cup = [
        (0.0, 0.010),
        (0.022, 0.010),
        (0.034, 0.030),
        (0.038, 0.062),
        (0.0355, 0.062),
        (0.032, 0.030),
        (0.0, 0.016),
    ]
    ring = [(0.016 + 0.004 * math.cos(a), 0.0045 * math.sin(a)) for a in np.linspace(0, 6.283, 13)]
    ear = kit.lathe("ear", ring, (x + 0.047, y - 0.012, 0.038), china, 32)
    ear.rotation_euler = (math.pi / 2, 0.0, -0.25)
    stick = kit.box("cinnamon", (x + 0.055, y - 0.055, 0.018), (0.07, 0.009, 0.009), wood, 0.6)
    return [
        kit.lathe("saucer", saucer, (x, y, 0.0), china),
        kit.lathe("cup", cup, (x, y, 0.0), china),
        kit.lathe("coffee", [(0.034, 0.052), (0.0, 0.052)], (x, y, 0.0), coffee),
        ear,
        stick,
    ]


def _jug() -> list[bpy.types.Object]:
    blue = kit.material("jug", (0.035, 0.11, 0.27), roughness=0.22, mottle=0.4, scale=14)
    glass = kit.material("bottle", (0.02, 0.07, 0.03), roughness=0.12, mottle=0.1)
    body = [
        (0.0, 0.0),
        (0.055, 0.0),
        (0.085, 0.06),
        (0.090, 0.11),
        (0.060, 0.19),
        (0.042, 0.23),
        (0.052, 0.275),
        (0.046, 0.275),
        (0.036, 0.23),
        (0.0, 0.2),
    ]
    neck = [
        (0.0, 0.0),
        (0.040, 0.0),
        (0.042, 0.17),
        (0.034, 0.21),
        (0.015, 0.25),
        (0.014, 0.33),
        (0.017, 0.335),
        (0.0, 0.34),
    ]
    return [
        kit.lathe("jug", body, (0.16, 2.50, 0.0), blue),
        kit.lathe("bottle", neck, (0.33, 2.58, 0.0), glass),
    ]


def _garden(rng: np.random.Generator) -> None:
    floor = kit.material("paving", (0.20, 0.16, 0.12), bump=0.02, mottle=0.5, scale=6)
    kit.box("floor", (0.0, 10.0, -0.80), (40.0, 16.0, 0.1), floor)
    dark = kit.leaf_material("hedge", (0.012, 0.035, 0.012), (0.07, 0.12, 0.025), 0.3)
    warm = kit.leaf_material("bush", (0.04, 0.06, 0.015), (0.18, 0.17, 0.03), 0.4)
    for centre, radii, count, surface in (
        ((-3.2, 8.0, 0.1), (2.2, 0.8, 1.0), 5000, dark),
        ((0.2, 8.6, 0.0), (2.4, 0.8, 0.8), 5000, dark),
        ((3.6, 8.0, 0.15), (2.2, 0.8, 1.1), 5000, dark),
        ((-1.5, 6.9, -0.4), (0.8, 0.5, 0.55), 1500, warm),
        ((1.9, 6.8, -0.35), (0.9, 0.5, 0.6), 1500, warm),
    ):
        kit.leaves("hedge", kit.in_ellipsoid(count, centre, radii, rng), 0.16, surface, rng)
