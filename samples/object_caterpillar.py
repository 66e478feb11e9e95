"""The object of the first sample: a caterpillar that crawls through the depth of field.

A skin over a chain of joints, smoothly weighted, keys at the frames of the clip.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pygltflib as gl
from caterpillar_paint import BODY, EYE, FACE, HORN, SHOE, SPINE, TIP, paint
from glb import Floats, Glb, quaternions, smooth_normals
from scipy.interpolate import CubicSpline
from shapes import Part, ball, merge, spot, tube, turned
from shot_list import FRAMES, RATE, TERRACE

SPACING = 0.036
HEAD, TAIL = 0, SPINE - 1
LEFT, RIGHT = SPINE, SPINE + 1
BELLY, FOOT = 0.046, 0.014
CENTRE = BELLY + FOOT - 0.004
STRIDE_HZ, LIFT = 2.0, 0.013
WAYPOINTS = [
    (0.46, 2.06),
    (0.20, 1.94),
    (-0.07, 1.80),
    (-0.20, 1.62),
    (-0.18, 1.45),
    (-0.10, 1.32),
    (-0.045, 1.18),
    (-0.06, 1.05),
    (-0.12, 0.97),
    (-0.19, 0.92),
    (-0.27, 0.89),
]
"""So far to the left that its shadow falls on the table alone, not on the fruit."""
START, END = 0.44, 1.64
"""Where the head is on its way in the first and the last frame [m]."""


def _parts() -> list[tuple[Part, int | None]]:
    """Every part in the bind pose, head towards +z, and its joint; None: the body, smoothly."""
    along = np.linspace(-0.25, TAIL + 0.62, 84)
    bulge = 0.90 + 0.10 * np.sqrt(abs(np.sin(math.pi * (along - 0.5))))
    taper = np.interp(
        along,
        [-0.25, 1.0, 6.0, TAIL - 1.0, TAIL + 0.35, TAIL + 0.62],
        [0.80, 0.96, 1.0, 0.80, 0.45, 0.02],
    )
    centres = np.stack([0.0 * along, CENTRE - BELLY * (1.0 - taper), -SPACING * along], axis=1)
    parts: list[tuple[Part, int | None]] = [
        (tube(centres[::-1], (BELLY * bulge * taper)[::-1], BODY), None)
    ]
    top = CENTRE + 0.022
    parts.append(
        (ball((0.060, 0.057, 0.054), FACE, 20, 28).moved(np.eye(3), (0.0, top, 0.022)), HEAD)
    )
    for side, joint in ((1.0, LEFT), (-1.0, RIGHT)):
        aim = turned(1, 14.0 * side) @ turned(0, -12.0)
        parts.append(
            (
                ball((0.0215, 0.025, 0.017), EYE, 12, 16).moved(
                    aim, (0.025 * side, top + 0.022, 0.060)
                ),
                HEAD,
            )
        )
        t = np.linspace(0.0, 1.0, 10)
        horn = np.stack([0.0 * t, top + 0.045 + 0.062 * t, 0.010 + 0.022 * t**2], axis=1)
        lean = turned(2, -20.0 * side)
        pivot = np.array([0.0, top, 0.01])
        stick = tube(horn - pivot, np.linspace(0.0048, 0.0036, 10), spot(HORN), 10)
        knob = ball((0.0115, 0.0115, 0.0115), spot(TIP), 8, 12)
        for part in (stick, knob.moved(np.eye(3), tuple(horn[-1] - pivot))):
            parts.append((part.moved(lean, (0.012 * side, *pivot[1:])), joint))
    for joint in range(1, SPINE - 1):
        size = float(np.interp(joint, [1, 6, SPINE - 1], [1.0, 1.0, 0.75]))
        for side in (-1.0, 1.0):
            shoe = ball((0.0115 * size, FOOT, 0.0145 * size), spot(SHOE), 8, 12)
            parts.append(
                (
                    shoe.moved(np.eye(3), (0.024 * size * side, FOOT, -SPACING * joint + 0.003)),
                    joint,
                )
            )
    return parts


def _weights(part: Part, joint: int | None) -> tuple[Floats, Floats]:
    """Joints and weights (V, 4): cubic B-spline along the body, else one joint alone."""
    joints, weights = np.zeros((len(part.positions), 4)), np.zeros((len(part.positions), 4))
    if joint is not None:
        joints[:, 0], weights[:, 0] = joint, 1.0
        return joints, weights
    place = np.clip(-part.positions[:, 2] / SPACING, 0.0, TAIL)
    first = np.floor(place)
    t = place - first
    joints[:] = np.clip(first[:, None] + np.arange(-1, 3), 0, TAIL)
    weights[:] = (
        np.stack(
            [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1
        )
        / 6.0
    )
    return joints, weights


def _way() -> CubicSpline:
    """The path on the ground, x and z (glTF) by arc length [m]."""
    points = np.array(WAYPOINTS) * np.array([1.0, -1.0])
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    rough = CubicSpline(knots, points)
    fine = np.linspace(0.0, knots[-1], 2000)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rough(fine), axis=0), axis=1))])
    return CubicSpline(arc, rough(fine))


def poses(times: Floats) -> Floats:
    """World matrices (T, J, 4, 4) of all joints; a joint stands, then strides, in a wave."""
    way = _way()
    index = np.arange(SPINE)
    share = times / times[-1]
    travel = (END - START) * share[:, None]
    stride = (END - START) / (STRIDE_HZ * times[-1])
    phase = STRIDE_HZ * times[:, None] - index / 10.0
    step = np.clip(2.0 * (phase % 1.0) - 1.0, 0.0, 1.0)
    planted = stride * (np.floor(phase) + step**2 * (3.0 - 2.0 * step) + index / 10.0)
    place = START - SPACING * index + 0.45 * travel + 0.55 * planted
    lift = LIFT * np.sin(math.pi * step) ** 2 * np.interp(index, [0, 1, 5, TAIL], [0.5, 1, 1, 0.6])
    centre = np.empty((len(times), SPINE, 3))
    centre[..., 0], centre[..., 2] = np.moveaxis(way(place), -1, 0)
    centre[..., 1] = CENTRE + lift
    forward = -np.gradient(centre, axis=1)
    forward[..., 1] *= 0.8
    eyes = -centre[:, HEAD]
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    ahead = forward[:, HEAD] / np.linalg.norm(forward[:, HEAD], axis=1, keepdims=True)
    forward[:, HEAD] = ahead + 0.7 * eyes * np.array([1.0, 0.0, 1.0])
    matrices = np.zeros((len(times), SPINE + 2, 4, 4))
    matrices[:, :SPINE, :3, 3] = centre
    matrices[:, :SPINE, :3, :3] = _facing(forward)
    swing = 14.0 * np.sin(2.0 * math.pi * times / 2.7)
    nod = 4.0 * np.sin(2.0 * math.pi * times / 1.1 + 1.0) - 3.0
    top = np.array([0.0, 0.022, 0.01])
    for k in range(len(times)):
        matrices[k, HEAD, :3, :3] = (
            matrices[k, HEAD, :3, :3] @ turned(1, swing[k]) @ turned(0, nod[k])
        )
        for joint, side in ((LEFT, 1.0), (RIGHT, -1.0)):
            wag = 11.0 * math.sin(2.0 * math.pi * (2.0 * times[k] + 0.17 * side))
            local = np.eye(4)
            local[:3, :3] = turned(0, wag) @ turned(2, 0.5 * side * wag)
            local[:3, 3] = top + np.array([0.012 * side, 0.0, 0.0])
            matrices[k, joint] = matrices[k, HEAD] @ local
    matrices[..., 3, 3] = 1.0
    return matrices


def _facing(forward: Floats) -> Floats:
    """Rotations (..., 3, 3) whose z axis looks along `forward`, y as upright as can be."""
    z = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    x = np.cross(np.array([0.0, 1.0, 0.0]), z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _bind() -> Floats:
    """World matrices (J, 4, 4) of the bind pose."""
    bind = np.tile(np.eye(4), (SPINE + 2, 1, 1))
    bind[:SPINE, 1, 3], bind[:SPINE, 2, 3] = CENTRE, -SPACING * np.arange(SPINE)
    for joint, side in ((LEFT, 1.0), (RIGHT, -1.0)):
        bind[joint, :3, 3] = (0.012 * side, CENTRE + 0.022, 0.01)
    return bind


def build(lights: list[dict[str, Any]]) -> Glb:
    """The whole file: camera, lights, caterpillar, six seconds of crawling."""
    made = Glb()
    made.camera(TERRACE)
    made.lights(lights)
    parts = _parts()
    body = merge([part for part, _ in parts])
    bound = [_weights(*pair) for pair in parts]
    joints, weights = (np.concatenate(column) for column in zip(*bound, strict=True))
    times = np.arange(FRAMES + 1) / RATE
    world, unbind = poses(times), np.linalg.inv(_bind())
    skin = np.einsum("vk,vkij->vij", weights, (world[0] @ unbind)[joints.astype(int)])
    posed = np.einsum("vij,vj->vi", skin, np.c_[body.positions, np.ones(len(body.positions))])
    world[..., 1, 3] -= posed[:, 1].min()

    texture = made.texture(paint())
    primitive = made.primitive(
        body.positions,
        smooth_normals(body.positions, body.triangles),
        body.uv,
        body.triangles,
        made.material("caterpillar", texture, 0.5),
    )
    primitive.attributes.JOINTS_0 = made.accessor(joints, gl.UNSIGNED_BYTE, target=gl.ARRAY_BUFFER)
    primitive.attributes.WEIGHTS_0 = made.accessor(weights, target=gl.ARRAY_BUFFER)
    made.gltf.meshes.append(gl.Mesh(name="caterpillar", primitives=[primitive]))
    root = made.node("caterpillar")
    nodes: list[int] = []
    for joint in range(SPINE + 2):
        above = None if joint == HEAD else HEAD if joint >= SPINE else joint - 1
        local = (
            world[:, joint] if above is None else np.linalg.inv(world[:, above]) @ world[:, joint]
        )
        name = {HEAD: "head", LEFT: "feeler.L", RIGHT: "feeler.R"}.get(joint, f"spine.{joint:02d}")
        turns = quaternions(local[:, :3, :3])
        nodes.append(
            made.node(
                name,
                root if above is None else nodes[above],
                translation=local[0, :3, 3].tolist(),
                rotation=turns[0].tolist(),
            )
        )
        made.animate(nodes[-1], "translation", times, local[:, :3, 3])
        made.animate(nodes[-1], "rotation", times, turns)
    inverse = made.accessor(unbind.transpose(0, 2, 1).reshape(-1, 16))
    made.gltf.skins.append(gl.Skin(joints=nodes, inverseBindMatrices=inverse, skeleton=root))
    made.node("skin", mesh=0, skin=0)
    return made
