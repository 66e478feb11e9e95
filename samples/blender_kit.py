"""Meshes and materials for the plates' scenes (runs inside Blender)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Colour = tuple[float, float, float]


def image(name: str, pixels: Floats) -> bpy.types.Image:
    """A linear float picture from (N, N) or (N, N, 3), row 0 at the bottom."""
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels if pixels.ndim == 3 else pixels[..., None]
    picture = bpy.data.images.new(name, rgba.shape[1], rgba.shape[0], float_buffer=True)
    picture.colorspace_settings.name = "Non-Color"
    picture.pixels.foreach_set(rgba.ravel())
    picture.pack()
    return picture


def material(
    name: str,
    colour: Colour,
    *,
    roughness: float = 0.6,
    bump: float = 0.0,
    metallic: float = 0.0,
    mottle: float = 0.25,
    scale: float = 40.0,
) -> bpy.types.Material:
    """A mottled principled surface; `bump` is the depth of its relief [m]."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    position = nodes.new("ShaderNodeTexCoord").outputs["Object"]
    noise = nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value = scale
    noise.inputs["Detail"].default_value = 4.0
    ramp = nodes.new("ShaderNodeValToRGB")
    for stop, place, factor in zip(
        ramp.color_ramp.elements, (0.3, 0.7), (1 - mottle, 1 + mottle), strict=True
    ):
        stop.position, stop.color = place, (*(min(1.0, c * factor) for c in colour), 1.0)
    links.new(position, noise.inputs["Vector"])
    links.new(noise.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    if bump:
        relief = nodes.new("ShaderNodeBump")
        relief.inputs["Distance"].default_value = bump
        links.new(noise.outputs["Fac"], relief.inputs["Height"])
        links.new(relief.outputs["Normal"], shader.inputs["Normal"])
    return made


def ground_material(
    name: str, colour: Floats, height: Floats, *, roughness: float, relief_m: float
) -> bpy.types.Material:
    """A surface that wears painted pictures by its UV map."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Specular"].default_value = 0.3
    paint, tall, bump = (
        nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "TexImage", "Bump")
    )
    paint.image, tall.image = image(f"{name} colour", colour), image(f"{name} height", height)
    bump.inputs["Distance"].default_value = relief_m
    links.new(paint.outputs["Color"], shader.inputs["Base Color"])
    links.new(tall.outputs["Color"], bump.inputs["Height"])
    links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return made


def leaf_material(
    name: str, dark: Colour, bright: Colour, translucency: float = 0.35
) -> bpy.types.Material:
    """Leaves, every one of its own shade, that let light through."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    ramp = nodes.new("ShaderNodeValToRGB")
    for stop, colour in zip(ramp.color_ramp.elements, (dark, bright), strict=True):
        stop.color = (*colour, 1.0)
    links.new(nodes.new("ShaderNodeNewGeometry").outputs["Random Per Island"], ramp.inputs["Fac"])
    front, through, mix = (
        nodes.new(f"ShaderNode{kind}") for kind in ("BsdfDiffuse", "BsdfTranslucent", "MixShader")
    )
    mix.inputs["Fac"].default_value = translucency
    for index, shader in enumerate((front, through), start=1):
        links.new(ramp.outputs["Color"], shader.inputs["Color"])
        links.new(shader.outputs[0], mix.inputs[index])
    links.new(mix.outputs[0], nodes["Material Output"].inputs["Surface"])
    return made


def emitter(name: str, colour: Colour, strength: float) -> bpy.types.Material:
    """A glowing surface of radiance colour * strength."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    shader.inputs["Emission"].default_value = (*colour, 1.0)
    shader.inputs["Emission Strength"].default_value = strength
    return made


def mesh(
    name: str,
    vertices: Floats,
    faces: Sequence[Sequence[int]] | npt.NDArray[np.int64],
    surface: bpy.types.Material,
    *,
    smooth: bool = False,
) -> bpy.types.Object:
    """Add a mesh to the scene."""
    data = bpy.data.meshes.new(name)
    data.from_pydata([tuple(v) for v in vertices], [], [tuple(int(i) for i in f) for f in faces])
    data.polygons.foreach_set("use_smooth", [smooth] * len(data.polygons))
    data.materials.append(surface)
    added = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(added)
    return added


def box(
    name: str,
    centre: Colour,
    size: Colour,
    surface: bpy.types.Material,
    yaw: float = 0.0,
    bevel: float = 0.004,
) -> bpy.types.Object:
    """A bevelled box turned about z by `yaw` [rad]."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    added = mesh(name, signs * 0.5 * np.array(size), faces, surface)
    added.location, added.rotation_euler = centre, (0.0, 0.0, yaw)
    edges = added.modifiers.new("bevel", "BEVEL")
    edges.width, edges.segments = bevel, 2
    return added


def lathe(
    name: str,
    profile: Sequence[tuple[float, float]],
    place: Colour,
    surface: bpy.types.Material,
    steps: int = 64,
) -> bpy.types.Object:
    """A body of revolution about z from (radius, height) pairs [m]."""
    angle = np.arange(steps) / steps * 2.0 * math.pi
    rings = np.array([[r * math.cos(a), r * math.sin(a), z] for r, z in profile for a in angle])
    faces = [
        (
            k * steps + s,
            k * steps + (s + 1) % steps,
            (k + 1) * steps + (s + 1) % steps,
            (k + 1) * steps + s,
        )
        for k in range(len(profile) - 1)
        for s in range(steps)
    ]
    added = mesh(name, rings, faces, surface, smooth=True)
    added.location = place
    return added


def leaves(
    name: str,
    centres: Floats,
    length: float,
    surface: bpy.types.Material,
    rng: np.random.Generator,
    *,
    flat: float = 0.0,
    width: float = 0.45,
) -> bpy.types.Object:
    """A leaf at every centre (N, 3), turned at random; flat = 1 lays them on the ground."""
    count = len(centres)
    along = rng.standard_normal((count, 3))
    along[:, 2] *= 1.0 - flat
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal = rng.standard_normal((count, 3)) * (1.0 - 0.85 * flat) + np.array([0.0, 0.0, flat])
    across = np.cross(normal, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    lift = np.cross(along, across)
    size = length * rng.uniform(0.6, 1.25, (count, 1))
    corners = [
        centres - 0.5 * size * along,
        centres - 0.05 * size * along + 0.5 * width * size * across + 0.10 * size * lift,
        centres + 0.5 * size * along + 0.08 * size * lift,
        centres - 0.05 * size * along - 0.5 * width * size * across + 0.10 * size * lift,
    ]
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    base = 4 * np.arange(count)[:, None]
    faces = np.concatenate([base + np.array([[0, 1, 2]]), base + np.array([[0, 2, 3]])])
    return mesh(name, vertices, faces, surface)


def in_ellipsoid(count: int, centre: Colour, radii: Colour, rng: np.random.Generator) -> Floats:
    """Points (count, 3), denser towards the skin of an ellipsoid."""
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = direction * rng.uniform(0.3, 1.0, (count, 1)) ** 0.5
    return np.asarray(points * np.array(radii) + np.array(centre))


def lamp(
    name: str, kind: str, place: Colour, energy: float, colour: Colour, radius: float = 0.05
) -> bpy.types.Object:
    """A light that the camera does not see."""
    data = bpy.data.lights.new(name, kind)
    data.energy, data.color = energy, colour
    if kind == "POINT":
        data.shadow_soft_size = radius
    added = bpy.data.objects.new(name, data)
    added.location, added.visible_camera = place, False
    bpy.context.scene.collection.objects.link(added)
    return added
