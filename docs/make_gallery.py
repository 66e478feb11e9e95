"""Composite the gallery's pictures, from the samples and what the samples' shapes make.

python docs/make_gallery.py [NAME ...]
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import patch

import av
import gallery_objects as objects
import numpy as np
from make_picture import frame_of
from msgspec.structs import replace
from PIL import Image, ImageDraw, ImageFont

from nlens_video import Compositor
from nlens_video.cli.solve_command import solve_camera
from nlens_video.core.color import ColorTags
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.objects import FurtherObject, PlaceKey, PlaceKeys
from nlens_video.core.placement import GroundPlacing
from nlens_video.core.settings import (
    LightSettings,
    ObjectSettings,
    OutputSettings,
    RealSettings,
    Settings,
    SourceSettings,
    SunSettings,
)
from nlens_video.effects.shadow.apply import Shadow
from nlens_video.effects.shadow.casters import FrameCasters
from nlens_video.graph.base.node import Node
from nlens_video.graph.base.objects_on_ground import load_scene, stage
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.executor import GraphExecutor
from nlens_video.graph.session import open_session
from nlens_video.report.ground_grid import grid_in_view, over_plate
from nlens_video.run.render import render
from nlens_video.scene import scene_light
from nlens_video.scene.patches import Patches
from nlens_video.video.exr import read_exr, write_layers
from nlens_video.video.pixels.picture import ArrayPicture

if TYPE_CHECKING:
    from truth.walkers import Clip

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "gallery"
SAMPLES = ROOT / "samples"
QUALITY, GAP = 86, 6
VIDEO = ColorTags(matrix="gbr", transfer="bt709", primaries="bt709", full_range=True)
Size = tuple[int, int, int, int]
Panel = tuple[str, Image.Image]


def composite(plate: Path, scene: ObjectSettings, frame: int, **more: object) -> Image.Image:
    """One composited frame."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "frame.mkv"
        run = Settings(
            source=SourceSettings(spec=str(plate), frames=(frame, frame + 1)),
            scene=scene,
            output=OutputSettings(spec=str(output), codec="ffv1"),
        )
        render(replace(run, **more))  # type: ignore[arg-type]
        return frame_of(output, 0)


def skinned(_: Path) -> list[Panel]:
    """A skin of 14 joints."""
    return _plain("in", "anim", (12, 60, 108), (240, 60, 820, 440))


def morph(_: Path) -> list[Panel]:
    """Two morph targets."""
    return _plain("in2", "anim2", (3, 9, 15), (60, 130, 540, 490))


def _plain(plate: str, glb: str, frames: tuple[int, ...], crop: Size) -> list[Panel]:
    scene = ObjectSettings(glb=SAMPLES / f"{glb}.glb")
    source = SAMPLES / f"{plate}.mp4"
    fit = SAMPLES / f"{plate}.json"
    shown = [composite(source, scene, frame, fit=fit) for frame in frames]
    return [(f"{f / 24:.1f} s", one.crop(crop)) for f, one in zip(frames, shown, strict=True)]


def two_objects(folder: Path) -> list[Panel]:
    """One fit, found under the near one; each has its own blur."""
    glb = folder / "two.glb"
    objects.two_chicks(glb)
    crop = (60, 130, 620, 480)
    plate = SAMPLES / "in2.mp4"
    sharp = composite(plate, ObjectSettings(glb=glb), 0, effects="shadow")
    lens = composite(plate, ObjectSettings(glb=glb, footprint="near"), 0)
    return [("sharp", sharp.crop(crop)), ("through the plate's lens", lens.crop(crop))]


def keyed(folder: Path) -> list[Panel]:
    """A second object that walks round the first one by keys, and its path on the ground."""
    chick, plate = folder / "chick.glb", SAMPLES / "in.mp4"
    objects.still_chick(chick)
    places = ((0.0, 0.36, 0.7), (1.5, 0.3, 0.5), (3.0, 0.68, 0.5), (4.5, 0.72, 0.78))
    turns = (150.0, 120.0, 60.0, -30.0)
    keys = tuple(
        PlaceKey(time_s=t, at=(x, y), yaw_deg=yaw)
        for (t, x, y), yaw in zip(places, turns, strict=True)
    )
    other = FurtherObject(
        glb=chick, placing=GroundPlacing(size=0.22), keys=PlaceKeys(keys=keys)
    )  # fmt: skip
    scene = ObjectSettings(glb=SAMPLES / "anim.glb", others=(other,))
    staged = stage(scene, load_scene(scene), View(width=960, height=512))
    camera = staged.view.camera_at(staged.scene, 0.0)
    motion = staged.scene.parts[1].motion
    assert motion is not None
    points = np.array([motion.place_at(t) for t in np.linspace(0.0, 4.5, 91)])
    path = [(float(x), float(y)) for x, y in camera.pixels(camera.to_camera(points))]
    panels = []
    for moment in (0.25, 2.375, 4.25):
        shown = composite(plate, scene, round(24 * moment), fit=SAMPLES / "in.json")
        draw = ImageDraw.Draw(shown)
        if not panels:
            draw.line(path, fill="white", width=2)
            for _, x, y in places:
                draw.ellipse((960 * x - 4, 512 * y - 4, 960 * x + 4, 512 * y + 4), fill="white")
        panels.append((f"{moment:.1f} s", shown.crop((150, 60, 810, 512))))
    return panels


def materials(folder: Path) -> list[Panel]:
    """Layered and see-through materials."""
    glb = folder / "balls.glb"
    objects.balls(glb)
    scene = ObjectSettings(glb=glb)
    shown = composite(SAMPLES / "in2.mp4", scene, 4, fit=SAMPLES / "in2.json")
    return [("", shown.crop((90, 190, 940, 440)))]


def environment(folder: Path) -> list[Panel]:
    """Two skies, one without a light in the file."""
    glb = folder / "unlit.glb"
    objects.unlit_chick(glb)
    panels = []
    for title, warm, toward in (
        ("--env-map evening.hdr", True, 120.0),
        ("--env-map noon.hdr", False, -60.0),
    ):
        env = folder / f"{'evening' if warm else 'noon'}.hdr"
        objects.evening(env, towards_deg=toward, warm=warm)
        light = LightSettings(env=env, env_exposure_ev=-0.4)
        scene = ObjectSettings(glb=glb, light=light)
        shown = composite(SAMPLES / "in2.mp4", scene, 4, fit=SAMPLES / "in2.json")
        panels.append((title, shown.crop((60, 130, 540, 490))))
    return panels


def plate_light(folder: Path) -> list[Panel]:
    """A file without a light: by the plate alone, and with a sun."""
    glb = folder / "unlit.glb"
    objects.unlit_chick(glb)
    panels = []
    for title, sun in (
        ("by the plate", None),
        ("--sun 75,35", SunSettings(azimuth_deg=75.0, elevation_deg=35.0)),
        ("--sun -100,20,4", SunSettings(azimuth_deg=-100.0, elevation_deg=20.0, strength=4.0)),
    ):
        scene = ObjectSettings(glb=glb, light=LightSettings(sun=sun))
        shown = composite(SAMPLES / "in2.mp4", scene, 4, fit=SAMPLES / "in2.json")
        panels.append((title, shown.crop((60, 152, 540, 512))))
    return panels


def bounce(folder: Path) -> list[Panel]:
    """A red board that the sun of a map shines on, and the ground in the shadow of another one."""
    glb, env = folder / "boards.glb", folder / "evening.hdr"
    objects.boards(glb)
    objects.evening(env, towards_deg=180.0, warm=True)
    scene = ObjectSettings(glb=glb, light=LightSettings(env=env, env_exposure_ev=-0.4))
    plate, fit, crop = SAMPLES / "in2.mp4", SAMPLES / "in2.json", (250, 190, 730, 460)
    with patch.object(Patches, "of", return_value=None):
        without = composite(plate, scene, 4, fit=fit)
    shown = composite(plate, scene, 4, fit=fit)
    return [("without", without.crop(crop)), ("as it is", shown.crop(crop))]


def shadow(folder: Path) -> list[Panel]:
    """The same shadow as the light casts it and as the lens shows the ground."""
    glb = folder / "screen.glb"
    objects.screen(glb)
    shown = composite(SAMPLES / "in.mp4", ObjectSettings(glb=glb), 0, fit=SAMPLES / "in.json")
    panels = [("sharp shadow", _sharp_shadow(glb)), ("shadow through the lens", shown)]
    crop, size = (230, 110, 710, 410), (640, 400)
    return [(title, one.crop(crop).resize(size, Image.Resampling.LANCZOS)) for title, one in panels]


def own_shadows(folder: Path) -> list[Panel]:
    """A sun's shadow by a guess and as dark as the plate's own, and the path tracer's (Blender)."""
    made = [sys.executable, "-m", "truth.make", "--seed", "8100", "--focus", "mid", "--shadow"]
    made += ["--percent", "50", "--samples", "40", "--out", str(folder)]
    subprocess.run(made, env={**os.environ, "PYTHONPATH": f"{ROOT}:{SAMPLES}"}, check=True)
    truth = folder / "8100_mid"
    plate, scene = truth / "bg.png", ObjectSettings(glb=truth / "object.glb")
    with patch.object(scene_light, "share_in_shadow", return_value=None):
        guessed = composite(plate, scene, 0, effects="defocus,shadow")
    shown = composite(plate, scene, 0, effects="defocus,shadow")
    panels = [("guessed", guessed), ("by the plate's own shadows", shown)]
    panels.append(("path traced", Image.open(truth / "gt.png").convert("RGB")))
    crop, size = (110, 30, 350, 200), (480, 340)
    return [(title, one.crop(crop).resize(size, Image.Resampling.LANCZOS)) for title, one in panels]


@dataclass(frozen=True)
class _Frame:
    """One frame of the graph's."""

    index: int
    number: int
    time_s: float
    picture: ArrayPicture


class _UnblurredShadow(Node):
    """The node `shadow` without the lens fit."""

    name, writes = "shadow", "shadow"

    def __init__(self, shadow: Node) -> None:
        self._shadow = shadow

    def __call__(self, casters: FrameCasters) -> Shadow | None:
        """Cast it."""
        return self._shadow.run(casters, None, None)


def _sharp_shadow(glb: Path) -> Image.Image:
    """The composite with a sharp shadow, of a node without the lens fit."""
    fit = LensFit.load(SAMPLES / "in.json")
    profiler = Profiler()
    session = open_session(
        ObjectSettings(glb=glb),
        LensRequest(effects="defocus,shadow"),
        View(width=fit.width, height=fit.height),
        profiler,
        PlatePreview(lambda: ()),
    )
    nodes = tuple(
        _UnblurredShadow(node) if node.name == "shadow" else node
        for node in session.graph.nodes
        if not node.once
    )
    codes = np.array(frame_of(SAMPLES / "in.mp4", 0))
    steps = GraphExecutor(replace(session.graph, nodes=nodes), profiler, fit)
    with session.render_context():
        steps.run(steps.begin_frame(_Frame(0, 0, 0.0, ArrayPicture(codes, "rgb", VIDEO))), nodes)
    return Image.fromarray(codes)


def holdout(folder: Path) -> list[Panel]:
    """A plate with a real post in front, and the matte that came with it."""
    frame, fit = 60, SAMPLES / "in.json"
    objects.post(folder / "post.glb")
    plate = folder / "plate.mkv"
    render(
        Settings(
            source=SourceSettings(spec=str(SAMPLES / "in.mp4"), frames=(frame, frame + 1)),
            scene=ObjectSettings(glb=folder / "post.glb"),
            output=OutputSettings(spec=str(plate), codec="ffv1"),
            preset="reference",
            effects="defocus",
            fit=fit,
            aov=folder / "aov",
        )
    )
    matte = folder / "matte.exr"
    write_layers(matte, {"A": read_exr(next((folder / "aov").iterdir())).channels["A"]})
    scene = ObjectSettings(
        glb=SAMPLES / "anim.glb",
        playback=replace(ObjectSettings(glb=plate).playback, offset_s=frame / 24),
    )
    behind = replace(scene, real=RealSettings(holdout=str(matte)))
    crop = (150, 60, 630, 380)
    return [
        ("plate", frame_of(plate, 0).crop(crop)),
        ("without", composite(plate, scene, 0, fit=fit).crop(crop)),
        ("--holdout matte.exr", composite(plate, behind, 0, fit=fit).crop(crop)),
    ]


def wall(folder: Path) -> list[Panel]:
    """A plate with a wall and a step, and their depth."""
    fit = SAMPLES / "in2.json"
    objects.wall(folder / "wall.glb")
    plate = folder / "plate.mkv"
    render(
        Settings(
            source=SourceSettings(spec=str(SAMPLES / "in2.mp4"), frames=(0, 1)),
            scene=ObjectSettings(glb=folder / "wall.glb"),
            output=OutputSettings(spec=str(plate), codec="ffv1"),
            effects="defocus,shadow",
            fit=fit,
            aov=folder / "aov",
        )
    )
    depth = folder / "depth.exr"
    of_object = read_exr(next((folder / "aov").iterdir())).channels
    write_layers(depth, {"Z": of_object["object.Depth.Z"]})
    scene = ObjectSettings(glb=SAMPLES / "anim2.glb")
    known = replace(scene, real=RealSettings(holdout=str(depth)))
    crop = (10, 190, 490, 510)
    return [
        ("plate", frame_of(plate, 0).crop(crop)),
        ("without", composite(plate, scene, 0, fit=fit).crop(crop)),
        ("--holdout depth.exr", composite(plate, known, 0, fit=fit).crop(crop)),
    ]


def walker(folder: Path) -> list[Panel]:
    """Somebody who walks before the object."""
    sys.path.append(str(SAMPLES))
    from truth.walkers import Clip

    plate, scene, fit = _drawn(folder, Clip(7, 40))
    left_out = replace(scene, real=RealSettings(occlusion="none"))
    frame, crop = 18, (160, 30, 560, 330)
    return [
        ("plate", frame_of(plate, frame).crop(crop)),
        ("--occlusion none", composite(plate, left_out, frame, fit=fit).crop(crop)),
        ("as it is", composite(plate, scene, frame, fit=fit).crop(crop)),
    ]


def shaded(folder: Path) -> list[Panel]:
    """Somebody who carries a board between the sun and the object."""
    sys.path.append(str(SAMPLES))
    from truth import figures, walkers

    clip = walkers.Clip(7, 72)
    x, z = clip.place
    look, level = clip.walkers[0].look, z - 0.65
    clip.walkers = [walkers.Walker(look, (x - 2.6, level), (x + 1.5, level), (1, 70))]
    right, ahead = clip.sun = 1.0, 0.75  # where a shadow falls, by the height of what casts it
    clip.shade, clip.drift = 0.55, 0.0

    def with_board(look: figures.Look, stride: float, facing: float) -> figures.Array:
        card = figures.draw_figure(look, stride, facing)
        middle, foot = card.shape[1] // 2, card.shape[0]
        for half, low, high, light in ((88, 77, 363, (0.3, 0.12, 0.05)),
                                       (80, 85, 355, (0.55, 0.42, 0.25))):  # fmt: skip
            card[foot - high : foot - low, middle - half : middle + half] = (*light, 1.0)
        return card

    with patch.object(walkers, "draw_figure", with_board):
        plate, drawn, _ = _drawn(folder, clip)
    objects.still_chick(folder / "chick.glb")
    column, row = walkers.project([(x, 0.0, z)], clip.pose(0))[0]
    sun = SunSettings(
        azimuth_deg=math.degrees(math.atan2(-right, -ahead)),
        elevation_deg=math.degrees(math.atan(1.0 / math.hypot(right, ahead))),
    )
    scene = ObjectSettings(
        glb=folder / "chick.glb",
        camera_from=drawn.glb,
        on_ground=GroundPlacing(
            at=(column / walkers.WIDTH, row / walkers.HEIGHT), size=0.25, yaw_deg=30.0
        ),
        light=LightSettings(sun=sun),
    )
    left_out = replace(scene, real=RealSettings(occlusion="none"))
    frame, crop, size = 28, (170, 40, 430, 230), (416, 304)
    panels = [
        ("plate", frame_of(plate, frame)),
        ("--occlusion none", composite(plate, left_out, frame)),
        ("as it is", composite(plate, scene, frame)),
    ]
    return [(title, one.crop(crop).resize(size, Image.Resampling.LANCZOS)) for title, one in panels]


def crossing(folder: Path) -> list[Panel]:
    """Two who cross, one before the object and one behind it, under a camera that travels."""
    sys.path.append(str(SAMPLES))
    from truth.travelling import TravellingClip

    plate, scene, fit = _drawn(folder, TravellingClip(5, 60))
    crop = (170, 30, 570, 330)
    return [
        (f"frame {frame}", composite(plate, scene, frame, fit=fit).crop(crop))
        for frame in (20, 27, 34)
    ]


def _drawn(folder: Path, clip: Clip) -> tuple[Path, ObjectSettings, Path]:
    """A clip of `truth.walkers`: its plate, the object in it, and the true lens."""
    from truth.walkers import write_clip

    write_clip(folder, clip)
    fit = folder / "fit.json"
    slope = clip.infinity * clip.focus
    fit.write_text(LensFit(slope=slope, intercept=-clip.infinity, width=640, height=360).to_json())
    scene = ObjectSettings(glb=folder / "object.glb", layers=str(folder / "object" / "%04d.exr"))
    return folder / "bg.mp4", scene, fit


def reflection(_: Path) -> list[Panel]:
    """A polished floor."""
    scene = ObjectSettings(glb=SAMPLES / "anim.glb")
    glossy = replace(scene, real=RealSettings(reflectance=0.15))
    crop, fit = (130, 90, 700, 450), SAMPLES / "in.json"
    return [
        (title, composite(SAMPLES / "in.mp4", one, 60, fit=fit).crop(crop))
        for title, one in (("matt ground", scene), ("--ground-reflectance 0.15", glossy))
    ]


def moving_camera(folder: Path) -> list[Panel]:
    """A plate by a walking camera's sampled lens; that lens is found again on its first frame."""
    objects.walk(folder / "yard.glb")
    objects.walking_chick(folder / "chick.glb")
    lens = LensFit(slope=140.0, intercept=-50.0, width=960, height=512)
    plate = folder / "walk.mkv"
    sky = np.full((512, 960, 3), (215, 200, 190), np.uint8)
    with (
        Compositor(folder / "yard.glb", preset="reference", effects="defocus", fit=lens) as camera,
        av.open(str(plate), "w") as container,
    ):
        stream = container.add_stream("ffv1", rate=1)
        stream.width, stream.height, stream.pix_fmt = 960, 512, "bgr0"
        for second in range(3):
            frame = av.VideoFrame.from_ndarray(camera.process(sky, time=float(second)), "bgr24")
            container.mux(stream.encode(frame.reformat(format="bgr0")))
        container.mux(stream.encode())
    output = folder / "out.mkv"
    render(
        Settings(
            source=SourceSettings(spec=str(plate)),
            scene=ObjectSettings(glb=folder / "chick.glb"),
            output=OutputSettings(spec=str(output), codec="ffv1"),
            effects="defocus,shadow",  # three moments of a walk: no shutter was open all along
        )
    )
    return [(f"{s} s", frame_of(output, s).resize((480, 256))) for s in range(3)]


def solved_camera(folder: Path) -> list[Panel]:
    """The plate's own camera, found from its pictures, its ground, and an object on it."""
    rate, size = 12, (480, 256)
    objects.walk(folder / "yard.glb")
    objects.chick_alone(folder / "chick.glb")
    lens = LensFit(slope=140.0, intercept=-50.0, width=960, height=512)
    plate, camera, output = folder / "walk.mkv", folder / "camera.json", folder / "out.mkv"
    sky = np.full((512, 960, 3), (215, 200, 190), np.uint8)
    with (
        Compositor(folder / "yard.glb", effects="defocus", fit=lens) as yard,
        av.open(str(plate), "w") as container,
    ):
        stream = container.add_stream("ffv1", rate=rate)
        stream.width, stream.height, stream.pix_fmt = 960, 512, "bgr0"
        for number in range(2 * rate + 1):
            shown = yard.process(sky, time=number / rate)
            frame = av.VideoFrame.from_ndarray(shown, "bgr24")
            container.mux(stream.encode(frame.reformat(format="bgr0")))
        container.mux(stream.encode())
    source = SourceSettings(spec=str(plate))
    solved = solve_camera(source, camera)
    scene = ObjectSettings(
        glb=folder / "chick.glb",
        camera_from=camera,
        on_ground=GroundPlacing(at=(0.47, 0.68), size=0.32),
    )
    render(
        Settings(
            source=source,
            scene=scene,
            output=OutputSettings(spec=str(output), codec="ffv1"),
            effects="defocus,shadow",
        )
    )
    grid = grid_in_view(solved.at(0.0), solved.ground_y)
    panels = []
    for second in range(3):
        before, after = (frame_of(path, second * rate) for path in (plate, output))
        ground = over_plate(np.array(before), solved, float(second), grid)
        column = Image.new("RGB", (size[0], 3 * size[1] + 2 * GAP), "white")
        for row, one in enumerate((before, Image.fromarray(ground), after)):
            column.paste(one.resize(size), (0, row * (size[1] + GAP)))
        panels.append((f"{second} s", column))
    return panels


PICTURES: dict[str, Callable[[Path], list[Panel]]] = {
    "skinned": skinned,
    "morph": morph,
    "two_objects": two_objects,
    "keyed": keyed,
    "plate_light": plate_light,
    "environment": environment,
    "materials": materials,
    "bounce": bounce,
    "shadow": shadow,
    "own_shadows": own_shadows,
    "holdout": holdout,
    "wall": wall,
    "walker": walker,
    "shaded": shaded,
    "crossing": crossing,
    "reflection": reflection,
    "moving_camera": moving_camera,
    "solved_camera": solved_camera,
}


def sheet(panels: list[Panel]) -> Image.Image:
    """Panels of one size side by side, with their titles."""
    width, height = panels[0][1].size
    whole = Image.new("RGB", (len(panels) * (width + GAP) - GAP, height), "white")
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default(18)
    for number, (title, panel) in enumerate(panels):
        left = number * (width + GAP)
        whole.paste(panel, (left, 0))
        draw.text(
            (left + 10, 8), title, font=font, fill="white", stroke_width=2, stroke_fill="black"
        )
    return whole


def main() -> None:
    """Write the pictures that are named, else all."""
    OUT.mkdir(exist_ok=True)
    for name in sys.argv[1:] or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            sheet(PICTURES[name](Path(folder))).save(OUT / f"{name}.jpg", quality=QUALITY)


if __name__ == "__main__":
    main()
