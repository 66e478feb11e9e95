"""Files that people and other programs write as text: shots, lists of shots, cameras."""

from __future__ import annotations

import contextlib
import json
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
from support.camera_files import RATE, SIZE, fspy, path_of, pose_of, write_colmap

from nlens_video.cameras.files import camera_bytes, read_camera
from nlens_video.cameras.placed import stand_on_ground
from nlens_video.core.errors import NlensError
from nlens_video.core.placement import GroundPlacing

_SHOT = """\
version = 1
[plate]
file = "plates/in.mp4"
range = "4:20"
[object]
file = "anim.glb"
loop = true
[place]
at = [0.5, 0.75]
size = 0.3
[camera]
camera-from = "camera.json"
[light]
env-map = "sky.hdr"
sun = [60, 35.5]
[lens]
lens = "50mm f/2.8"
aperture = "6:15:0.2"
[effects]
shutter-angle = 90.0
effects = "auto,-grain"
[quality]
preset = "draft"
[output]
file = "out.mp4"
crf = 18
"""
_SEVERAL = """\
version = 2
[plate]
file = "in.mp4"
[[object]]
file = "anim.glb"
interpolation = "linear"
[[object.key]]
time = 2
at = [0.7, 0.8]
[[object.key]]
time = 4.5
size = 0.2
[[object]]
file = "other.glb"
at = [0.6, 0.8]
height = "40cm"
key = [{time = 1.5, yaw = 90}]
[output]
file = "out.mp4"
"""
_JOBS = """\
[[shot]]
in = "a/in.mp4"
object = "a/anim.glb"
out = "a/out.mov"
options = ["--preset", "draft", "--at", "0.5,0.8"]
[[shot]]
in = "b/plate_%04d.png"
object = "b/anim.glb"
out = "b/out_####.png"
"""
_PART = re.compile(rb"^== (cameras\.txt|images\.txt|points3D\.txt)$", re.MULTILINE)
_CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (0, 2) for z in (-1, 1)], np.float32)


def shots(folder: Path) -> list[Path]:
    """One with a single object, one with two and with keys."""
    (folder / "one.toml").write_text(_SHOT)
    (folder / "two.toml").write_text(_SEVERAL)
    return [folder / "one.toml", folder / "two.toml"]


def use_shot(path: Path) -> None:
    """As the command line reads one, up to where it opens the plate."""
    from nlens_video.cli.main import drop_protocol
    from nlens_video.cli.output_files import check_outputs
    from nlens_video.options import to_settings
    from nlens_video.options.parser import parse

    args = parse([str(path)])
    drop_protocol(args)
    check_outputs(args, overwrite=True)
    to_settings.settings(args)


def jobs(folder: Path) -> list[Path]:
    """Two shots by their words."""
    (folder / "jobs.toml").write_text(_JOBS)
    return [folder / "jobs.toml"]


def use_jobs(path: Path) -> None:
    from nlens_video.cli.farm_commands import read_shot_list

    read_shot_list(path)


def cameras(suffix: str):
    """A path and a still camera in a format that is written here."""

    def make(folder: Path) -> list[Path]:
        made = {"path": path_of(6), "still": path_of(1)}
        paths = [folder / f"{name}{suffix}" for name in made]
        for path, camera in zip(paths, made.values(), strict=True):
            path.write_bytes(camera_bytes(camera, path))
        return paths

    return make


def fspy_files(folder: Path) -> list[Path]:
    (folder / "fspy.json").write_text(json.dumps(fspy(pose_of())))
    return [folder / "fspy.json"]


def colmap_models(folder: Path) -> list[Path]:
    """The three files of a model in one, so that each of them is damaged."""
    ground = np.random.default_rng(6).uniform(-3, 3, (60, 3)) * (1, 0, 1)
    poses = [pose_of(eye=(0.2 * n, 1.6, 0.5)) for n in range(5)]
    model = write_colmap(folder / "model", poses, ground)
    path = folder / "model.txt"
    path.write_text("".join(f"== {one.name}\n{one.read_text()}" for one in sorted(model.iterdir())))
    return [path]


def use_colmap(path: Path) -> None:
    """The file's parts as the files of a model; what has lost its name is a missing file."""
    model = path.with_suffix(".model")
    model.mkdir(exist_ok=True)
    for old in model.iterdir():
        old.unlink()
    _, *parts = _PART.split(path.read_bytes())
    for name, text in zip(parts[::2], parts[1::2], strict=True):
        (model / name.decode()).write_bytes(text.removeprefix(b"\n"))
    use_camera(model)


def use_camera(path: Path) -> None:
    """As a run uses one: at the frames' times, with an object on its ground; and written again."""
    camera = read_camera(path, SIZE, RATE, Fraction(1, 1000))
    for time_s in (0.0, 0.1, 1e6):
        camera.at(time_s)
    with contextlib.suppress(NlensError):  # such as a camera that sees no ground
        placed, _ = stand_on_ground(_CUBE, np.zeros(3), GroundPlacing(), camera, 0.0)
        placed.at(0.1)
    camera_bytes(camera, Path("camera.json"))
