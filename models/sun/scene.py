"""A training scene: a camera above a ground, things on it, light; drawn from a seed.

Lengths are in heights of the camera above the ground; axes as of `shapes`, and the camera stands
at (0, 1, 0) and looks along -z, downwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.sun.shapes import BUILDERS, Floats, Part, Rng, about_y, solid, tree

PITCHES_DEG, FOVS_DEG = (2.0, 52.0), (20.0, 90.0)
ASPECTS = (1.875, 16 / 9, 1.5, 4 / 3, 0.75, 9 / 16)
ASPECT_SHARES = (0.35, 0.3, 0.15, 0.1, 0.05, 0.05)
SUN_SHARE = 0.62
ELEVATIONS_DEG = (6.0, 80.0)
LEFT_EV = (-3.2, -0.25)
"""What a shadow in the open leaves of the light, least and most [EV]."""
FARTHEST = 40.0


@dataclass(frozen=True, slots=True)
class Camera:
    """Where a picture is taken from.

    Attributes:
        pitch: how far it looks down [rad].
        roll: about the optical axis [rad].
        fov: horizontal field of view [rad].
        aspect: width by height.
    """

    pitch: float
    roll: float
    fov: float
    aspect: float

    @property
    def world_from_camera(self) -> Floats:
        """Rotation (3, 3)."""
        c, s = math.cos(self.pitch), math.sin(self.pitch)
        down = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
        c, s = math.cos(self.roll), math.sin(self.roll)
        return np.asarray(down @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))

    def rays(self, places: Floats) -> Floats:
        """World directions (N, 3) of depth 1 through places of the frame (N, 2), 0 to 1."""
        wide = math.tan(0.5 * self.fov)
        across, up = (2.0 * places[:, 0] - 1.0) * wide, (1.0 - 2.0 * places[:, 1]) * wide
        in_camera = np.stack([across, up / self.aspect, -np.ones(len(across))], axis=1)
        return np.asarray(in_camera @ self.world_from_camera.T)


@dataclass(frozen=True, slots=True)
class Light:
    """What lights a scene.

    Attributes:
        toward: direction to the sun (3,), None without one.
        radius: of the sun's disc [rad].
        left: share of the light of level ground that the sun's shadow leaves [1].
        lamps: places of lamps near by (L, 3) [camera heights].
        powers: of each, by the sky's light (L,) [1].
        lamp_radius: of each [camera heights].
        tilt: how much brighter the sky is in a direction (3,) [1].
        tint: colour of the sun or lamps by the sky's (3,).
    """

    toward: Floats | None
    radius: float
    left: float
    lamps: Floats
    powers: Floats
    lamp_radius: float
    tilt: Floats
    tint: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """Parts that share materials."""

    parts: list[Part]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """All of it."""

    camera: Camera
    light: Light
    things: list[Thing]


def draw_scene(rng: Rng) -> Scene:
    """A scene."""
    camera = _camera(rng)
    things = [*_in_view(rng, camera), *_beside(rng, camera), *_behind(rng)]
    return Scene(camera, _light(rng), things)


def _camera(rng: Rng) -> Camera:
    steepest = PITCHES_DEG[1] if rng.random() < 0.4 else 30.0
    return Camera(
        pitch=math.radians(rng.uniform(PITCHES_DEG[0], steepest)),
        roll=math.radians(rng.normal(0.0, 1.0)),
        fov=math.radians(math.exp(rng.uniform(*np.log(FOVS_DEG)))),
        aspect=float(rng.choice(ASPECTS, p=ASPECT_SHARES)),
    )


def _light(rng: Rng) -> Light:
    toward, radius, left = None, 0.0, 1.0
    lamps, powers = np.zeros((0, 3)), np.zeros(0)
    warm = rng.normal(0.0, 0.12)
    tint = np.array([1.15 + warm, 1.0, 0.8 - warm])
    if rng.random() < SUN_SHARE:
        around = rng.uniform(0.0, 2.0 * math.pi)
        up = math.radians(rng.uniform(*ELEVATIONS_DEG))
        toward = np.array([
            math.cos(up) * math.sin(around), math.sin(up), -math.cos(up) * math.cos(around),
        ])  # fmt: skip
        radius = math.radians(math.exp(rng.uniform(math.log(0.25), math.log(4.0))))
        left = 2.0 ** rng.uniform(*LEFT_EV)
    elif rng.random() < 0.5:
        count = int(rng.integers(1, 5))
        lamps = rng.uniform((-6.0, 1.2, -10.0), (6.0, 5.0, 2.0), (count, 3))
        powers = np.exp(rng.uniform(math.log(0.3), math.log(4.0), count))
    tilt = rng.normal(0.0, 0.35, 3) * (1.0, 0.5, 1.0)
    return Light(toward, radius, left, lamps, powers, rng.uniform(0.02, 0.6), tilt, tint)


def _in_view(rng: Rng, camera: Camera) -> list[Thing]:
    """Things whose foot is in the frame, or nearly."""
    half = math.atan(math.tan(0.5 * camera.fov) / camera.aspect)
    nearest = 1.0 / math.tan(min(camera.pitch + half, 1.45))
    highest = camera.pitch - half
    farthest = min(1.2 / math.tan(highest), FARTHEST) if highest > 0.02 else FARTHEST
    wide = math.tan(0.5 * camera.fov)
    things = []
    for _ in range(int(math.exp(rng.uniform(math.log(1.5), math.log(32.0))))):
        away = math.exp(rng.uniform(math.log(nearest + 0.1), math.log(farthest + 0.2)))
        depth = away * math.cos(camera.pitch) + math.sin(camera.pitch)
        size = 2.0 * wide * depth * math.exp(rng.uniform(math.log(0.05), math.log(0.5)))
        if size > 0.7 * math.hypot(away, 1.0):
            continue
        at = np.array([rng.uniform(-1.1, 1.1) * wide * depth, 0.0, -away])
        things.append(_placed(rng, size, at))
    return things


def _beside(rng: Rng, camera: Camera) -> list[Thing]:
    """Things out of the frame, whose shadows may reach into it."""
    things = []
    for _ in range(int(rng.integers(0, 5))):
        around = rng.uniform(0.6 * camera.fov, 2.0 * math.pi - 0.6 * camera.fov)
        away = math.exp(rng.uniform(math.log(1.5), math.log(12.0)))
        size = away * rng.uniform(0.2, 0.8)
        at = away * np.array([math.sin(around), 0.0, -math.cos(around)])
        if rng.random() < 0.25:
            house = [solid("box", (2.0, 1.2, 1.0), (0.0, 0.6, 0.0))]
            things.append(_moved(rng, house, size, at))
        else:
            things.append(_placed(rng, size, at))
    return things


def _behind(rng: Rng) -> list[Thing]:
    """A wall or houses or trees along the horizon."""
    kind = rng.random()
    if kind < 0.25:
        away = math.exp(rng.uniform(math.log(5.0), math.log(30.0)))
        size = 6.0 * away, rng.uniform(0.1, 1.5) * away, 0.2
        turn = about_y(rng.normal(0.0, 0.3))
        return [Thing([solid("box", size, (0.0, 0.5 * size[1], -away), turn)])]
    things = []
    if kind < 0.75:
        for _ in range(int(rng.integers(3, 14))):
            away = rng.uniform(15.0, FARTHEST)
            at = np.array([rng.uniform(-1.2, 1.2) * away, 0.0, -away])
            size = away * rng.uniform(0.05, 0.3)
            if rng.random() < 0.5:
                things.append(_moved(rng, tree(rng), size, at))
            else:
                box = [solid("box", tuple(rng.uniform(0.4, 1.5, 3)), (0.0, 0.3, 0.0))]
                things.append(_moved(rng, box, size, at))
    return things


def _placed(rng: Rng, size: float, at: Floats) -> Thing:
    return _moved(rng, BUILDERS[int(rng.integers(len(BUILDERS)))](rng), size, at)


def _moved(rng: Rng, parts: list[Part], size: float, at: Floats) -> Thing:
    turn = about_y(rng.uniform(0.0, 2.0 * math.pi))
    return Thing([part.moved(turn, size, at) for part in parts])
