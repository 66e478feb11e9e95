"""A walking figure of solid limbs (runs inside Blender)."""

from __future__ import annotations

import math
from collections.abc import Callable

import blender_kit as kit
import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix, Vector
from shapes import ball

from truth import surfaces

Floats = npt.NDArray[np.float64]
Limb = tuple[tuple[float, float], tuple[float, float], float, float]
"""Its ends (ahead, up), how far it lies to the right, and its thickness; by the body's height."""
STEP = 0.42
"""Length of a step by the body's height [1]."""
_CLOTHES = {"arm": 0, "trunk": 0, "leg": 1, "foot": 2, "neck": 3, "head": 3, "hand": 3}


def limbs(stride: float) -> dict[str, Limb]:
    """The limbs at a moment of the stride, in steps walked so far."""
    swing = math.sin(math.pi * stride)
    found: dict[str, Limb] = {
        "trunk": ((0.0, 0.47), (0.0, 0.82), 0.0, 0.19),
        "neck": ((0.0, 0.8), (0.0, 0.88), 0.0, 0.07),
        "head": ((0.0, 0.86), (0.01, 1.0), 0.0, 0.11),
    }
    for name, side in (("right", 1.0), ("left", -1.0)):
        phase = side * swing
        bend = 0.35 * max(0.0, side * math.cos(math.pi * stride))
        knee = (0.24 * math.sin(0.42 * phase + bend), 0.27)
        foot = (0.45 * math.sin(0.42 * phase), 0.04 + 0.08 * bend)
        elbow = (-0.16 * math.sin(0.5 * phase), 0.63)
        hand = (elbow[0] - 0.15 * math.sin(0.5 * phase - 0.3), 0.48)
        found |= {
            f"leg {name} upper": ((0.0, 0.5), knee, 0.05 * side, 0.085),
            f"leg {name} lower": (knee, foot, 0.05 * side, 0.065),
            f"foot {name}": (foot, (foot[0] + 0.1, foot[1] - 0.015), 0.05 * side, 0.05),
            f"arm {name} upper": ((0.0, 0.79), elbow, 0.12 * side, 0.06),
            f"arm {name} lower": (elbow, hand, 0.12 * side, 0.05),
            f"hand {name}": (hand, (hand[0], hand[1] - 0.05), 0.12 * side, 0.05),
        }
    return found


def add_walker(
    rng: np.random.Generator,
    height: float,
    grain: float,
    place: Callable[[float], tuple[float, float]],
    frames: int,
) -> list[bpy.types.Object]:
    """Add a figure that walks, with a key for each frame.

    Args:
        rng: draws its clothes.
        height: of it [m].
        grain: size of a pixel where it walks [m].
        place: x and y of its foot [m] at a frame.
        frames: of the clip.
    """
    wear = [surfaces.any_surface(rng, 2 * grain), surfaces.any_surface(rng, 2 * grain)]
    wear.append(kit.material("shoe", (0.03, 0.03, 0.03)))
    tone = rng.uniform(0.35, 1.1)
    wear.append(kit.material("skin", (0.55 * tone, 0.32 * tone, 0.2 * tone), mottle=0.05))
    body = ball((0.5, 0.5, 0.5), (0.0, 0.0, 1.0, 1.0))
    parts = {
        name: kit.mesh(name, body.positions, body.triangles, wear[_CLOTHES[name.split()[0]]])
        for name in limbs(0.0)
    }
    for part in parts.values():
        part.data.polygons.foreach_set("use_smooth", [True] * len(part.data.polygons))
        part.rotation_mode = "QUATERNION"
    walked, before = 0.0, place(0.0)
    for frame in range(-1, frames + 1):
        now, ahead = place(float(frame)), place(frame + 0.5)
        heading = Vector((ahead[0] - now[0], ahead[1] - now[1], 0.0)).normalized()
        walked += math.dist(before, now)
        before = now
        for name, limb in limbs(walked / (STEP * height)).items():
            _key(parts[name], frame, _matrix(limb, now, heading, height))
    return list(parts.values())


def _matrix(limb: Limb, place: tuple[float, float], heading: Vector, height: float) -> Matrix:
    """Of a ball of unit diameter, stretched from one end of a limb to the other."""
    first, second, aside, thick = limb
    right = heading.cross(Vector((0.0, 0.0, 1.0)))

    def at(end: tuple[float, float]) -> Vector:
        there = Vector((place[0], place[1], 0.0)) + height * (end[0] * heading + aside * right)
        return there + Vector((0.0, 0.0, height * end[1]))

    along = at(second) - at(first)
    reach = along.length + 0.8 * height * thick
    turn = along.to_track_quat("Z", "Y").to_matrix().to_4x4()
    size = Matrix.Diagonal((height * thick, height * thick, reach, 1.0))
    return Matrix.Translation(0.5 * (at(first) + at(second))) @ turn @ size


def _key(part: bpy.types.Object, frame: int, matrix: Matrix) -> None:
    before = part.rotation_quaternion.copy()
    part.location, turn, part.scale = matrix.decompose()
    turn.make_compatible(before)
    part.rotation_quaternion = turn
    for channel in ("location", "rotation_quaternion", "scale"):
        part.keyframe_insert(channel, frame=frame)
