"""A picture of things on even ground under a sun, with the shadows that they cast."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import PosedLight, sun
from nlens_video.scene.plate_environment import Seat
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT = 480, 270
SEAT = Seat(middle=np.array([0.0, 0.3, -3.5]), radius=0.4, ground_y=0.0)
UP = np.array([0.0, 1.0, 0.0])
TOWARD = np.array([0.8, 0.5, -0.3])  # to the sun, from the right and a little from behind
GROUND, THING = (0.30, 0.28, 0.25), (0.4, 0.06, 0.05)
LEFT = np.array([0.36, 0.40, 0.48])
PLACES = ((-1.2, -3.2), (-0.3, -2.6), (0.9, -2.9), (0.2, -4.2), (-1.5, -4.8), (1.4, -4.4))


def camera(pitch_deg=-30.0):
    """Two metres above the ground, turned down."""
    turn, pose = math.radians(pitch_deg), np.eye(4)
    pose[1:3, 1:3] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    pose[1, 3] = 2.0
    return Camera(
        world_from_camera=pose, fx=420.0, fy=420.0, cx=0.5 * WIDTH, cy=0.5 * HEIGHT,
        width=WIDTH, height=HEIGHT,
    )  # fmt: skip


def picture(light):
    """Linear light (h, w, 3) as a picture in sRGB, with a little grain."""
    light = light * np.random.default_rng(4).normal(1.0, 0.03, (HEIGHT, WIDTH, 1))
    light = np.clip(light, 0.0, 1.0)
    codes = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return ArrayPicture(np.round(255.0 * codes).astype(np.uint8), "rgb")


def ground(seen):
    """Points of the ground (h, w, 2), along X and Z."""
    return seen.plane_points(0.0)[..., [0, 2]]


def courtyard(seen, toward, *, things=True, tiles=0.0, left=LEFT, level=1.0):
    """Flat things on even ground, with the shadows that they cast away from a sun.

    Args:
        seen: camera.
        toward: to the sun.
        things: whether they are seen themselves; without them the shadows are stains.
        tiles: size of light and dark tiles, 0 for even ground [m].
        left: share of the light in the shadows.
        level: brightness of all.
    """
    places = ground(seen)
    away = -np.asarray(toward)[[0, 2]]
    length = float(np.hypot(*away))
    away, long = away / length, 0.7 / (toward[1] / length)
    light = np.broadcast_to(np.array(GROUND), (HEIGHT, WIDTH, 3)).copy()
    if tiles:
        odd = np.floor(places / tiles).astype(int).sum(axis=2) % 2 == 1
        light[odd] *= 0.45
    for place in PLACES:
        rel = places - place
        along, across = rel @ away, rel @ np.array([-away[1], away[0]])
        light[(along > 0.0) & (along < long) & (np.abs(across) < 0.2)] *= left
        if things:
            light[np.hypot(rel[..., 0], rel[..., 1]) < 0.25] = THING
    return picture(level * light)


def file_sun() -> PosedLight:
    return sun(np.array([2.0, 1.9, 1.7]), -TOWARD / np.linalg.norm(TOWARD))
