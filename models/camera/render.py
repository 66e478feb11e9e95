"""Render small views of many scenes for the camera network (runs inside Blender).

    PYTHONPATH=samples blender -b -t 1 --python-use-system-env -P models/camera/render.py -- \
        /tmp/views --first 600000 --scenes 2000

A seed names a scene of `samples/truth`: two in five wild, the others built by people. Every scene
gives the view that was drawn with it and others about the same place: other pitches of 3 to 50
degrees, rolls, focal lengths of 20 to 90 mm, focus and aperture. A view is `SEED_VIEW.exr`,
scene-linear, and `SEED_VIEW.json` with its camera. Evaluation takes seeds below 100000.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector
from truth import scene, subject
from truth.plan import FOCUSES, HEIGHT, SENSOR_MM, WIDTH, Lens, View, draw_lens, draw_view

PERCENT, SAMPLES, VIEWS = 25, 6, 5
WILD = 0.4
FOCALS_MM, PITCHES_DEG, ROLL_DEG, YAW = (20.0, 90.0), (3.0, 50.0), 2.5, 0.3


def set_up(view: View) -> bpy.types.Object:
    """An empty scene with a camera, which is returned."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    made = bpy.context.scene
    render, cycles = made.render, made.cycles
    render.engine, render.threads_mode, render.threads = "CYCLES", "FIXED", 1
    render.resolution_x, render.resolution_y = WIDTH, HEIGHT
    render.resolution_percentage, render.use_persistent_data = PERCENT, True
    cycles.seed, cycles.samples, cycles.use_denoising = view.seed % 100000, SAMPLES, False
    cycles.use_adaptive_sampling = False
    cycles.max_bounces = cycles.diffuse_bounces = 0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 1.5
    image = render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGB", "16"
    image.exr_codec = "ZIP"
    data = bpy.data.cameras.new("camera")
    data.sensor_width, data.sensor_fit = SENSOR_MM, "HORIZONTAL"
    data.clip_start, data.clip_end, data.dof.use_dof = 0.01, 2000.0, True
    camera = bpy.data.objects.new("camera", data)
    made.collection.objects.link(camera)
    made.camera = camera
    return camera


def place(camera: bpy.types.Object, view: View, lens: Lens) -> dict[str, float]:
    """Put the camera where a scene's own view is from; returns what is known of it."""
    return _pose(
        camera, view, lens, at=Vector((0.0, 0.0, view.height_m)), yaw=0.0, roll=view.roll_deg,
        pitch=view.pitch_deg, focal=view.focal_mm, nearer=1.0, stopped=1.0,
    )  # fmt: skip


def place_elsewhere(
    camera: bpy.types.Object, view: View, lens: Lens, rng: np.random.Generator
) -> dict[str, float]:
    """Put the camera somewhere about the scene's place; returns what is known of it."""
    steepest = PITCHES_DEG[1] if rng.random() < 0.5 else 35.0
    pitch, roll = rng.uniform(PITCHES_DEG[0], steepest), rng.normal(0.0, ROLL_DEG)
    focal = math.exp(rng.uniform(*np.log(FOCALS_MM)))
    aim = Vector((view.place[0] * rng.uniform(0.0, 2.0), view.place[1], 0.0))
    before = math.hypot(*view.place, view.height_m)
    away = before * math.sqrt(focal / view.focal_mm) * math.exp(rng.normal(0.0, 0.15))
    yaw = rng.normal(0.0, YAW)
    half = math.atan(0.5 * SENSOR_MM * HEIGHT / WIDTH / focal)
    down = max(math.radians(pitch) + rng.uniform(-0.1, 0.6) * half, math.radians(2.0))
    level = math.cos(down)
    at = aim + away * Vector((math.sin(yaw) * level, -math.cos(yaw) * level, math.sin(down)))
    return _pose(
        camera, view, lens, at=at, yaw=yaw, roll=roll, pitch=pitch, focal=focal,
        nearer=away / before, stopped=math.exp(rng.uniform(-0.2, 1.2)),
    )  # fmt: skip


def _pose(
    camera: bpy.types.Object, view: View, lens: Lens, *, at: Vector, yaw: float, pitch: float,
    roll: float, focal: float, nearer: float, stopped: float,
) -> dict[str, float]:  # fmt: skip
    turn = Matrix.Rotation(yaw, 4, "Z") @ Matrix.Rotation(math.radians(90.0 - pitch), 4, "X")
    turn = turn @ Matrix.Rotation(math.radians(roll), 4, "Z")
    camera.matrix_world = Matrix.Translation(at) @ turn
    camera.data.lens = focal
    camera.data.dof.focus_distance = lens.focus_m * nearer
    camera.data.dof.aperture_fstop = lens.blender_f_number * stopped * focal / view.focal_mm
    return {"pitch_deg": pitch, "roll_deg": roll, "focal_mm": focal}


def render_scene(seed: int, out: Path) -> None:
    """All views of a scene."""
    rng = np.random.default_rng([seed, 99])
    view = draw_view(seed, "wild" if rng.random() < WILD else "built")
    depths = subject.depths(view, subject.mesh(view))
    camera = set_up(view)
    scene.build(view, np.random.default_rng([seed, 20])).hide_render = True
    lens = draw_lens(view, str(rng.choice(FOCUSES)), depths)
    for number in range(VIEWS):
        path = out / f"{seed}_{number}.json"
        if number == 0:
            known = place(camera, view, lens)
        else:
            known = place_elsewhere(camera, view, lens, rng)
        bpy.context.scene.render.filepath = str(path.with_suffix(".exr"))
        bpy.ops.render.render(write_still=True)
        path.write_text(json.dumps(known))


def main() -> None:
    """Render the scenes that the arguments behind `--` name."""
    parser = argparse.ArgumentParser(prog="render.py", description="views for the camera network")
    parser.add_argument("out", type=Path, help="folder for the views")
    parser.add_argument("--first", type=int, default=600000, help="seed of the first scene")
    parser.add_argument("--scenes", type=int, default=100)
    options = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :])
    options.out.mkdir(parents=True, exist_ok=True)
    for seed in range(options.first, options.first + options.scenes):
        render_scene(seed, options.out)


main()
