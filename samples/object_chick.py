"""The object of the second sample: a wind-up tin chick that hops away through the depth of field.

Animated nodes (hops, turns, a key that unwinds) and two morph targets (squash, stretch).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pygltflib as gl
from glb import Floats, Glb, smooth_normals
from scipy.interpolate import CubicSpline
from shapes import Part, ball, merge, spot, tube, turned
from shot_list import FRAMES, PARK, RATE
from textures import put, spectral_noise

HOP_HZ, HOP_M = 1.75, 0.085
WAYPOINTS = [
    (-0.26, 2.75),
    (-0.02, 3.05),
    (0.20, 3.45),
    (0.12, 4.05),
    (-0.22, 4.75),
    (-0.38, 5.6),
    (-0.10, 6.3),
]
KEY_AT = (0.0, 0.150, -0.098)

BODY, FACE, EYE = (0.0, 0.0, 1.0, 0.5), (0.0, 0.5, 0.5, 1.0), (0.5, 0.5, 0.75, 0.75)
BEAK, WING, METAL = (0.75, 0.5, 1.0, 0.75), (0.5, 0.75, 0.75, 1.0), (0.75, 0.75, 1.0, 1.0)


def paint() -> np.ndarray[Any, np.dtype[np.uint8]]:
    """The atlas (512, 512, 3), sRGB: printed tin for the body above, face and patches below."""
    size = 512
    picture = np.zeros((size, size, 3))
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(256) + 0.5) / 256)
    _body(picture[:256], u, v)
    x, y = np.meshgrid(np.linspace(-1, 1, 256), np.linspace(-1, 1, 256))
    _face(picture[256:, :256], x, y)
    small_x, small_y = x[::2, ::2], y[::2, ::2]
    _eye(picture[256:384, 256:384], small_x, small_y)
    picture[256:384, 384:] = (0.95, 0.45, 0.06)
    _wing(picture[384:, 256:384], small_x, small_y)
    picture[384:, 384:] = (0.78, 0.80, 0.84)
    scratches = np.clip(spectral_noise(size, 0.7, 8) - 2.0, 0.0, 1.0)[..., None]
    tone = 1.0 + 0.03 * spectral_noise(size, 0.4, 6) + 0.03 * spectral_noise(size, 1.3, 7)
    picture = picture * tone[..., None] * (1.0 - 0.5 * scratches)
    return np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)


def _body(picture: Floats, u: Floats, v: Floats) -> None:
    """`u` from the ground to the crown, `v` around."""
    picture[:] = (0.98, 0.78, 0.12)
    put(picture, u - 0.16 - 0.022 * np.sin(2 * math.pi * 18 * v), (0.80, 0.16, 0.14), 0.012)
    put(
        picture,
        abs(u - 0.20 - 0.022 * np.sin(2 * math.pi * 18 * v)) - 0.010,
        (0.98, 0.95, 0.86),
        0.010,
    )
    put(picture, abs(u - 0.52) - 0.030, (0.10, 0.34, 0.58), 0.008)
    dash = abs((v * 24.0) % 1.0 - 0.5)
    put(picture, np.maximum(abs(u - 0.52) - 0.012, dash - 0.28), (0.98, 0.95, 0.86), 0.012)
    for row, shift in ((0.30, 0.0), (0.41, 0.5)):
        across = ((v * 12.0 + shift) % 1.0 - 0.5) / 12.0 * 3.0
        along = (u - row) * 1.55
        turn, far = np.arctan2(across, along), np.hypot(across, along)
        put(picture, far - 0.045 * (0.72 + 0.28 * np.cos(5.0 * turn)), (0.86, 0.22, 0.18), 0.010)
        put(picture, far - 0.015, (0.99, 0.95, 0.80), 0.010)


def _face(picture: Floats, x: Floats, y: Floats) -> None:
    picture[:] = (0.99, 0.82, 0.20)
    for side in (-1.0, 1.0):
        put(picture, np.hypot(x - 0.32 * side, y - 0.12) - 0.085, (0.97, 0.45, 0.28), 0.05)
    for radius in (0.52, 0.60, 0.68):
        wavy = np.hypot(x, y) + 0.018 * np.cos(16.0 * np.arctan2(y, x))
        put(picture, abs(wavy - radius) - 0.012, (0.93, 0.58, 0.10), 0.02)


def _eye(picture: Floats, x: Floats, y: Floats) -> None:
    picture[:] = (0.97, 0.97, 0.95)
    put(picture, np.hypot(x, y) - 0.40, (0.12, 0.07, 0.05), 0.03)
    put(picture, np.hypot(x + 0.13, y + 0.14) - 0.11, (1.0, 1.0, 1.0), 0.03)


def _wing(picture: Floats, x: Floats, y: Floats) -> None:
    picture[:] = (0.10, 0.34, 0.58)
    scale = np.hypot((x * 4.0 + 0.5 * (np.floor(y * 4.0) % 2.0)) % 1.0 - 0.5, (y * 4.0) % 1.0 - 0.1)
    put(picture, abs(scale - 0.55) - 0.08, (0.96, 0.93, 0.82), 0.06)


def _body_parts() -> list[Part]:
    """Everything but the key; the chick looks along +z, its feet at y = 0."""
    t = np.linspace(0.0, 1.0, 44)
    height = 0.118 - 0.098 * np.cos(math.pi * t)
    radius = 0.104 * np.sin(math.pi * t) ** 0.85 + 1e-4
    centres = np.stack([0.0 * t, height, 0.0 * t], axis=1)
    parts = [tube(centres, radius, BODY, 40)]
    parts.append(ball((0.074, 0.070, 0.070), FACE, 20, 28).moved(np.eye(3), (0.0, 0.232, 0.026)))
    parts.append(
        ball((0.020, 0.013, 0.030), spot(BEAK), 10, 16).moved(np.eye(3), (0.0, 0.224, 0.096))
    )
    for side in (-1.0, 1.0):
        aim = turned(1, 24.0 * side) @ turned(0, -14.0)
        parts.append(
            ball((0.019, 0.021, 0.013), EYE, 12, 16).moved(aim, (0.031 * side, 0.249, 0.084))
        )
        wing = turned(1, 80.0 * side) @ turned(0, 14.0)
        parts.append(
            ball((0.055, 0.038, 0.020), WING, 12, 18).moved(wing, (0.100 * side, 0.128, -0.004))
        )
        parts.append(
            ball((0.034, 0.010, 0.046), spot(BEAK), 10, 16).moved(
                turned(1, 12.0 * side), (0.046 * side, 0.010, 0.026)
            )
        )
    for lean, size in ((-18.0, 0.020), (4.0, 0.026), (26.0, 0.020)):
        tuft = ball((0.006, size, 0.008), spot(BEAK), 8, 10)
        parts.append(
            tuft.moved(turned(0, -lean), (0.0, 0.302 - 0.0004 * abs(lean), 0.022 - 0.0006 * lean))
        )
    return parts


def _key_parts() -> list[Part]:
    """The wind-up key around its own axis, which is -z."""
    shaft = ball((0.006, 0.006, 0.040), spot(METAL), 8, 12).moved(np.eye(3), (0.0, 0.0, -0.020))
    turn = np.linspace(0.0, 2.0 * math.pi, 25)
    ring = np.stack([0.0 * turn, 0.024 * np.cos(turn), 0.020 * np.sin(turn)], axis=1)
    loop = tube(ring, np.full(25, 0.0055), spot(METAL), 10)
    flat = turned(1, 90.0)
    return [shaft, *(loop.moved(flat, (0.0, 0.027 * side, -0.058)) for side in (-1.0, 1.0))]


def _hops(times: Floats) -> tuple[Floats, Floats, Floats]:
    """Places (T, 3), headings (T,) [rad], weights of squash and stretch (T, 2)."""
    phase = times * HOP_HZ
    part = phase % 1.0
    ground = 0.34
    air = np.clip((part - ground) / (1.0 - ground), 0.0, 1.0)
    height = HOP_M * 4.0 * air * (1.0 - air)
    crouch = np.where(part < ground, np.sin(math.pi * part / ground) ** 2, 0.0)
    reach = np.where(part >= ground, np.sin(2.0 * math.pi * air) ** 2 * (1.0 - air), 0.0)
    points = np.array(WAYPOINTS)
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    way = CubicSpline(knots, points)
    progress = (np.floor(phase) + air) / (times[-1] * HOP_HZ) * 0.97 * knots[-1]
    place = way(progress)
    smooth = np.convolve(np.pad(progress, 6, mode="edge"), np.full(13, 1.0 / 13.0), mode="valid")
    along = way(smooth, 1)
    heading = np.unwrap(np.arctan2(along[:, 0], -along[:, 1]))
    to_camera = np.arctan2(-place[:, 0], place[:, 1])
    look = 0.45 + 0.55 * np.clip((times - 4.6) / 1.0, 0.0, 1.0)
    delta = (to_camera - heading + math.pi) % (2.0 * math.pi) - math.pi
    return (
        np.stack([place[:, 0], height, -place[:, 1]], axis=1),
        heading + look * delta,
        np.stack([crouch, reach], axis=1),
    )


def build(lights: list[dict[str, Any]]) -> Glb:
    """The whole file: camera, lights, chick, six seconds of hops."""
    made = Glb()
    made.camera(PARK)
    made.lights(lights)
    texture = made.texture(paint())
    tin, steel = made.material("tin", texture, 0.38), made.material("steel", texture, 0.30)
    body, key = merge(_body_parts()), merge(_key_parts())
    primitive = made.primitive(
        body.positions, smooth_normals(body.positions, body.triangles), body.uv, body.triangles, tin
    )
    primitive.targets = []
    for wide, tall in ((1.16, 0.74), (0.93, 1.14)):
        shaped = body.positions * np.array([wide, tall, wide])
        change = smooth_normals(shaped, body.triangles) - smooth_normals(
            body.positions, body.triangles
        )
        primitive.targets.append(
            {
                "POSITION": made.accessor(
                    shaped - body.positions, target=gl.ARRAY_BUFFER, bounds=True
                ),
                "NORMAL": made.accessor(change, target=gl.ARRAY_BUFFER),
            }
        )
    made.gltf.meshes.append(
        gl.Mesh(
            name="chick",
            primitives=[primitive],
            weights=[0.0, 0.0],
            extras={"targetNames": ["squash", "stretch"]},
        )
    )
    steel_part = made.primitive(
        key.positions, smooth_normals(key.positions, key.triangles), key.uv, key.triangles, steel
    )
    made.gltf.meshes.append(gl.Mesh(name="key", primitives=[steel_part]))

    times = np.arange(FRAMES + 1) / RATE
    place, heading, weights = _hops(times)
    place[:, 1] -= body.positions[:, 1].min()
    none = np.zeros_like(heading)
    root = made.node("hop", translation=place[0].tolist())
    chick = made.node("chick", root, mesh=0)
    winder = made.node("key", root, mesh=1, translation=list(KEY_AT))
    made.animate(root, "translation", times, place)
    half = 0.5 * np.unwrap(heading)
    made.animate(
        root, "rotation", times, np.stack([none, np.sin(half), none, np.cos(half)], axis=1)
    )
    made.animate(chick, "weights", times, weights)
    wide = 1.0 + weights @ np.array([0.16, -0.07])
    tall = 1.0 + weights @ np.array([-0.26, 0.14])
    made.animate(
        winder, "translation", times, np.array(KEY_AT) * np.stack([wide, tall, wide], axis=1)
    )
    spin = 0.5 * 2.0 * math.pi * (1.1 * times - 0.05 * times**2)
    made.animate(
        winder, "rotation", times, np.stack([none, none, np.sin(spin), np.cos(spin)], axis=1)
    )
    return made
