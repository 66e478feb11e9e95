"""Render a scene's layers; `make.py` runs this inside Blender and develops what it leaves.

blender -b --python-use-system-env -P samples/truth/render.py -- JOB.json

Leaves `bg_FOCUS.exr`, `depth.exr` (pinhole, pixel centres), with objects `object.exr` and
`object_depth.exr`, with composites `gt_FOCUS.exr`, with shadows `shadow_FOCUS.exr` and
`around.exr`; or `point.exr` only; and `lights.json`.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import blender_kit as kit
import bpy
import numpy as np
from mathutils import Matrix, Vector

from truth import scene, subject
from truth.plan import HEIGHT, POINT_RADIUS_PX, SENSOR_MM, WIDTH, Lens, View, draw_lens, draw_view

BOUNCES = 3
"""Of light, where shadows are rendered: an object's underside sees the ground."""
MIRRORED = 2
"""Reflections in a row, on hard ground."""
BARREL = "barrel"
AROUND_PX = 256
"""Width of the panorama around the object."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What `make.py` asks for; see its options."""

    seed: int
    camera: str
    out: str
    focuses: list[str]
    samples: int
    error: float
    percent: int
    objects: bool
    composite: bool
    shadow: bool
    point: bool


def set_up(view: View, job: Job) -> bpy.types.Scene:
    """An empty scene with the camera, focused nowhere yet."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    made = bpy.context.scene
    made.render.engine = "CYCLES"
    made.render.resolution_x, made.render.resolution_y = WIDTH, HEIGHT
    made.render.resolution_percentage = job.percent
    made.render.use_persistent_data = True
    cycles = made.cycles
    cycles.seed = view.seed
    cycles.use_denoising = False
    cycles.use_adaptive_sampling = not job.composite  # it ties pixels to their neighbours
    cycles.adaptive_threshold, cycles.adaptive_min_samples = job.error, 12
    cycles.max_bounces = cycles.diffuse_bounces = BOUNCES if job.shadow else 0
    if view.ground:
        cycles.max_bounces = max(MIRRORED, cycles.max_bounces)
        cycles.glossy_bounces = MIRRORED
    cycles.caustics_reflective = cycles.caustics_refractive = False
    data = bpy.data.cameras.new("camera")
    data.lens, data.sensor_width, data.sensor_fit = view.focal_mm, SENSOR_MM, "HORIZONTAL"
    data.clip_start, data.clip_end = 1e-4 if view.ground else 0.01, 2000.0
    camera = bpy.data.objects.new("camera", data)
    tilt = Matrix.Rotation(math.radians(90.0 - view.pitch_deg), 4, "X")
    roll = Matrix.Rotation(math.radians(view.roll_deg), 4, "Z")
    camera.matrix_world = Matrix.Translation((0.0, 0.0, view.height_m)) @ tilt @ roll
    made.collection.objects.link(camera)
    made.camera = camera
    return made


def look_through(made: bpy.types.Scene, lens: Lens | None) -> None:
    """Put a lens before the camera, or a pinhole."""
    depth_of_field = made.camera.data.dof
    depth_of_field.use_dof = lens is not None
    if BARREL in made.objects:
        bpy.data.objects.remove(made.objects[BARREL])
    if lens is not None:
        depth_of_field.focus_distance = lens.focus_m
        depth_of_field.aperture_fstop = lens.blender_f_number
        depth_of_field.aperture_blades = lens.blades
        depth_of_field.aperture_rotation = math.radians(lens.turn_deg)
        if lens.cat_eye > 0.0:
            add_barrel(made, lens)


def add_barrel(made: bpy.types.Scene, lens: Lens) -> None:
    """The rim of a lens's front, black, which cuts the aperture off towards the corners."""
    radius = 0.5e-3 * lens.focal_mm / lens.blender_f_number
    corner = 0.5 * math.hypot(SENSOR_MM, SENSOR_MM * HEIGHT / WIDTH) / lens.focal_mm
    away = lens.cat_eye * radius / corner
    black = kit.emitter("black", (0.0, 0.0, 0.0), 0.0)
    barrel = kit.lathe(BARREL, [(radius, 0.0), (50.0 * radius, 0.0)], (0.0, 0.0, 0.0), black, 128)
    barrel.matrix_world = made.camera.matrix_world @ Matrix.Translation((0.0, 0.0, -away))
    for ray in scene.LIGHT_RAYS:
        setattr(barrel, f"visible_{ray}", False)


def render(made: bpy.types.Scene, path: Path, samples: int) -> None:
    """Write the light of a picture, OpenEXR."""
    made.cycles.samples = samples
    made.cycles.pixel_filter_type, made.cycles.filter_width = "BLACKMAN_HARRIS", 1.5
    settings = made.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR", "RGBA"
    settings.color_depth, settings.exr_codec = "32", "ZIP"
    made.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def render_depth(made: bpy.types.Scene, path: Path) -> None:
    """Write the depth along the optical axis at the centres of the pixels, through a pinhole."""
    look_through(made, None)
    made.cycles.samples = 1
    made.cycles.pixel_filter_type, made.cycles.filter_width = "BOX", 0.01
    layer = bpy.context.view_layer
    layer.use_pass_z = True
    settings = made.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR_MULTILAYER", "RGBA"
    settings.color_depth, settings.exr_codec = "32", "ZIP"
    made.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    layer.use_pass_z = False


def render_object(made: bpy.types.Scene, target: bpy.types.Object, out: Path, samples: int) -> None:
    """The object's layer, sharp, and its depth; the scene lights it but is not seen."""
    seen = [thing for thing in made.objects if thing.type == "MESH" and thing is not target]
    for thing in seen:
        thing.visible_camera = False
    made.render.film_transparent = True
    look_through(made, None)
    render(made, out / "object.exr", samples)
    render_depth(made, out / "object_depth.exr")
    made.render.film_transparent = False
    for thing in seen:
        thing.visible_camera = True


def subject_seen_by_light(target: bpy.types.Object, *, seen: bool) -> None:
    """Whether the object casts shadows and bounces light."""
    for ray in scene.LIGHT_RAYS:
        setattr(target, f"visible_{ray}", seen)


def render_points(made: bpy.types.Scene, view: View, lens: Lens, job: Job) -> None:
    """Two points of light, one nearer than the focal plane and one farther."""
    glow = kit.emitter("glow", (1.0, 1.0, 1.0), 4000.0)
    pitch = math.radians(view.pitch_deg)
    angle = np.linspace(-math.pi / 2, math.pi / 2, 33)
    for side, depth in ((-1.0, 0.75 * lens.focus_m), (1.0, 2.5 * lens.focus_m)):
        x = side * 0.2 * depth * WIDTH / view.focal_px
        place = (x, depth * math.cos(pitch), view.height_m - depth * math.sin(pitch))
        radius = POINT_RADIUS_PX * depth / view.focal_px
        profile = [(radius * math.cos(a), radius * math.sin(a)) for a in angle]
        kit.lathe("point", profile, place, glow)
    made.world = bpy.data.worlds.new("night")
    made.world.color = (0.0, 0.0, 0.0)
    look_through(made, lens)
    made.cycles.use_adaptive_sampling = False
    made.render.use_border = True
    made.render.border_min_y, made.render.border_max_y = 0.4, 0.6
    render(made, Path(job.out) / "point.exr", job.samples)


def render_around(made: bpy.types.Scene, view: View, path: Path, samples: int) -> None:
    """The light that comes to the object, as a panorama from its middle; its middle is +X."""
    seen_by, settings = made.camera, made.render
    size = settings.resolution_x, settings.resolution_y, settings.resolution_percentage
    data = bpy.data.cameras.new("around")
    data.type, data.cycles.panorama_type = "PANO", "EQUIRECTANGULAR"
    data.clip_start = 1e-3
    camera = bpy.data.objects.new("around", data)
    camera.location = (*view.place, 0.3 * view.size_m)
    camera.rotation_euler = (0.5 * math.pi, 0.0, -0.5 * math.pi)
    made.collection.objects.link(camera)
    # The sun stays hidden: its disc is drawn into the map afterwards, without noise.
    lamps = [it for it in made.objects if it.type == "LIGHT" and it.data.type != "SUN"]
    for lamp in lamps:
        lamp.visible_camera = True
    made.camera = camera
    settings.resolution_x, settings.resolution_y = AROUND_PX, AROUND_PX // 2
    settings.resolution_percentage = 100
    render(made, path, samples)
    made.camera = seen_by
    settings.resolution_x, settings.resolution_y, settings.resolution_percentage = size
    for lamp in lamps:
        lamp.visible_camera = False
    bpy.data.objects.remove(camera)


def describe_sun(made: bpy.types.Scene) -> dict[str, object] | None:
    """The sun for params.json and the GLB, glTF's axes."""
    sun = made.objects.get("sun")
    if sun is None:
        return None
    x, y, z = sun.matrix_world.to_3x3() @ Vector((0.0, 0.0, -1.0))
    return {
        "direction_gltf": [x, z, -y],
        "irradiance_w_m2": sun.data.energy,
        "color": list(sun.data.color),
        "angle_deg": math.degrees(sun.data.angle),
    }


def main() -> None:
    """Build the scene once and render it for every focus."""
    job = Job(**json.loads(Path(sys.argv[sys.argv.index("--") + 1]).read_text()))
    view, out = draw_view(job.seed, job.camera), Path(job.out)
    depths = subject.depths(view, subject.mesh(view))
    made = set_up(view, job)
    if job.point:
        render_points(made, view, draw_lens(view, job.focuses[0], depths), job)
        return
    target = scene.build(view, np.random.default_rng([job.seed, 20]))
    bpy.context.view_layer.update()
    (out / "lights.json").write_text(json.dumps(describe_sun(made)))
    if job.objects:
        render_object(made, target, out, job.samples)
    target.hide_render = True
    render_depth(made, out / "depth.exr")
    if job.shadow:
        render_around(made, view, out / "around.exr", job.samples)
    for focus in job.focuses:
        look_through(made, draw_lens(view, focus, depths))
        render(made, out / f"bg_{focus}.exr", job.samples)
        if job.composite:
            target.hide_render = False
            render(made, out / f"gt_{focus}.exr", job.samples)
            if job.shadow:
                subject_seen_by_light(target, seen=True)
                render(made, out / f"shadow_{focus}.exr", job.samples)
                subject_seen_by_light(target, seen=False)
            target.hide_render = True


if __name__ == "__main__":
    main()
