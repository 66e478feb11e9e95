"""Render one plate as light layers.

PYTHONPATH=samples:SITE_PACKAGES blender -b --python-use-system-env -P samples/make_plate.py -- \
    terrace --out DIR

Leaves `layers.exr` (one scene-linear picture per light group), `noise.exr` (the same from fewer
rays, to measure the noise), `near.exr` (alpha of what stands before the fairy lights),
`probe.exr` (a white Lambert sphere on the ground, for the object's lights) and, with --point,
only `point.exr` (two defocused points, to check the law of the blur).
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
from pathlib import Path

import blender_kit as kit
import bpy
import numpy as np
from mathutils import Vector
from shot_list import HEIGHT, NOISE_SHARE, SENSOR_MM, SHOTS, WIDTH, Shot

GROUPS = ("sun", "sky", "lamps", "candle")
PROBE_M = 0.05


def arguments() -> argparse.Namespace:
    """Read what follows `--` on Blender's command line."""
    parser = argparse.ArgumentParser(prog="make_plate.py", description=__doc__.splitlines()[0])
    parser.add_argument("scene", choices=sorted(SHOTS))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--percent", type=int, default=100, help="size of the picture")
    parser.add_argument("--point", action="store_true", help="only points of light, no scene")
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    return parser.parse_args(own)


def set_up(shot: Shot, samples: int, percent: int) -> bpy.types.Scene:
    """An empty scene with the shot's camera and render settings."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.resolution_percentage = percent
    cycles = scene.cycles
    cycles.samples, cycles.seed = samples, shot.seed
    cycles.use_denoising, cycles.use_adaptive_sampling = False, False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = shot.bounces, 3, 2
    cycles.sample_clamp_indirect = 4.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    data = bpy.data.cameras.new("camera")
    data.lens, data.sensor_width, data.sensor_fit = shot.focal_mm, SENSOR_MM, "HORIZONTAL"
    data.clip_start, data.clip_end = 0.01, 1000.0
    data.dof.use_dof, data.dof.focus_distance = True, shot.focus_m
    data.dof.aperture_fstop, data.dof.aperture_blades = shot.blender_f_number, 0
    camera = bpy.data.objects.new("camera", data)
    camera.location = (0.0, 0.0, shot.height_m)
    camera.rotation_euler = (math.radians(90.0 - shot.pitch_deg), 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def light(
    scene: bpy.types.Scene, shot: Shot, sky: tuple[kit.Colour, kit.Colour], strength: float
) -> None:
    """Sun and a two-colour sky (horizon, zenith), each a light group."""
    for group in GROUPS:
        bpy.context.view_layer.lightgroups.add(name=group)
    sun = kit.lamp("sun", "SUN", (0.0, 0.0, 5.0), shot.sun_strength, shot.sun_colour)
    sun.data.angle = math.radians(1.5)
    sun.rotation_euler = Vector(shot.sun).to_track_quat("Z", "Y").to_euler()
    sun.lightgroup = "sun"
    world = bpy.data.worlds.new("sky")
    scene.world, world.use_nodes, world.lightgroup = world, True, "sky"
    nodes, links = world.node_tree.nodes, world.node_tree.links
    ramp, split = nodes.new("ShaderNodeValToRGB"), nodes.new("ShaderNodeSeparateXYZ")
    for stop, place, colour in zip(ramp.color_ramp.elements, (0.0, 0.6), sky, strict=True):
        stop.position, stop.color = place, (*colour, 1.0)
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], split.inputs[0])
    links.new(split.outputs["Z"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Background"].inputs["Color"])
    nodes["Background"].inputs["Strength"].default_value = strength


def render(scene: bpy.types.Scene, path: Path, *, layers: bool = False) -> None:
    """Write one OpenEXR file, with every light group where `layers` is set."""
    settings = scene.render.image_settings
    settings.file_format = "OPEN_EXR_MULTILAYER" if layers else "OPEN_EXR"
    settings.color_mode, settings.color_depth, settings.exr_codec = "RGBA", "32", "ZIP"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def render_points(scene: bpy.types.Scene, shot: Shot, out: Path) -> None:
    """One point of light nearer than the focal plane, one farther, on the optical axis's sides."""
    glow = kit.emitter("glow", (1.0, 1.0, 1.0), 4000.0)
    pitch = math.radians(shot.pitch_deg)
    for side, depth in ((-1.0, 0.75 * shot.focus_m), (1.0, 2.5 * shot.focus_m)):
        x = side * 0.2 * depth * WIDTH / shot.focal_px
        place = (x, depth * math.cos(pitch), shot.height_m - depth * math.sin(pitch))
        radius = depth / shot.focal_px
        angle = np.linspace(-math.pi / 2, math.pi / 2, 9)
        kit.lathe(
            "point", [(radius * math.cos(a), radius * math.sin(a)) for a in angle], place, glow
        )
    scene.world = bpy.data.worlds.new("night")
    scene.world.color = (0.0, 0.0, 0.0)
    scene.cycles.samples = 768
    render(scene, out / "point.exr")


def render_noise(scene: bpy.types.Scene, shot: Shot, samples: int, out: Path) -> None:
    """The layers again, other rays and fewer: their difference tells how noisy the layers are."""
    scene.cycles.samples, scene.cycles.seed = max(1, samples // NOISE_SHARE), shot.seed + 100
    render(scene, out / "noise.exr", layers=True)
    scene.cycles.seed = shot.seed


def render_near(
    scene: bpy.types.Scene, shot: Shot, near: list[bpy.types.Object], out: Path
) -> None:
    """Alpha of the things before the fairy lights, under the lens; nothing where none are."""
    if not near:
        return
    for thing in scene.objects:
        thing.hide_render = thing.type == "MESH" and thing not in near
    scene.render.film_transparent, scene.cycles.max_bounces = True, 0
    scene.cycles.samples = 64
    render(scene, out / "near.exr")
    for thing in scene.objects:
        thing.hide_render = False
    scene.render.film_transparent, scene.cycles.max_bounces = False, shot.bounces


def render_probe(scene: bpy.types.Scene, shot: Shot, out: Path) -> None:
    """A white Lambert sphere at the focal plane, through a pinhole, cut out of the picture."""
    white = bpy.data.materials.new("white")
    white.use_nodes = True
    white.node_tree.nodes.clear()
    diffuse, end = (
        white.node_tree.nodes.new(f"ShaderNode{k}") for k in ("BsdfDiffuse", "OutputMaterial")
    )
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    white.node_tree.links.new(diffuse.outputs[0], end.inputs["Surface"])
    angle = np.linspace(-math.pi / 2, math.pi / 2, 49)
    profile = [(PROBE_M * math.cos(a), PROBE_M * math.sin(a)) for a in angle]
    kit.lathe("probe", profile, (0.0, shot.focus_m, PROBE_M), white, 96)
    place = shot.project(np.array([[0.0, shot.focus_m, PROBE_M]]))[0]
    reach = 1.1 * PROBE_M * shot.focal_px / place[2]
    border = scene.render
    border.use_border = True
    border.border_min_x, border.border_max_x = (
        (place[0] - reach) / WIDTH,
        (place[0] + reach) / WIDTH,
    )
    border.border_min_y = 1.0 - (place[1] + reach) / HEIGHT
    border.border_max_y = 1.0 - (place[1] - reach) / HEIGHT
    scene.camera.data.dof.use_dof = False
    scene.cycles.samples = 192
    render(scene, out / "probe.exr", layers=True)


def main() -> None:
    """Build the scene and render its layers."""
    given = arguments()
    shot = SHOTS[given.scene]
    given.out.mkdir(parents=True, exist_ok=True)
    scene = set_up(shot, given.samples, given.percent)
    if given.point:
        render_points(scene, shot, given.out)
        return
    module = importlib.import_module(f"scene_{shot.name}")
    light(scene, shot, module.SKY, module.SKY_STRENGTH)
    near = module.build()
    render(scene, given.out / "layers.exr", layers=True)
    render_noise(scene, shot, given.samples, given.out)
    render_near(scene, shot, near, given.out)
    render_probe(scene, shot, given.out)


main()
