"""The add-on in Blender itself, without a window: from its zip to a composited plate."""

import json
import os
import shutil
import subprocess
import sys

import av
import numpy as np
import pytest
from support import shots
from support.folders import ROOT
from support.hosts import bpy_python

from nlens_video.video.exr import read_exr, write_layers

pytestmark = [pytest.mark.slow, pytest.mark.needs_gl]
SCRIPT = (ROOT / "tests" / "support" / "blender_script.py").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The shot, the add-on's zip by `make addon`, and a program that runs this checkout."""
    folder = tmp_path_factory.mktemp("blender")
    shots.write_shot(folder, end=(0.1, 0.0, -1.6), seconds=0.4)
    subprocess.run(["make", "-s", "-C", ROOT, "addon"], check=True, stdout=subprocess.DEVNULL)
    program = folder / "nlens-video"
    program.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m nlens_video "$@"\n')
    program.chmod(0o755)
    return folder


BLENDERS = [
    pytest.param("blender", marks=pytest.mark.needs_blender),
    pytest.param("bpy", marks=pytest.mark.needs_bpy),
]


@pytest.fixture(params=BLENDERS)
def blender(request, files):
    """Runs the script in the system's Blender, or in the wheel from PyPI; what it told."""
    script = files / "script.py"
    script.write_text(SCRIPT)
    start = {"blender": ["blender", "-b", "--factory-startup", "-P", script, "--"],
             "bpy": [bpy_python(), script]}[request.param]  # fmt: skip
    environment = {**os.environ, "BLENDER_USER_SCRIPTS": str(files / request.param),
                   "TMPDIR": str(files)}  # fmt: skip
    if request.param == "bpy":
        environment.pop("PYTHONPATH", None)

    def run(what, program=None):
        words = (ROOT / "dist" / "nlens_video_blender.zip", program or files / "nlens-video", files)
        run = subprocess.run(
            [*start, *words, what], capture_output=True, text=True, check=False, timeout=300,
            env=environment,
        )  # fmt: skip
        line = next((line for line in run.stdout.splitlines() if line.startswith("TOLD")), None)
        assert line is not None, run.stdout + run.stderr
        return json.loads(line[4:])

    return run


@pytest.mark.parametrize("what", ["clip", "background"])
def test_selected_objects_are_composited_into_the_plate_and_the_result_is_shown(
    what, blender, files
):
    (files / "out.glb").write_text("the user's own")
    told = blender(what)
    assert told["result"] == ["FINISHED"], told
    assert (files / "out.glb").read_text() == "the user's own"
    assert told["temporary"] == []
    assert told["selected"] == ["MESH"] and told["size"] == [1920, 1080]
    assert told["images"] == ["out.mp4"] and told["strips"] == [["nlens-video", 12]]
    words = ["--fit", "fit.json", "--preset", "draft", "--track-focus", "off"]
    for glb, out in (("exported.glb", "same.mp4"), ("anim.glb", "own.mp4")):
        command = [files / "nlens-video", "in.mp4", glb, out, *words, "-y", "-q"]
        subprocess.run(command, cwd=files, check=True)
    shots.assert_same_frames(files / "out.mp4", files / "same.mp4")
    for (_, made), (_, own) in zip(
        shots.read_planes(files / "out.mp4"), shots.read_planes(files / "own.mp4"), strict=True
    ):
        # the object is where the file that Blender imported has it, in much the same light
        assert np.mean(np.abs(made[0].astype(int) - own[0]) > 24) < 0.005


def test_missing_plate_program_and_option_are_said(blender, files):
    assert "no movie clip, and its camera no background image" in blender("no plate")["error"]
    assert "nlens-video is not on the PATH" in blender("clip", files / "none")["error"]
    assert "--no-such-option" in blender("--no-such-option")["error"]
    assert "no closing quotation" in blender("--fit 'a lens")["error"]


def test_options_may_name_files_with_spaces(blender, files):
    (files / "a lens").mkdir(exist_ok=True)
    shutil.copy(files / "fit.json", files / "a lens" / "fit.json")
    assert blender("spaces").get("result") == ["FINISHED"]


def test_action_that_is_only_kept_and_a_light_that_is_excluded_change_nothing(blender, files):
    told = blender("kept action")
    assert told.get("result") == ["FINISHED"], told
    first, *_, last = [planes[0].astype(int) for _, planes in shots.read_planes(files / "out.mp4")]
    shots.cube_glb(files / "rests.glb")
    command = [files / "nlens-video", "in.mp4", "rests.glb", "rests.mp4", "--fit", "fit.json"]
    command += ["--preset", "draft", "--track-focus", "off", "-y", "-q"]
    subprocess.run(command, cwd=files, check=True)
    expected = [planes[0].astype(int) for _, planes in shots.read_planes(files / "rests.mp4")]
    for made, own in ((first, expected[0]), (last, expected[-1])):
        assert np.mean(np.abs(made - own) > 24) < 0.005


@pytest.mark.needs_programs("ffmpeg")
def test_numbered_pictures_have_the_scenes_rate(blender, files):
    (files / "numbered").mkdir(exist_ok=True)
    pattern = files / "numbered" / "in.%04d.png"
    subprocess.run(["ffmpeg", "-v", "error", "-y", "-i", files / "in.mp4", pattern], check=True)
    assert blender("numbered").get("result") == ["FINISHED"]
    with av.open(str(files / "out.mp4")) as container:
        assert container.streams.video[0].average_rate == 25


def test_scene_that_was_saved_during_a_run_is_not_running_when_it_is_opened_again(blender):
    told = blender("save")
    assert told == {"before": [True, False], "after": [False, True], "preset": "realtime"}


def test_missing_numpy_is_said(blender):
    told = blender("no numpy")
    for said in (told["export"], told["import"]):
        assert "apt-get install python3-numpy" in said and "Traceback" not in said


def test_camera_file_that_is_missing_or_damaged_is_one_line(blender, files):
    (files / "garbage.glb").write_text("garbage")
    damaged = {"asset": {"version": "2.0"}, "nodes": [{"mesh": 3}], "scenes": [{"nodes": [0]}]}
    (files / "damaged.gltf").write_text(json.dumps({**damaged, "scene": 0}))
    told = blender("bad cameras")
    assert "missing.glb: there is no such file" in told["missing.glb"]
    assert "garbage.glb: cannot be read as glTF" in told["garbage.glb"]
    assert "damaged.gltf: cannot be read as glTF (it is damaged)" in told["damaged.gltf"]
    for said in told.values():
        assert said.strip().count("\n") == 0 and "Traceback" not in said


def test_cancelled_run_leaves_nothing(blender):
    told = blender("cancel")
    assert not told["left"]


@pytest.fixture(scope="module")
def layers(files):
    """What `--aov` writes of the shot."""
    words = ["in.mp4", "anim.glb", "aov.mkv", "--fit", "fit.json", "--preset", "draft", "-y", "-q"]
    subprocess.run([files / "nlens-video", *words, "--aov", "aov"], cwd=files, check=True)
    (files / "other").mkdir()
    write_layers(files / "other" / "000000.exr", {name: np.ones((4, 4)) for name in "RGBA"})
    return [read_exr(path).channels for path in sorted((files / "aov").iterdir())]


def test_layers_are_a_node_group_of_the_compositor(blender, files, layers):
    told = blender("layers")
    assert told["placed"] == ["Image", "Plate"], "the plate goes in, and the composite out"
    behind = told["grey"]
    for frame in (0, 7):
        channels = layers[frame]
        expected = {
            "Image": np.stack([channels[c] + (1 - channels["A"]) * behind for c in "RGB"], 2),
            "Object": np.stack([channels[f"object.Combined.{c}"] for c in "RGB"], 2),
            "Object CoC": channels["object.coc_px.V"][..., None],
            "Object Depth": channels["object.Depth.Z"][..., None],
            "Plate CoC": channels["plate.coc_px.V"][..., None],
            "Mask": channels["projection.mask.V"][..., None],
        }
        for name, values in expected.items():
            made = read_exr(files / told["rendered"][name][str(frame)]).channels
            pixels = np.stack([made[c] for c in "RGB"][: values.shape[2]], 2)
            there = np.isfinite(values)
            assert there.any() and np.allclose(pixels[there], values[there], atol=2e-3), name


def test_files_of_something_else_are_no_layers(blender, layers):
    assert "no layers in it; nlens-video writes them with --aov" in blender("no layers")["error"]
    assert "not written by nlens-video --aov" in blender("other layers")["error"]
