"""Render the frames of `rendered_walkers`, which runs this inside Blender.

blender -b --python-use-system-env -P samples/truth/render_walkers.py -- JOB.json

Leaves `lights.json`, `object_depth.exr`, and for each frame `bg_NNNN.exr`, `gt_NNNN.exr` (with the
object, its shadow and the light that it sends back) and `depth_NNNN.exr` (without the object).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np

from truth import body, render, scene, subject
from truth.plan import draw_lens, draw_view
from truth.routes import routes

SHUTTER = 0.5
"""How long the shutter is open, by the time of a frame [1]."""


def main() -> None:
    """Build the scene once and render each frame without the object and with it."""
    told = json.loads(Path(sys.argv[sys.argv.index("--") + 1]).read_text())
    seed, frames, out = int(told["seed"]), int(told["frames"]), Path(told["out"])
    job = render.Job(
        seed=seed,
        camera="usual",
        out=str(out),
        focuses=["mid"],
        samples=int(told["samples"]),
        error=0.0,
        percent=int(told["percent"]),
        objects=True,
        composite=True,
        shadow=True,
        point=False,
    )
    view = draw_view(seed)
    made = render.set_up(view, job)
    target = scene.build(view, np.random.default_rng([seed, 20]))
    for number, route in enumerate(routes(view, frames)):
        rng = np.random.default_rng([seed, 40, number])
        body.add_walker(rng, route.height_m, route.grain_m, route.at, frames)
    bpy.context.view_layer.update()
    (out / "lights.json").write_text(json.dumps(render.describe_sun(made)))
    render.subject_seen_by_light(target, seen=True)
    made.render.motion_blur_shutter = SHUTTER
    lens = draw_lens(view, "mid", subject.depths(view, subject.mesh(view)))
    others = [thing for thing in made.objects if thing.type == "MESH" and thing is not target]
    for thing in others:
        thing.hide_render = True
    render.render_depth(made, out / "object_depth.exr")
    for thing in others:
        thing.hide_render = False
    for frame in range(frames):
        made.frame_set(frame)
        made.cycles.seed = 1000 * seed + frame
        target.hide_render = True
        made.render.use_motion_blur = False
        render.render_depth(made, out / f"depth_{frame:04d}.exr")
        made.render.use_motion_blur = True
        render.look_through(made, lens)
        render.render(made, out / f"bg_{frame:04d}.exr", job.samples)
        target.hide_render = False
        render.render(made, out / f"gt_{frame:04d}.exr", job.samples)


if __name__ == "__main__":
    main()
