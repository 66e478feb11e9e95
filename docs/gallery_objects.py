"""The gallery's own objects, made of the samples' shapes: see make_gallery.py."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pygltflib as gl

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "samples"))

import object_chick  # noqa: E402
from glb import Glb, smooth_normals  # noqa: E402
from shapes import Part, ball, tube  # noqa: E402
from shot_list import PARK, TERRACE  # noqa: E402
from textures import herringbone_bricks  # noqa: E402
from truth.subject import cuboid  # noqa: E402

WALK_KEYS_S = np.array([0.0, 1.0, 2.0])
WALK_EYES = np.array([[-0.35, 0.55, 0.0], [0.0, 0.6, -0.25], [0.4, 0.5, -0.4]])
WALK_TURNS_DEG = np.array([8.0, 1.0, -8.0])  # about up, to the right
BALL = 0.13  # radius [m]
_DOWN_DEG = 10.0
_YFOV = 0.5


def lights(plate: str) -> list[dict[str, Any]]:
    """The lights of a sample's plate."""
    found: list[dict[str, Any]] = json.loads((ROOT / "samples" / f"{plate}.json").read_text())[
        "lights"
    ]
    return found


def two_chicks(path: Path) -> None:
    """The sample's chick before the focus, another one behind it, farther off."""
    made = object_chick.build(lights("in2"))
    made.gltf.nodes[4].name = "near"
    turned = [0.0, math.sin(-0.5), 0.0, math.cos(-0.5)]
    height = made.gltf.nodes[4].translation[1]
    far = made.node("far", translation=[-0.05, height, -5.2], rotation=turned, scale=[1.35] * 3)
    made.gltf.nodes[far].translation[1] = 1.35 * height
    made.node("far chick", far, mesh=0)
    made.node("far key", far, mesh=1, translation=[0.0, 0.15, -0.098])
    made.save(path)


def balls(path: Path) -> None:
    """Balls in the park: lacquer, velvet, brushed metal, chrome; glass, and gold."""
    made = Glb()
    made.camera(PARK)
    made.lights(lights("in2"))
    glass = {"KHR_materials_transmission": {"transmissionFactor": 1.0}}
    looks: list[tuple[tuple[float, ...], float, float, dict[str, Any]]] = [
        (
            (0.5, 0.01, 0.02), 0.0, 0.6,
            {
                "KHR_materials_clearcoat": {
                    "clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.12,
                }
            },
        ),
        (
            (0.03, 0.03, 0.2), 0.0, 1.0,
            {
                "KHR_materials_sheen": {
                    "sheenColorFactor": [0.6, 0.5, 1.0], "sheenRoughnessFactor": 0.4,
                }
            },
        ),
        ((0.9, 0.65, 0.4), 1.0, 0.25, {"KHR_materials_anisotropy": {"anisotropyStrength": 0.8}}),
        ((0.9, 0.9, 0.92), 1.0, 0.03, {}),
        ((1.0, 1.0, 1.0), 0.0, 0.12, glass),
        ((0.3, 0.8, 0.4), 0.0, 0.12, glass),
        ((0.9, 0.95, 1.0), 0.0, 0.4, glass),
        ((1.0, 0.72, 0.3), 1.0, 0.3, {}),
    ]  # fmt: skip
    for number, (color, metallic, roughness, extensions) in enumerate(looks):
        made.gltf.materials.append(
            gl.Material(
                pbrMetallicRoughness=gl.PbrMetallicRoughness(
                    baseColorFactor=[*color, 1.0], metallicFactor=metallic,
                    roughnessFactor=roughness,
                ),
                extensions=extensions,
            )
        )  # fmt: skip
        shape = ball((BALL,) * 3, (0.0, 0.0, 1.0, 1.0), rows=48, columns=96)
        part = made.primitive(
            shape.positions, smooth_normals(shape.positions, shape.triangles), shape.uv,
            shape.triangles, number,
        )  # fmt: skip
        made.gltf.meshes.append(gl.Mesh(primitives=[part]))
        row, column = divmod(number, 4)
        place = [0.29 * (column - 1.5) + 0.12 * row - 0.04, BALL, -4.0 + 0.5 * row]
        made.node("ball", mesh=number, translation=place)
    made.gltf.extensionsUsed = sorted({name for *_, more in looks for name in more})
    made.save(path)


def unlit_chick(path: Path) -> None:
    """The chick without a light of its own."""
    object_chick.build([]).save(path)


def still_chick(path: Path) -> None:
    """The chick without a light, that stays where it is."""
    made = object_chick.build([])
    made.gltf.animations = []
    made.save(path)


def chick_alone(path: Path) -> None:
    """The chick with its lights, without a camera."""
    made = object_chick.build(lights("in2"))
    made.gltf.cameras = []
    for node in made.gltf.nodes:
        node.camera = None
    made.save(path)


def walking_chick(path: Path) -> None:
    """The chick before a camera that walks past it."""
    made = object_chick.build(lights("in2"))
    _walk(made)
    made.gltf.nodes[4].translation[0] = 0.0
    made.gltf.nodes[4].translation[2] = -2.3
    made.gltf.animations[0].channels = [
        channel for channel in made.gltf.animations[0].channels if channel.target.node != 4
    ]
    made.save(path)


def walk(path: Path) -> None:
    """A yard of bricks with a wall, some balls, and the camera that walks through it."""
    made = Glb()
    made.camera(PARK)
    made.lights(lights("in2"))
    colour, _ = herringbone_bricks(512, 8, 3)
    bricks = _flat_paint(made, np.clip(colour, 0, 1) ** (1 / 2.2), 0.9)
    ground = np.array([[-6, 0, 2], [6, 0, 2], [6, 0, -10], [-6, 0, -10]], float)
    tiles = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
    _add(made, "yard", Part(ground, tiles, np.array([[0, 1, 2], [0, 2, 3]])), bricks)
    wall = np.array([[-6, 0, -7], [6, 0, -7], [6, 5, -7], [-6, 5, -7]], float)
    rows = np.array([[0, 0], [7, 0], [7, 3], [0, 3]], float)
    _add(made, "wall", Part(wall, rows, np.array([[0, 1, 2], [0, 2, 3]])), bricks)
    rng = np.random.default_rng(5)
    for number in range(7):
        radius = float(rng.uniform(0.08, 0.2))
        place = (float(rng.uniform(-1.6, 1.6)), radius, float(rng.uniform(-5.5, -3.4)))
        spots = rng.uniform(0.1, 0.9, (6, 6, 3)).astype(np.float32)
        skin = cv2.resize(spots, (128, 128), interpolation=cv2.INTER_CUBIC)
        paint = _flat_paint(made, np.clip(skin, 0, 1), 0.4)
        _add(
            made, f"ball {number}", ball((radius,) * 3, (0, 0, 1, 1)).moved(np.eye(3), place), paint
        )
    _walk(made)
    made.gltf.scenes[0].nodes = [n for n in made.gltf.scenes[0].nodes if n is not None]
    made.save(path)


def post(path: Path) -> None:
    """A painted post close before the terrace's camera."""
    made = Glb()
    made.camera(TERRACE)
    made.lights(lights("in"))
    stripes = np.tile(np.repeat([[0.75, 0.72, 0.65], [0.12, 0.2, 0.22]], 32, axis=0), (1, 1, 1))
    picture = np.broadcast_to(stripes.reshape(1, 64, 3), (64, 64, 3))
    paint = _flat_paint(made, np.ascontiguousarray(picture), 0.6)
    height = np.linspace(0.0, 0.6, 13)
    centres = np.stack([np.full(13, -0.062), height, np.full(13, -0.85)], axis=1)
    made.gltf.animations = []
    _add(made, "post", tube(centres, np.full(13, 0.017), (0, 0, 3, 1)), paint)
    made.save(path)


def wall(path: Path) -> None:
    """A plastered wall close behind the park's chick, and a step before it."""
    made = Glb()
    made.camera(PARK)
    made.lights(lights("in2"))
    made.gltf.animations = []
    noise = np.random.default_rng(3).random((96, 96, 1))
    grain = cv2.resize(cv2.GaussianBlur(noise, (0, 0), 1.0), (512, 512))[..., None] - 0.5
    plaster = np.clip(np.array([0.5, 0.48, 0.44]) * (1.0 + 0.5 * grain), 0.0, 1.0)
    paint = _flat_paint(made, plaster, 0.9)
    for size, place in (
        ((1.6, 0.6, 0.1), (-0.3, 0.3, -2.98)),
        ((0.5, 0.07, 0.5), (-0.7, 0.035, -2.7)),
    ):
        _add_box(made, size, place, paint)
    made.save(path)


def boards(path: Path) -> None:
    """A grey board in the park whose shadow falls towards a red one, which the sun shines on."""
    made = Glb()
    made.camera(PARK)
    grey, red = (_flat_paint(made, np.full((4, 4, 3), one), 0.9) for one in (0.4, (1.0, 0.12, 0.1)))
    _add_box(made, (0.04, 0.15, 0.5), (-0.3, 0.075, -3.5), grey)
    _add_box(made, (0.04, 0.4, 0.5), (0.1, 0.2, -3.5), red)
    made.save(path)


def screen(path: Path) -> None:
    """A perforated screen and a pane of coloured glass behind the terrace's focal plane."""
    made = Glb()
    made.camera(TERRACE)
    made.lights(lights("in"))
    made.gltf.animations = []
    size = 256
    y, x = np.indices((size, size)) + 0.5
    cell = size / 6
    hole = np.hypot(x % cell - cell / 2, y % cell - cell / 2) < 0.33 * cell
    rgba = np.full((size, size, 4), 255, np.uint8)
    rgba[..., :3] = (120, 84, 48)
    rgba[..., 3] = np.where(hole, 0, 255)
    holed = _flat_paint(made, rgba[..., :3] / 255.0, 0.7)
    made.gltf.images[-1].bufferView = made.view(
        cv2.imencode(".png", rgba[..., [2, 1, 0, 3]])[1].tobytes()
    )
    made.gltf.materials[holed].alphaMode, made.gltf.materials[holed].doubleSided = "MASK", True
    glass = _flat_paint(made, np.full((4, 4, 3), (0.15, 0.45, 0.7)), 0.1)
    surface = made.gltf.materials[glass]
    surface.alphaMode, surface.doubleSided = "BLEND", True
    surface.pbrMetallicRoughness.baseColorFactor = [1.0, 1.0, 1.0, 0.45]
    for name, paint, left, depth in (("screen", holed, -0.26, -1.75), ("glass", glass, 0.08, -1.7)):
        corners = np.array([[0, 0, 0], [0.13, 0, 0.09], [0.13, 0.16, 0.09], [0, 0.16, 0]], float)
        uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)
        part = Part(corners + (left, 0.0, depth), uv, np.array([[0, 1, 2], [0, 2, 3]]))
        _add(made, name, part, paint)
    made.save(path)


def evening(path: Path, *, towards_deg: float, warm: bool) -> None:
    """An environment map: a low sun over a sky, warm or cool."""
    height, width = 128, 256
    up = np.linspace(math.pi / 2, -math.pi / 2, height)[:, None]
    around = np.linspace(-math.pi, math.pi, width)[None, :]
    sky = np.where(up > 0, 0.35 + 0.5 * np.sin(np.maximum(up, 0)), 0.12) * np.ones_like(around)
    tint = np.array([1.0, 0.62, 0.38]) if warm else np.array([0.55, 0.75, 1.0])
    light = sky[..., None] * (0.5 + 0.5 * tint)
    sun_up = math.radians(18.0 if warm else 55.0)
    toward = math.radians(towards_deg)
    cosine = np.sin(up) * math.sin(sun_up) + np.cos(up) * math.cos(sun_up) * np.cos(around - toward)
    light += (cosine > math.cos(math.radians(4.0)))[..., None] * (400.0 * tint)
    assert cv2.imwrite(str(path), np.ascontiguousarray(light[..., ::-1], np.float32))


def _walk(made: Glb) -> None:
    """Animate the file's first camera."""
    made.gltf.cameras[0].perspective.yfov = _YFOV
    node = next(index for index, one in enumerate(made.gltf.nodes) if one.camera is not None)
    yaw, pitch = -0.5 * np.radians(WALK_TURNS_DEG), -0.5 * math.radians(_DOWN_DEG)
    turns = np.stack(
        [
            np.cos(yaw) * math.sin(pitch),
            np.sin(yaw) * math.cos(pitch),
            -np.sin(yaw) * math.sin(pitch),
            np.cos(yaw) * math.cos(pitch),
        ],
        axis=1,
    )
    made.animate(node, "translation", WALK_KEYS_S, WALK_EYES)
    made.animate(node, "rotation", WALK_KEYS_S, turns)


def _add_box(made: Glb, size: tuple[float, ...], place: tuple[float, ...], material: int) -> None:
    """A box with sharp edges as a node of its own."""
    body = cuboid((size[0], size[1], size[2]), (0.0, 0.0, 1.0, 1.0))
    positions = body.positions[body.triangles].reshape(-1, 3) + np.array(place)
    triangles = np.arange(len(positions)).reshape(-1, 3)
    uv = body.uv[body.triangles].reshape(-1, 2)
    part = made.primitive(positions, smooth_normals(positions, triangles), uv, triangles, material)
    made.gltf.meshes.append(gl.Mesh(primitives=[part]))
    made.node("box", mesh=len(made.gltf.meshes) - 1)


def _flat_paint(made: Glb, picture: np.ndarray, roughness: float) -> int:
    """A material that wears a display-coded picture (h, w, 3) in [0, 1]."""
    texture = made.texture(np.round(255 * picture).astype(np.uint8))
    return made.material("paint", texture, roughness)


def _add(made: Glb, name: str, part: Part, material: int) -> None:
    """A part as a node of its own."""
    primitive = made.primitive(
        part.positions,
        smooth_normals(part.positions, part.triangles),
        part.uv,
        part.triangles,
        material,
    )
    made.gltf.meshes.append(gl.Mesh(name=name, primitives=[primitive]))
    made.node(name, mesh=len(made.gltf.meshes) - 1)
