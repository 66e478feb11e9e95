"""Grounds whose blur is hard to read, and what mirrors in them (runs inside Blender).

Sizes count in grains, as in `surfaces.py`; but here many a surface is soft in itself, or nearly
uniform, or shows what lies at other distances.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import blender_kit as kit
import bpy
import numpy as np

from truth import surfaces
from truth.plan import HARD_GROUNDS, WIDTH, View
from truth.surfaces import Graph, Rng, Socket

MIRRORS = ("polished", "wet")
NODES = ("NodeEmission", "NodeAddShader")
TUFTS, KINDS_OF_TUFT, BLADES = 9000, 6, 16
GRASS_REACH = 8.0
"""Farthest blade of grass by the depth of the object's place [1]."""


def ground(rng: Rng, kind: str, grain: float) -> bpy.types.Material:
    """The material of a hard ground; `grain`: a pixel where the object stands [m]."""
    along = math.exp(rng.uniform(math.log(15.0), math.log(80.0))) if kind == "brushed" else 1.0
    scale = (1.0 / (along * grain), 1.0 / grain, 1.0 / grain)
    graph = Graph(kind, scale, rng.uniform(-1.5, 1.5), flat=True)
    BUILDERS[kind](graph, rng, grain)
    return graph.material


def _bent(g: Graph, height: Socket, depth: float) -> Socket:
    """Normals of a relief [m]."""
    return g.node("Bump", {"Height": height, "Distance": depth}).outputs["Normal"]


def _matt(g: Graph, colour: Socket, normal: Socket | None = None) -> None:
    given: dict[str | int, object] = {"Color": colour}
    if normal is not None:
        given["Normal"] = normal
    shader = g.node("BsdfDiffuse", given).outputs[0]
    g.node("OutputMaterial", {"Surface": shader})


def _coated(
    g: Graph, colour: Socket, rough: object, index: float, normal: Socket | None = None
) -> None:
    """Under a clear coat that mirrors as its index of refraction has it."""
    bend: dict[str | int, object] = {} if normal is None else {"Normal": normal}
    matt = g.node("BsdfDiffuse", {"Color": colour}).outputs[0]
    clear = g.node("BsdfGlossy", {"Roughness": rough, **bend}).outputs[0]
    share = g.node("Fresnel", {"IOR": index, **bend}).outputs[0]
    both = g.node("MixShader", {0: share, 1: matt, 2: clear}).outputs[0]
    g.node("OutputMaterial", {"Surface": both})


def _turf(g: Graph, rng: Rng, grain: float) -> None:
    """Earth and moss below the blades."""
    first, second = [0.03, 0.045, 0.012, 1.0], [0.10, 0.12, 0.04, 1.0]
    base = g.mix(g.steps(g.noise(rng.uniform(4, 12), 4, 0.7), 0.3, 0.7), first, second)
    _matt(g, g.shade(base, g.noise(200, 3), gain=1.6))


def _gravel(g: Graph, rng: Rng, grain: float) -> None:
    """Stones of two sizes with shade between them, or grit of a pixel or two."""
    size = math.exp(rng.uniform(math.log(2.5), math.log(30)))
    first, second = surfaces.pair(rng, rng.uniform(1.2, 2.5))
    stones = g.mix(g.grey(g.cells(size)), first, second)
    fine = g.shade(stones, g.grey(g.cells(max(1.2, 0.22 * size))), gain=rng.uniform(1.1, 1.8))
    gap = g.steps(g.cells(size, "DISTANCE_TO_EDGE", "Distance"), 0.0, 0.15)
    tint = g.mix(gap, [0.2 * c for c in first[:3]] + [1.0], fine)
    _matt(g, tint, _bent(g, gap, grain * size * rng.uniform(0.1, 0.5)))


def _snow(g: Graph, rng: Rng, grain: float) -> None:
    """Nearly white, in waves and crumbs, as shallow as light that wanders below leaves them.

    Cycles' own scattering below the surface would need a thousand rays a pixel: its noise would be
    the sharpest thing on the ground.
    """
    white = rng.uniform(0.7, 0.9)
    first = [white * rng.uniform(0.94, 1.0), white * 0.985, white, 1.0]
    second = [c * rng.uniform(1.01, 1.06) for c in first[:3]] + [1.0]
    tint = g.mix(g.noise(60, 4), first, second)
    relief = g.noise(rng.uniform(30, 150), rng.uniform(2, 9), rng.uniform(0.4, 0.65))
    _matt(g, tint, _bent(g, relief, grain * rng.uniform(1, 10)))


def _plaster(g: Graph, rng: Rng, grain: float) -> None:
    """Nearly one colour: trowel marks, grit of a pixel or two."""
    first = surfaces.colour(rng, 0.35, 0.8, 0.25)
    second = [c * rng.uniform(1.02, 1.08) for c in first[:3]] + [1.0]
    marks = g.mix(g.noise(rng.uniform(60, 300), 5, 0.55), first, second)
    grit = g.noise(rng.uniform(1.5, 5), 2)
    tint = g.shade(marks, grit, gain=rng.uniform(1.01, 1.06))
    _matt(g, tint, _bent(g, grit, grain * rng.uniform(0.0, 0.8)))


def _polished(g: Graph, rng: Rng, grain: float) -> None:
    """Marble, varnished boards or tiles: a mirror over a faint pattern."""
    low, high = surfaces.pair(rng, rng.uniform(1.03, 1.8))
    tint = g.mix(g.noise(rng.uniform(20, 250), rng.uniform(1, 6), 0.55), low, high)
    if rng.random() < 0.6:  # joints
        wide = rng.uniform(80, 260)
        sizes = {"Mortar Size": rng.uniform(0.8, 3) / wide, "Brick Width": 1.0}
        sizes |= {"Row Height": float(rng.choice([1.0, 0.15])), "Scale": 1.0 / wide}
        joints = {"Color1": tint, "Color2": tint, "Mortar": surfaces.colour(rng, 0.05, 0.4)}
        given: dict[str | int, object] = {"Vector": g.place, **sizes, **joints}
        tint = g.node("TexBrick", given, offset=0.0).outputs["Color"]
    _coated(g, tint, float(rng.choice([0.0, 0.03, 0.08])), rng.uniform(1.45, 2.2))


def _wet(g: Graph, rng: Rng, grain: float) -> None:
    """Asphalt with puddles: a mirror where water stands, a dull gleam elsewhere."""
    first, second = surfaces.pair(rng, rng.uniform(1.3, 2.5))
    first, second = ([0.35 * c for c in tint[:3]] + [1.0] for tint in (first, second))
    specks = g.grey(g.cells(rng.uniform(2, 6)))
    tint = g.mix(specks, first, second)
    puddle = g.steps(g.noise(rng.uniform(80, 400), 4, 0.5), 0.50, 0.44)
    dull = g.node("MapRange", {"Value": puddle, "To Min": rng.uniform(0.0, 0.04), "To Max": 0.3})
    relief = g.times(specks, puddle)
    normal = _bent(g, relief, grain * rng.uniform(0.5, 2.0))
    _coated(g, tint, dull.outputs[0], 1.33, normal)


def _sand(g: Graph, rng: Rng, grain: float) -> None:
    """Grains of a pixel, ripples."""
    bright, warm = rng.uniform(0.25, 0.6), rng.uniform(0.0, 0.25)
    first = [bright, bright * (1 - 0.7 * warm), bright * (1 - 2 * warm), 1.0]
    gain = rng.uniform(1.1, 1.5)
    second = [min(0.85, gain * c) for c in first[:3]] + [1.0]
    tint = g.mix(g.grey(g.cells(rng.uniform(1.0, 2.5))), first, second)
    tint = g.shade(tint, g.noise(250, 4), gain=rng.uniform(1.02, 1.2))
    ripples = g.noise(rng.uniform(40, 160), rng.uniform(1, 5), 0.45)
    _matt(g, tint, _bent(g, ripples, grain * rng.uniform(2, 15)))


def _terrazzo(g: Graph, rng: Rng, grain: float) -> None:
    """Flecks of all sizes in a plain ground, half of the time polished."""
    first, second = surfaces.pair(rng, rng.uniform(1.2, 3.0))
    tint: object = first
    for size in math.exp(rng.uniform(math.log(4), math.log(16))) * np.array([3.0, 1.0, 0.4]):
        inside = g.steps(g.cells(size, output="Distance"), 0.34, 0.28)
        tint = g.mix(inside, tint, g.mix(g.grey(g.cells(size)), second, first))
    found = g.shade(tint, g.noise(5, 2), gain=1.05)
    if rng.random() < 0.5:
        _coated(g, found, rng.uniform(0.0, 0.15), 1.5)
    else:
        _matt(g, found)


def _fabric(g: Graph, rng: Rng, grain: float) -> None:
    """Threads of a few pixels that repeat, over soft colours; or felt."""
    first, second = surfaces.pair(rng, rng.uniform(1.05, 1.8))
    base = g.mix(g.noise(rng.uniform(60, 300), 2), first, second)
    thread = rng.uniform(2.5, 9)
    waves = [
        g.node(
            "TexWave",
            {"Vector": g.place, "Scale": 0.314 / thread, "Distortion": rng.uniform(0, 1.5)},
            bands_direction=axis,
        ).outputs["Fac"]
        for axis in "XY"
    ]
    weave = g.times(*waves) if rng.random() < 0.7 else g.noise(rng.uniform(6, 20), 5, 0.6)
    tint = g.shade(base, weave, gain=rng.uniform(1.1, 1.7))
    _matt(g, tint, _bent(g, weave, grain * rng.uniform(0.2, 1.5)))


def _soft(g: Graph, rng: Rng, grain: float) -> None:
    """Patterns that are soft where they are in focus: dyed, airbrushed, worn, lit through."""
    first, second = surfaces.pair(rng, rng.uniform(1.5, 4.0))
    size = math.exp(rng.uniform(math.log(12), math.log(90)))
    tint = g.mix(g.steps(g.noise(size, 0.0), 0.3, 0.7), first, second)
    if rng.random() < 0.5:
        tint = g.shade(tint, g.noise(0.4 * size, 0.0), gain=1.4)
    tint = g.shade(tint, g.noise(2.0, 1), gain=rng.uniform(1.0, 1.05))
    _matt(g, tint)


def _fractal(g: Graph, rng: Rng, grain: float) -> None:
    """Rock, rust, lichen: alike at every scale, contrast falling by a random power."""
    first, second = surfaces.pair(rng, rng.uniform(1.5, 4.0))
    cloud = g.noise(rng.uniform(200, 600), 11, rng.uniform(0.4, 0.8))
    tint = g.mix(g.steps(cloud, 0.3, 0.7), first, second)
    _matt(g, tint, _bent(g, cloud, grain * rng.uniform(0, 40)))


def _brushed(g: Graph, rng: Rng, grain: float) -> None:
    """Brushed metal, reeds, fibres: sharp across, soft along."""
    first, second = surfaces.pair(rng, rng.uniform(1.05, 1.6))
    fibre = g.noise(rng.uniform(3, 30), 5, 0.7)
    tint = g.mix(g.steps(fibre, 0.3, 0.7), first, second)
    if rng.random() < 0.5:
        _coated(g, tint, rng.uniform(0.1, 0.3), 1.8)
    else:
        _matt(g, tint)


BUILDERS: dict[str, Callable[[Graph, Rng, float], None]] = dict(
    zip(
        HARD_GROUNDS,
        (
            _turf, _gravel, _snow, _plaster, _polished, _wet, _sand, _terrazzo, _fabric, _soft,
            _fractal, _brushed,
        ),
        strict=True,
    )
)  # fmt: skip


def fill_shadows(share: float) -> None:
    """Give matt surfaces a part of their light from all sides alike, without a ray being cast.

    Rays that look for the sky or choose between lamps leave noise, which on such grounds would be
    the sharpest thing to see.

    Args:
        share: of a white surface's radiance in full fill light [1].
    """
    for material in bpy.data.materials:
        tree = material.node_tree
        for matt in [n for n in tree.nodes if n.type == "BSDF_DIFFUSE"] if tree else []:
            glow, both = (tree.nodes.new(f"Shader{kind}") for kind in NODES)
            tint = matt.inputs["Color"]
            if tint.is_linked:
                tree.links.new(tint.links[0].from_socket, glow.inputs["Color"])
            else:
                glow.inputs["Color"].default_value = tint.default_value
            glow.inputs["Strength"].default_value = share
            targets = [link.to_socket for link in matt.outputs[0].links]
            tree.links.new(matt.outputs[0], both.inputs[0])
            tree.links.new(glow.outputs[0], both.inputs[1])
            for target in targets:
                tree.links.new(both.outputs[0], target)
            material.cycles.sample_as_light = False


def windows(wall_y: float, rng: Rng) -> None:
    """Lit panes with bars on a wall, as they mirror in a floor or a street."""
    glow = rng.uniform(0.8, 3.0)
    pane = kit.emitter("pane", (1.0, rng.uniform(0.75, 1.0), rng.uniform(0.6, 1.1)), glow)
    pane.cycles.sample_as_light = False  # bright things in the mirror, no lamps
    frame = kit.material("frame", (0.2, 0.2, 0.2))
    wide, tall = wall_y * rng.uniform(0.08, 0.3), wall_y * rng.uniform(0.1, 0.4)
    for column in np.arange(-3, 4) * wide * rng.uniform(1.3, 2.2):
        for row in np.arange(0.6, 6.0, 1.5) * tall:
            centre = (float(column), wall_y - 0.02 * wide, float(row))
            kit.box("pane", centre, (wide, 0.02 * wide, tall), pane)
            for bar in (-0.5, 0.0, 0.5):
                x = float(column + bar * wide)
                size = (0.06 * wide, 0.06 * wide, tall)
                kit.box("bar", (x, wall_y - 0.05 * wide, float(row)), size, frame)


def grow_grass(view: View, grain: float, rng: Rng) -> None:
    """Blades of grass all over the ground in view, in tufts that repeat."""
    middle = float(view.project(np.array([[*view.place, 0.0]]))[0, 2])
    far = min(GRASS_REACH * middle, view.farthest_m)
    shade = np.array([0.05, 0.11, 0.02]) * rng.uniform(0.6, 1.6)
    bright = np.clip(shade * rng.uniform(2.0, 4.0), 0, 0.8)
    tall, thin = grain * rng.uniform(8, 25), grain * rng.uniform(0.8, 2.2)
    material = kit.leaf_material("blades", tuple(shade), tuple(bright), 0.3)
    for _ in range(KINDS_OF_TUFT):
        count = TUFTS // KINDS_OF_TUFT
        columns = rng.uniform(-0.1, 1.1, count) * WIDTH
        depths = 1.0 / rng.uniform(1.0 / far, 1.0 / view.nearest_m, count)
        spots = [(*view.on_ground(c, d), 0.0) for c, d in zip(columns, depths, strict=True)]
        bed = kit.mesh("bed", np.array(spots), [], material)
        tuft = _tuft(tall, thin, material, rng)
        tuft.parent = bed
        bed.instance_type = "VERTS"
        bed.show_instancer_for_render = False


def _tuft(tall: float, thin: float, material: bpy.types.Material, rng: Rng) -> bpy.types.Object:
    """A few blades that lean apart, each a bent strip that narrows to its tip."""
    vertices: list[np.ndarray] = []
    faces: list[tuple[int, ...]] = []
    for _ in range(BLADES):
        foot = np.array([*rng.normal(0.0, 0.35 * tall, 2), 0.0])
        turn, lean, high = rng.uniform(0, 6.28), rng.uniform(0.1, 0.8), tall * rng.uniform(0.5, 1)
        out = np.array([math.cos(turn), math.sin(turn), 0.0])
        side = 0.5 * thin * np.array([-out[1], out[0], 0.0])
        up = np.array([0.0, 0.0, high])
        first = len(vertices)
        half = foot + 0.55 * up + 0.25 * lean * high * out
        vertices += [foot - side, foot + side, half + 0.7 * side, half - 0.7 * side]
        vertices.append(foot + 0.9 * up + lean * high * out)
        faces += [(first, first + 1, first + 2, first + 3), (first + 3, first + 2, first + 4)]
    return kit.mesh("tuft", np.array(vertices), faces, material)
