"""Procedural surfaces, sharp to the pixel where they are seen from (runs inside Blender).

Sizes within a pattern count in grains; a grain is about the size of a pixel where the surface is
seen: the finest octave is as fine as the picture can show, so that softness there is the lens's.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable

import blender_kit as kit
import bpy
import numpy as np

Rng = np.random.Generator
Socket = bpy.types.NodeSocket
Colour = tuple[float, float, float]


class Graph:
    """The nodes of one material; coordinates count in grains, `flat` ones leave z out (quicker)."""

    def __init__(self, name: str, scale: Colour, turn: float = 0.0, *, flat: bool = False) -> None:
        self.dimensions = "2D" if flat else "3D"
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.nodes, self.links = self.material.node_tree.nodes, self.material.node_tree.links
        self.nodes.clear()
        mapping = self.nodes.new("ShaderNodeMapping")
        mapping.inputs["Scale"].default_value = scale
        mapping.inputs["Rotation"].default_value = (0.0, 0.0, turn)
        place = self.nodes.new("ShaderNodeTexCoord").outputs["Object"]
        self.links.new(place, mapping.inputs["Vector"])
        self.place = mapping.outputs["Vector"]

    def node(self, kind: str, inputs: dict[str | int, object], **fields: object) -> bpy.types.Node:
        """Add a node; inputs are sockets or values."""
        made = self.nodes.new(f"ShaderNode{kind}")
        for name, value in fields.items():
            setattr(made, name, value)
        for key, value in inputs.items():
            if isinstance(value, bpy.types.NodeSocket):
                self.links.new(value, made.inputs[key])
            else:
                made.inputs[key].default_value = value
        return made

    def noise(self, size: float, detail: float = 4.0, rough: float = 0.6) -> Socket:
        """Perlin noise [0, 1] whose largest features measure `size` grains."""
        given = {"Vector": self.place, "Scale": 1.0 / size, "Detail": detail, "Roughness": rough}
        made = self.node("TexNoise", given, noise_dimensions=self.dimensions)
        return made.outputs["Fac"]

    def cells(self, size: float, feature: str = "F1", output: str = "Color") -> Socket:
        """Voronoi cells of `size` grains: their colours or distances."""
        given = {"Vector": self.place, "Scale": 1.0 / size}
        made = self.node("TexVoronoi", given, feature=feature, voronoi_dimensions=self.dimensions)
        return made.outputs[output]

    def grey(self, colour: Socket) -> Socket:
        """One random number of a cell's random colour."""
        return self.node("SeparateXYZ", {0: colour}).outputs[0]

    def steps(self, value: Socket, low: float, high: float) -> Socket:
        """0 below low, 1 above high."""
        given = {"Value": value, "From Min": low, "From Max": high}
        return self.node("MapRange", given).outputs[0]

    def mix(self, factor: Socket, first: object, second: object) -> Socket:
        """From the first colour to the second."""
        return self.node("MixRGB", {"Fac": factor, "Color1": first, "Color2": second}).outputs[0]

    def times(self, first: object, second: object) -> Socket:
        """Product of two numbers."""
        return self.node("Math", {0: first, 1: second}, operation="MULTIPLY").outputs[0]

    def shade(self, colour: Socket, socket: Socket | None, *, gain: float) -> Socket:
        """The colour, up to `gain` times brighter or darker after a pattern [0, 1]."""
        power = self.node("MapRange", {"Value": socket, "To Min": 1 / gain, "To Max": gain})
        given = {0: colour, "Scale": power.outputs[0]}
        return self.node("VectorMath", given, operation="SCALE").outputs["Vector"]

    def finish(self, colour: Socket, *, gloss: float, height: Socket | None, relief: float) -> None:
        """End in a diffuse surface, varnished where gloss > 0; relief in the thing's units."""
        given: dict[str | int, object] = {"Color": colour}
        if height is not None and relief > 0:
            bump = self.node("Bump", {"Height": height, "Distance": relief})
            given["Normal"] = bump.outputs["Normal"]
        out = self.node("BsdfDiffuse", given).outputs[0]
        if gloss > 0:
            shiny = self.node("BsdfGlossy", {"Roughness": 0.1 + 0.3 * (1 - gloss)}).outputs[0]
            fresnel = self.node("Fresnel", {"IOR": 1.45}).outputs[0]
            out = self.node("MixShader", {0: fresnel, 1: out, 2: shiny}).outputs[0]
        self.node("OutputMaterial", {"Surface": out})


def colour(rng: Rng, low: float = 0.06, high: float = 0.55, vivid: float = 0.5) -> list[float]:
    """A random linear RGBA, mostly muted."""
    hue = rng.random() if rng.random() < 0.5 else rng.normal(0.09, 0.03) % 1.0
    red, green, blue = colorsys.hsv_to_rgb(hue, rng.random() * vivid, rng.uniform(low, high))
    return [red, green, blue, 1.0]


def pair(rng: Rng, contrast: float) -> tuple[list[float], list[float]]:
    """Two colours, the second `contrast` times as bright, of a slightly different hue."""
    first = colour(rng)
    gain = contrast ** rng.choice([-1.0, 1.0])
    second = [float(np.clip(c * gain * np.exp(rng.normal(0, 0.12)), 0.01, 0.85)) for c in first[:3]]
    return first, [*second, 1.0]


def _stone(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Concrete, asphalt, plaster: noise over many octaves and specks."""
    first, second = pair(rng, rng.uniform(1.2, 2.5))
    base = g.mix(g.steps(g.noise(rng.uniform(40, 150), 5, 0.75), 0.3, 0.7), first, second)
    specks = g.grey(g.cells(rng.uniform(2.5, 6)))
    return g.shade(base, specks, gain=rng.uniform(1.1, 1.9)), specks


def _gravel(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Pebbles, each of its own shade, dark between them."""
    size = np.exp(rng.uniform(np.log(6), np.log(40)))
    first, second = pair(rng, rng.uniform(1.5, 3.0))
    pebbles = g.mix(g.grey(g.cells(size)), first, second)
    gap = g.steps(g.cells(size, "DISTANCE_TO_EDGE", "Distance"), 0.0, 0.12)
    fine = g.shade(pebbles, g.noise(6, 2), gain=1.5)
    return g.mix(gap, [c * 0.15 for c in first[:3]] + [1.0], fine), gap


def _bricks(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Tiles, setts, bricks, planks: courses with joints."""
    width = float(np.exp(rng.uniform(np.log(40), np.log(160))))
    ratio = rng.choice([1.0, 0.5, 0.12])
    first, second = pair(rng, rng.uniform(1.1, 2.2))
    given = {
        "Vector": g.place,
        "Color1": first,
        "Color2": second,
        "Mortar": colour(rng, 0.03, 0.5, 0.2),
        "Scale": 1.0 / width,
        "Mortar Size": rng.uniform(0.6, 2.5) / width,
        "Brick Width": 1.0,
        "Row Height": ratio,
    }
    made = g.node("TexBrick", given, offset=0.0 if ratio == 1.0 else 0.5)
    wear = g.noise(20, 4, 0.75)
    return g.shade(made.outputs["Color"], wear, gain=rng.uniform(1.5, 2.6)), wear


def _wood(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Fibres along x (the graph is stretched): varnished and smooth, or rough."""
    first, second = pair(rng, rng.uniform(1.15, 2.2))
    fibres = g.noise(rng.uniform(12, 60), 4, 0.7)
    base = g.mix(g.steps(fibres, 0.3, 0.7), first, second)
    return g.shade(base, g.noise(3, 1), gain=rng.uniform(1.02, 1.35)), fibres


def _weave(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Cloth and carpet: threads, checks, pile."""
    first, second = pair(rng, rng.uniform(1.3, 4.0))
    checks = {"Vector": g.place, "Scale": 1.0 / np.exp(rng.uniform(np.log(5), np.log(60)))}
    made = g.node("TexChecker", {**checks, "Color1": first, "Color2": second})
    pile = g.noise(rng.uniform(3, 5), 2, 0.8)
    return g.shade(made.outputs["Color"], pile, gain=rng.uniform(1.6, 3.5)), pile


def _terrazzo(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Flecks of many colours in a plain ground: terrazzo, confetti, fallen leaves."""
    size = np.exp(rng.uniform(np.log(5), np.log(30)))
    cells = g.cells(size)
    first, second = pair(rng, rng.uniform(1.5, 5.0))
    fleck = g.mix(g.grey(cells), second, cells if rng.random() < 0.3 else first)
    inside = g.steps(g.cells(size, output="Distance"), 0.36, 0.30)
    base = g.mix(inside, first, fleck)
    return g.shade(base, g.noise(5, 2), gain=rng.uniform(1.1, 1.6)), inside


def _turf(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Grass, moss, earth, sand: fine contrast all over."""
    first, second = pair(rng, rng.uniform(2.0, 5.0))
    if rng.random() < 0.5:
        first, second = [0.05, 0.11, 0.02, 1.0], [0.22, 0.30, 0.08, 1.0]
    fine = g.noise(rng.uniform(3, 9), 3, 0.75)
    patches = g.noise(150, 3)
    return g.shade(g.mix(g.steps(fine, 0.3, 0.7), first, second), patches, gain=1.8), fine


def _print(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Print on paper: rows of random dark blocks."""
    size = rng.uniform(6, 18)
    paper, ink = colour(rng, 0.4, 0.8, 0.15), colour(rng, 0.02, 0.2)
    rows = g.node("TexWave", {"Vector": g.place, "Scale": 0.1 / size}, bands_direction="Y")
    letters = g.steps(g.grey(g.cells(size * 0.35)), 0.52, 0.48)
    mask = g.times(g.steps(rows.outputs["Fac"], 0.4, 0.45), letters)
    return g.shade(g.mix(mask, paper, ink), g.noise(4, 2), gain=rng.uniform(1.1, 1.5)), mask


def _plain(g: Graph, rng: Rng) -> tuple[Socket, Socket]:
    """Nearly nothing to see: paint, lacquer, paper."""
    cloudy = g.noise(120, 4, 0.6)
    first, second = pair(rng, rng.uniform(1.02, 1.2))
    return g.mix(cloudy, first, second), cloudy


KINDS: dict[str, Callable[[Graph, Rng], tuple[Socket, Socket]]] = {
    "stone": _stone,
    "gravel": _gravel,
    "bricks": _bricks,
    "wood": _wood,
    "weave": _weave,
    "terrazzo": _terrazzo,
    "turf": _turf,
    "print": _print,
    "plain": _plain,
}
GROUNDS = {
    "table": ["wood", "wood", "stone", "bricks", "weave", "terrazzo", "plain"],
    "room": ["wood", "bricks", "bricks", "stone", "weave", "weave", "terrazzo"],
    "yard": ["stone", "stone", "gravel", "gravel", "bricks", "turf", "turf"],
}
BARE = {
    "table": ["plain", "plain", "stone"],
    "room": ["plain", "stone", "terrazzo"],
    "yard": ["turf", "turf", "gravel", "stone"],
}
"""Grounds without lines."""


def surface(
    rng: Rng, kind: str, grain: float, *, flat: bool = False, turn: float | None = None
) -> bpy.types.Material:
    """A material of one kind; `grain`: a pixel where it is seen [units of the thing]."""
    along = 0.08 if kind == "wood" else 1.0
    scale = (along / grain, 1.0 / grain, 1.0 / grain)
    drawn = rng.uniform(-0.8, 0.8)
    graph = Graph(kind, scale, drawn if turn is None else turn, flat=flat)
    tint, height = KINDS[kind](graph, rng)
    if kind != "plain" and rng.random() < 0.6:
        tint = graph.shade(tint, graph.noise(2.5, 1), gain=rng.uniform(1.1, 2.0))
    glossy = kind in ("wood", "terrazzo", "plain") and rng.random() < 0.5
    relief = grain * rng.uniform(0.5, 3.0) if rng.random() < 0.2 and kind != "plain" else 0.0
    graph.finish(tint, gloss=float(glossy) * rng.random(), height=height, relief=relief)
    return graph.material


def any_surface(rng: Rng, grain: float) -> bpy.types.Material:
    """A material for a thing."""
    weights = np.array([3, 1, 3, 3, 3, 2, 1, 2, 2], float)
    kind = str(rng.choice(list(KINDS), p=weights / weights.sum()))
    return surface(rng, kind, grain)


def foliage(rng: Rng) -> bpy.types.Material:
    """Leaves or blades, green or autumnal."""
    shade = np.array([0.06, 0.13, 0.03]) if rng.random() < 0.7 else rng.uniform(0.05, 0.3, 3)
    bright = np.clip(shade * rng.uniform(2.0, 4.0), 0, 0.8)
    return kit.leaf_material("leaf", tuple(shade), tuple(bright), 0.3)
