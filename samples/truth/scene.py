"""Build a scene around the object's place (runs inside Blender)."""

from __future__ import annotations

import math

import blender_kit as kit
import bpy
import numpy as np
from mathutils import Matrix, Vector

from truth import built, grounds, subject, surfaces, things
from truth.plan import HEIGHT, WIDTH, Floats, View

Rng = np.random.Generator
Spot = tuple[float, float, float, float]
"""x, y and size of a thing, depth of its foot [m]."""
CLEAR_PX = 48
"""Kept free around the object's silhouette, for what stands before it and is out of focus [px]."""
TRIES = 30
LIGHT_RAYS = ("shadow", "diffuse", "glossy", "transmission", "volume_scatter")
"""By which the object would act on the scene."""


class Ground:
    """Levels of the ground: everywhere 0 but on a raised part behind, beyond an edge below."""

    def __init__(self, view: View, rng: Rng) -> None:
        behind = view.place[1] + view.size_m
        self.step_y = behind * rng.uniform(1.1, 2.0) if rng.random() < 0.3 else math.inf
        self.step_z = view.size_m * rng.uniform(0.2, 0.8)
        self.edge_y = math.inf
        if view.setting == "table":
            self.step_y = math.inf
            self.edge_y = behind * rng.uniform(1.2, 2.5)
        self.drop_z = -0.75
        if view.back:
            self.step_y = back_y(view) if view.back == "step" else math.inf
            self.step_z = view.size_m * _drawn_back(view, 1).uniform(0.2, 0.5)
            self.edge_y = math.inf

    def level(self, y: float) -> float:
        """Height of the ground at a distance from the camera [m]."""
        if y > self.edge_y:
            return self.drop_z
        return self.step_z if y > self.step_y else 0.0


def _drawn_back(view: View, number: int) -> Rng:
    return np.random.default_rng([view.seed, 30, number])


def back_y(view: View) -> float:
    """Distance at which that begins which stands close behind a backed scene's object [m]."""
    farthest = float(subject.mesh(view).positions[:, 1].max())
    return farthest + view.size_m * _drawn_back(view, 0).uniform(0.2, 0.6)


def build(view: View, rng: Rng) -> bpy.types.Object:
    """Ground, wall, light, things, and the object, which is returned."""
    if view.built:
        built.raise_scene(view, rng)
        target = _add_subject(view)
        _light(view, 20.0, rng)
        return target
    ground = Ground(view, rng)
    wall_y = math.inf
    if rng.random() < (0.3 if view.setting == "yard" else 0.6):
        far = min(ground.edge_y, 20.0)
        wall_y = max(view.place[1] * rng.uniform(1.6, 5.0), 1.2 * far if far < 20.0 else 0.0)
    if view.ground in grounds.MIRRORS:  # has something to mirror
        wall_y = min(wall_y, view.place[1] * rng.uniform(1.6, 5.0))
    if view.back:
        wall_y = back_y(view) if view.back == "wall" else math.inf
    _lay_ground(view, ground, rng)
    if view.back == "box":
        _stand_box(view, _drawn_back(view, 1))
    if math.isfinite(wall_y):
        _raise_wall(view, wall_y, rng)
        if view.ground in grounds.MIRRORS:
            grounds.windows(wall_y, rng)
    target = _add_subject(view)
    _furnish(view, ground, wall_y, rng)
    _light(view, wall_y, rng)
    return target


def _grain(view: View, depth: float) -> float:
    return depth / view.focal_px


def _lay_ground(view: View, ground: Ground, rng: Rng) -> None:
    kind = str(rng.choice((surfaces.BARE if view.bare else surfaces.GROUNDS)[view.setting]))
    grain = _grain(view, view.project(np.array([[*view.place, 0.0]]))[0, 2])
    grain *= rng.uniform(0.7, 1.4)
    if view.ground:
        material = grounds.ground(rng, view.ground, grain)
    else:
        material = surfaces.surface(rng, kind, grain, flat=True)
    if view.ground == "grass":
        grounds.grow_grass(view, grain, rng)
    reach = min(ground.edge_y, 300.0)
    wide = 0.5 * reach if view.setting == "table" else 200.0
    thick = 0.04
    centre = (0.0, 0.5 * reach - 1.0, -0.5 * thick)
    kit.box("ground", centre, (2.0 * wide, reach + 2.0, thick), material)
    if math.isfinite(ground.edge_y):
        floor = surfaces.surface(
            rng, "wood" if rng.random() < 0.5 else "stone", 2.5 * grain, flat=True
        )
        kit.box("floor", (0, 50, ground.drop_z - 0.05), (100, 110, 0.1), floor)
    if math.isfinite(ground.step_y):
        deep, tall = 100.0, ground.step_z
        step = surfaces.any_surface(rng, 1.5 * grain)
        kit.box("step", (0, ground.step_y + 0.5 * deep, 0.5 * tall), (200, deep, tall), step)


def _raise_wall(view: View, y: float, rng: Rng) -> None:
    kind = str(rng.choice(["bricks", "bricks", "stone", "stone", "wood", "plain", "print"]))
    kind = "plain" if view.bare else kind
    material = surfaces.surface(rng, kind, _grain(view, y) * rng.uniform(0.8, 1.5), flat=True)
    wall = kit.box("wall", (0, 0, 0), (20 * y, 8 * y, 0.2), material)
    turn = Matrix.Rotation(rng.normal(0, 0.15), 4, "Z") @ Matrix.Rotation(math.pi / 2, 4, "X")
    aside = view.place[0] if view.back else 0.0
    wall.matrix_world = Matrix.Translation((aside, y + 0.1, 2 * y)) @ turn


def _stand_box(view: View, rng: Rng) -> None:
    """A box behind the object, turned, wide enough to catch its shadow."""
    size = view.size_m * rng.uniform((0.8, 0.6, 0.4), (1.8, 1.2, 1.2))
    turn = rng.uniform(-0.6, 0.6)
    half = 0.5 * (size[0] * abs(math.sin(turn)) + size[1] * math.cos(turn))
    aside = view.size_m * rng.uniform(-0.4, 0.4)
    material = surfaces.any_surface(rng, _grain(view, back_y(view)))
    box = kit.box("back", (0.0, 0.0, 0.0), (size[0], size[1], size[2]), material)
    place = (view.place[0] + aside, back_y(view) + half, 0.5 * size[2])
    box.matrix_world = Matrix.Translation(place) @ Matrix.Rotation(turn, 4, "Z")


def _add_subject(view: View) -> bpy.types.Object:
    body = subject.mesh(view)
    srgb = subject.paint(view)[::-1] / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    graph = surfaces.Graph("subject", (1.0, 1.0, 1.0))
    place = graph.node("UVMap", {}).outputs["UV"]
    picture = graph.node("TexImage", {"Vector": place}, image=kit.image("paint", linear))
    graph.finish(picture.outputs["Color"], gloss=0.0, height=None, relief=0.0)
    added = kit.mesh("subject", body.positions, body.triangles, graph.material)
    layer = added.data.uv_layers.new(name="uv")
    uv = body.uv[body.triangles.ravel()]
    layer.data.foreach_set("uv", np.stack([uv[:, 0], 1.0 - uv[:, 1]], 1).astype(np.float32).ravel())
    for ray in LIGHT_RAYS:
        setattr(added, f"visible_{ray}", False)
    return added


def _bounds(parts: list[bpy.types.Object]) -> Floats:
    """Corners of the parts' boxes in the world (8 n, 3)."""
    bpy.context.view_layer.update()
    return np.array([part.matrix_world @ Vector(c) for part in parts for c in part.bound_box])


class Room:
    """What is taken: circles on the ground, and the object's window in the picture."""

    def __init__(self, view: View) -> None:
        self.view = view
        body = subject.mesh(view).positions
        seen = view.project(body)
        self.low, self.high = seen[:, :2].min(0) - CLEAR_PX, seen[:, :2].max(0) + CLEAR_PX
        self.farthest = seen[:, 2].max()
        centre, half = body[:, :2].mean(0), 0.5 * np.ptp(body[:, :2], axis=0).max()
        self.circles = [(centre[0], centre[1], 1.15 * half)]

    def takes(self, corners: Floats, circle: tuple[float, float, float]) -> bool:
        """Whether a thing may stand there; if so it is remembered."""
        seen = self.view.project(corners)
        if seen[:, 2].min() < self.view.nearest_m:
            return False
        low, high = seen[:, :2].min(0), seen[:, :2].max(0)
        hides = (low < self.high).all() and (high > self.low).all()
        if hides and seen[:, 2].min() < self.farthest:
            return False
        x, y, radius = circle
        if any(math.hypot(x - a, y - b) < 0.8 * (radius + r) for a, b, r in self.circles):
            return False
        if (high < 0).any() or low[0] > WIDTH or low[1] > HEIGHT:
            return False
        self.circles.append(circle)
        return True


def _furnish(view: View, ground: Ground, wall_y: float, rng: Rng) -> None:
    room = Room(view)
    middle = float(view.project(np.array([[*view.place, 0.0]]))[0, 2])
    fewest, most = (1, 5) if view.bare else (2, 14) if view.ground else (9, 40)
    for _ in range(int(np.exp(rng.uniform(np.log(fewest), np.log(most))))):
        build = things.BUILDERS[int(rng.integers(len(things.BUILDERS)))]
        size_px = WIDTH * np.exp(rng.uniform(np.log(0.05), np.log(0.3)))
        spots = []
        for _ in range(TRIES):
            nearer = rng.random() < 0.4
            low, high = (view.nearest_m, middle) if nearer else (middle, 4.0 * middle)
            depth = math.exp(rng.uniform(math.log(low), math.log(high)))
            x, y = view.on_ground(rng.uniform(-0.05, 1.05) * WIDTH, depth)
            size = size_px * _grain(view, depth)
            if y + 0.5 * size < wall_y and y > 0 and not _on_edge(ground, y, 0.5 * size):
                spots.append((x, y, size, depth))
        if spots:
            _stand(view, ground, room, build, spots, rng)


def _on_edge(ground: Ground, y: float, radius: float) -> bool:
    """Whether a thing would stand half over a step or an edge."""
    return len({ground.level(y - radius), ground.level(y + radius)}) > 1


def _stand(
    view: View, ground: Ground, room: Room, build: things.Builder, spots: list[Spot], rng: Rng
) -> None:
    """Make one thing and put it on the first spot that takes it."""
    grain = float(np.median([_grain(view, d) / size for _, _, size, d in spots]))
    wear = [surfaces.any_surface(rng, grain * rng.uniform(0.8, 2.0)) for _ in range(2)]
    parts = build(rng, [*wear, surfaces.foliage(rng)])
    turn = Matrix.Rotation(rng.uniform(0, 2 * math.pi), 4, "Z")
    bpy.context.view_layer.update()
    own = [part.matrix_world.copy() for part in parts]
    for x, y, size, _ in spots:
        move = Matrix.Translation((x, y, ground.level(y))) @ turn @ Matrix.Scale(size, 4)
        for part, matrix in zip(parts, own, strict=True):
            part.matrix_world = move @ matrix
        if room.takes(_bounds(parts), (x, y, 0.5 * size)):
            return
    for part in parts:
        bpy.data.objects.remove(part)


def _light(view: View, wall_y: float, rng: Rng) -> None:
    """A sky with sun, or lamps under a dim sky; the sun, if any, is called `sun`."""
    indoor = view.setting != "yard" and not view.back and rng.random() < 0.6
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world, world.use_nodes = world, True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    ramp, split = nodes.new("ShaderNodeValToRGB"), nodes.new("ShaderNodeSeparateXYZ")
    warm = rng.uniform(-0.2, 0.25)
    horizon, zenith = (0.8 + warm, 0.8, 0.8 - warm), (0.45 + warm, 0.6, 0.85)
    for stop, at, tint in zip(ramp.color_ramp.elements, (0.0, 0.6), (horizon, zenith), strict=True):
        stop.position, stop.color = at, (*tint, 1.0)
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], split.inputs[0])
    links.new(split.outputs["Z"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Background"].inputs["Color"])
    sunny = not indoor and (rng.random() < 0.85 or bool(view.ground or view.back))
    strength = rng.uniform(0.2, 0.5) if indoor else rng.uniform(0.5, 1.0) + 0.7 * (not sunny)
    nodes["Background"].inputs["Strength"].default_value = strength
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 128
    if sunny:
        sun = kit.lamp("sun", "SUN", (0, 0, 5), rng.uniform(1.5, 4.0), (1.0, 0.95 - warm / 3, 0.8))
        sun.data.angle = math.radians(rng.uniform(0.5, 6.0))
        around, up = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(18, 65))
        if view.back:  # low and from before the object: its shadow falls on what is behind it
            drawn = _drawn_back(view, 2)
            aside = drawn.choice((-1.0, 1.0)) * drawn.uniform(0.3, 1.0)
            around, up = -0.5 * math.pi + aside, math.radians(drawn.uniform(10, 25))
        towards = Vector((math.cos(around), math.sin(around), 1.4 * math.tan(up)))
        sun.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    if indoor:
        _hang_lamps(view, wall_y, rng)
    if view.ground:
        world.cycles_visibility.diffuse = False
        grounds.fill_shadows(strength * rng.uniform(0.3, 0.7))


def _hang_lamps(view: View, wall_y: float, rng: Rng) -> None:
    reach = math.hypot(*view.place)
    for k in range(1 if view.ground else int(rng.integers(1, 4))):
        height = reach * rng.uniform(0.8, 2.0)
        x = view.place[0] + reach * rng.uniform(-1.5, 1.5)
        y = min(view.place[1] + reach * rng.uniform(-1.0, 1.2), 0.9 * wall_y)
        away = Vector((x - view.place[0], y - view.place[1], height))
        energy = math.pi * away.length_squared * rng.uniform(1.0, 2.2) / (1 + k)
        tint = (1.0, rng.uniform(0.7, 1.0), rng.uniform(0.5, 1.0))
        lamp = kit.lamp("lamp", "AREA", (x, y, height), energy, tint)
        lamp.data.size = reach * rng.uniform(0.1, 0.8)
        lamp.rotation_euler = away.to_track_quat("Z", "Y").to_euler()
