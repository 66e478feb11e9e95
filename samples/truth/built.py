"""Streets, rooms and tables that people have built: walls, lines and boxes (runs inside Blender).

Most of it follows two directions at right angles; some things lie about as they fell.
"""

from __future__ import annotations

import math

import blender_kit as kit
import bpy
import numpy as np

from truth import surfaces
from truth.plan import View

Rng = np.random.Generator
Place = tuple[float, float, float]
STRAIGHT = 0.35
"""Share of scenes that the camera faces squarely."""


class Site:
    """Axes of what is built: their origin lies under the object, turned about the upright."""

    def __init__(self, view: View, rng: Rng) -> None:
        self.view, self.rng = view, rng
        straight = rng.random() < STRAIGHT
        self.yaw = rng.normal(0.0, 0.03) if straight else rng.uniform(-0.78, 0.78)
        self.unit = math.hypot(view.place[1], view.height_m)
        self.grain = self.unit / view.focal_px

    def surface(self, kind: str, coarse: float = 1.0) -> bpy.types.Material:
        """A material along the axes of its thing."""
        grain = self.grain * coarse * self.rng.uniform(0.7, 1.4)
        return surfaces.surface(self.rng, kind, grain, flat=False, turn=0.0)

    def box(
        self, centre: Place, size: Place, surface: bpy.types.Material, turn: float = 0.0
    ) -> bpy.types.Object:
        """A box along the axes, or turned against them."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        x = self.view.place[0] + c * centre[0] - s * centre[1]
        y = self.view.place[1] + s * centre[0] + c * centre[1]
        bevel = 0.02 * min(size)
        return kit.box("built", (x, y, centre[2]), size, surface, self.yaw + turn, bevel)

    def depth(self, x: float, y: float) -> float:
        """From the camera to a place on the ground, along its axis over the ground."""
        return self.view.place[1] + math.sin(self.yaw) * x + math.cos(self.yaw) * y

    def plain(self) -> bpy.types.Material:
        """Paint of any colour."""
        return self.surface("plain")

    def odd(self) -> float:
        """Along the axes, or as it fell [rad]."""
        return 0.0 if self.rng.random() < 0.5 else self.rng.uniform(-0.78, 0.78)


def raise_scene(view: View, rng: Rng) -> None:
    """Everything but the light and the object."""
    site = Site(view, rng)
    {"table": _table, "room": _room, "yard": _street}[view.setting](site)


def _table(site: Site) -> None:
    rng, u = site.rng, site.unit
    far = u * rng.uniform(0.6, 1.8)
    top = site.surface(str(rng.choice(["wood", "wood", "plain", "weave", "stone"])))
    site.box((0.0, far - 5 * u, -0.02 * u), (8 * u, 10 * u, 0.04 * u), top)
    wall = site.surface(str(rng.choice(["bricks", "bricks", "plain", "print", "wood"])), 1.5)
    site.box((0.0, far + 0.3 * u, 1.0 * u), (30 * u, 0.1 * u, 8 * u), wall)
    for _ in range(int(rng.integers(1, 4))):  # rows of books
        x, y = rng.uniform(-1.2, 1.0) * u, far - rng.uniform(0.1, 0.4) * u
        for _ in range(int(rng.integers(3, 12))):
            thick, deep, tall = u * rng.uniform((0.02, 0.1, 0.12), (0.06, 0.2, 0.3))
            cover = site.plain() if rng.random() < 0.7 else site.surface("print")
            site.box((x, y, 0.5 * tall), (thick, deep, tall), cover)
            x += thick * 1.03
    for _ in range(int(rng.integers(2, 7))):
        _stack(site, rng.uniform(-0.9, 0.9) * u, rng.uniform(-0.1, 1.0) * far, 0.13 * u)
    for _ in range(int(rng.integers(0, 3))):  # sheets of paper
        sheet = (0.21 * u, 0.3 * u, 0.001 * u)
        place = (rng.uniform(-0.6, 0.6) * u, rng.uniform(-0.5, 0.3) * u, 0.001 * u)
        site.box(place, sheet, site.surface("print"), rng.uniform(-1.5, 1.5))
    _rounds(site, 0.1 * u, far)


def _room(site: Site) -> None:
    rng, u = site.rng, site.unit
    floor = site.surface(str(rng.choice(["bricks", "bricks", "wood", "terrazzo", "plain"])), 1.5)
    site.box((0.0, 0.0, -0.05 * u), (24 * u, 24 * u, 0.1 * u), floor)
    back, side = u * rng.uniform(0.7, 2.2), u * rng.uniform(0.8, 2.5) * rng.choice([-1.0, 1.0])
    paper = site.surface(str(rng.choice(["plain", "plain", "print", "bricks", "weave"])), 2.0)
    trim = site.plain()
    tall = 1.3 * u
    site.box((0.0, back + 0.05 * u, tall), (24 * u, 0.1 * u, 2 * tall), paper)
    site.box((0.0, back - 0.01 * u, 0.05 * u), (24 * u, 0.02 * u, 0.1 * u), trim)
    if rng.random() < 0.6:
        site.box((side, 0.0, tall), (0.1 * u, 24 * u, 2 * tall), paper)
        site.box(
            (side * (1 - 0.06 * u / abs(side)), 0.0, 0.05 * u), (0.02 * u, 24 * u, 0.1 * u), trim
        )
    for _ in range(int(rng.integers(0, 3))):  # doors, windows, pictures
        size = (u * rng.uniform(0.3, 0.6), 0.03 * u, u * rng.uniform(0.3, 1.2))
        low = 0.0 if rng.random() < 0.5 else 0.3 * u
        x = rng.uniform(-1.5, 1.5) * u
        site.box((x, back, low + 0.5 * size[2]), size, trim)
        inner = (0.8 * size[0], 0.035 * u, 0.85 * size[2])
        site.box((x, back, low + 0.5 * size[2]), inner, site.plain())
    if rng.random() < 0.6:  # a rug
        wide, deep = u * rng.uniform(0.5, 1.3), u * rng.uniform(0.4, 1.0)
        turn, y = 0.5 * site.odd(), rng.uniform(-0.4, 0.3) * u
        site.box((0.0, y, 0.004 * u), (wide, deep, 0.008 * u), site.surface("weave", 1.5), turn)
        inner = (0.8 * wide, 0.75 * deep, 0.0085 * u)
        site.box((0.0, y, 0.0045 * u), inner, site.surface("weave"), turn)
    for _ in range(int(rng.integers(0, 3))):  # shelves along the wall
        _shelf(site, rng.uniform(-1.2, 1.2) * u, back - 0.12 * u)
    for _ in range(int(rng.integers(1, 6))):
        _stack(site, rng.uniform(-1.0, 1.0) * u, rng.uniform(0.0, 0.9) * back, 0.2 * u)
    _rounds(site, 0.15 * u, back)


def _street(site: Site) -> None:
    rng, u = site.rng, site.unit
    site.box((0.0, 0.0, -0.05 * u), (200 * u, 200 * u, 0.1 * u), site.surface("stone"))
    white, kerb = site.plain(), site.surface("stone")
    lane, thin = u * rng.uniform(0.5, 1.2), 0.002 * u
    start = rng.uniform(-1.0, 0.0) * lane
    for k in range(int(rng.integers(1, 4))):  # lanes run away from the camera
        x = start + k * lane
        if rng.random() < 0.5:
            site.box((x, 30 * u, thin), (0.05 * u, 80 * u, thin), white)
        else:
            for y in np.arange(-3.0, 14.0, 0.8):
                site.box((x, y * u, thin), (0.05 * u, 0.35 * u, thin), white)
    if rng.random() < 0.4:  # a crossing
        y = rng.uniform(-0.3, 1.2) * u
        for x in np.arange(-2.0, 2.0, 0.25):
            site.box((x * u, y, thin), (0.12 * u, 0.4 * u, thin), white)
    side = start - u * rng.uniform(0.4, 1.0)
    walk = site.surface(str(rng.choice(["bricks", "stone"])))
    site.box((side - 5 * u, 30 * u, 0.03 * u), (10 * u, 90 * u, 0.06 * u), walk)
    site.box((side, 30 * u, 0.032 * u), (0.06 * u, 90 * u, 0.064 * u), kerb)
    _houses(site, side)
    for _ in range(int(rng.integers(0, 6))):
        x, y = rng.uniform(-1.5, 1.5) * u, rng.uniform(0.3, 4.0) * u
        site.box((x, y, 0.5 * u), (0.04 * u, 0.04 * u, u), site.plain())
    for _ in range(int(rng.integers(0, 3))):
        _stack(site, rng.uniform(-0.8, 0.8) * u, rng.uniform(0.2, 1.5) * u, 0.2 * u)
    _rounds(site, 0.12 * u, 2.0 * u)


def _houses(site: Site, side: float) -> None:
    """Houses across the street or beside it, and cars along its side."""
    rng, u = site.rng, site.unit
    across = rng.random() < 0.5
    away = u * rng.uniform(2.0, 6.0)
    for k in range(int(rng.integers(1, 5))):  # houses
        wide, tall = u * rng.uniform(1.5, 4.0), u * rng.uniform(2.0, 6.0)
        centre = ((k - 1.5) * 4.2 * u, away) if across else (side - 3 * u, k * 4.5 * u + u)
        wear = site.surface(str(rng.choice(["bricks", "bricks", "plain", "stone"])), 3.0)
        site.box((*centre, 0.5 * tall), (wide, wide, tall), wear)
        glass = site.plain()
        for z in np.arange(0.5 * u, tall - 0.3 * u, 0.6 * u):
            for w in np.arange(-0.4, 0.41, 0.2) * wide:
                face = (centre[0] + w, centre[1] - 0.5 * wide, z)
                site.box(face, (0.2 * u, 0.04 * u, 0.35 * u), glass)
                face = (centre[0] + 0.5 * wide, centre[1] + w, z)
                site.box(face, (0.04 * u, 0.2 * u, 0.35 * u), glass)
    for _ in range(int(rng.integers(0, 4))):  # cars
        x, y = side + u * rng.choice([0.3, 2.5]), u * rng.uniform(0.5, 4.0)
        paint, dark = site.plain(), site.plain()
        site.box((x, y, 0.22 * u), (0.45 * u, 1.1 * u, 0.2 * u), paint)
        site.box((x, y, 0.4 * u), (0.38 * u, 0.6 * u, 0.2 * u), dark)


def _stack(site: Site, x: float, y: float, size: float) -> None:
    """A box, or a pile of them."""
    top, rng = 0.0, site.rng
    turn = site.odd()
    if site.depth(x, y) < 0.85 * site.view.place[1]:
        return
    for _ in range(int(rng.choice([1, 1, 2, 4]))):
        wide, deep, tall = size * rng.uniform((0.5, 0.5, 0.15), (1.6, 1.3, 1.3))
        wear = site.surface(str(rng.choice(["plain", "wood", "print", "stone"])))
        site.box((x, y, top + 0.5 * tall), (wide, deep, tall), wear, turn)
        top += tall
        turn += 0.0 if rng.random() < 0.5 else rng.normal(0.0, 0.2)


def _shelf(site: Site, x: float, y: float) -> None:
    rng, u = site.rng, site.unit
    wide, tall, wood = u * rng.uniform(0.5, 1.0), u * rng.uniform(0.4, 1.2), site.surface("wood")
    for end in (-0.5, 0.5):
        site.box((x + end * wide, y, 0.5 * tall), (0.03 * u, 0.2 * u, tall), wood)
    for z in np.arange(0.03 * u, tall, 0.33 * u):
        site.box((x, y, z), (wide, 0.2 * u, 0.03 * u), wood)
        left = x - 0.48 * wide
        while left < x + 0.45 * wide:
            thick, high = u * rng.uniform((0.02, 0.12), (0.05, 0.27))
            site.box((left, y, z + 0.5 * high), (thick, 0.15 * u, high), site.plain())
            left += thick * (1.02 if rng.random() < 0.9 else 3.0)


def _rounds(site: Site, size: float, far: float) -> None:
    """Balls, cups and bottles."""
    rng, view = site.rng, site.view
    for _ in range(int(rng.integers(1, 6))):
        x = view.place[0] + rng.uniform(-0.7, 0.7) * site.unit
        y = view.place[1] + rng.uniform(-0.2, 0.7) * far
        wear = site.surface(str(rng.choice(["plain", "weave", "print", "wood"])))
        if rng.random() < 0.5:
            angle = np.linspace(-math.pi / 2, math.pi / 2, 24)
            profile = [(0.5 * size * math.cos(a), 0.5 * size * (1 + math.sin(a))) for a in angle]
        else:
            wide, tall = size * rng.uniform((0.25, 0.6), (0.5, 2.0))
            profile = [(0.0, 0.0), (wide, 0.0), (wide, 0.6 * tall), (0.5 * wide, 0.8 * tall)]
            profile += [(0.5 * wide, tall), (0.0, tall)]
        kit.lathe("round", profile, (x, y, 0.0), wear, 48)
