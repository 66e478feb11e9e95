"""The add-on in Blender itself, without a window: from its zip to a composited plate."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support import shots
from support.folders import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.needs_gl, pytest.mark.needs_blender]
SCRIPT = """
import bpy, json, sys, time
from pathlib import Path
archive, program, folder, what = sys.argv[-4:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.addon_install(filepath=archive)
bpy.ops.preferences.addon_enable(module="nlens_video_blender")
bpy.context.preferences.addons["nlens_video_blender"].preferences.program = program
scene = bpy.context.scene
scene.render.fps, scene.frame_start, scene.frame_end = 25, 0, 11
bpy.ops.nlens.import_camera(filepath=folder + "/anim.glb")
plate = bpy.data.movieclips.load(folder + "/in.mp4")
if what == "background":
    behind = scene.camera.data.background_images.new()
    behind.source, behind.clip = "MOVIE_CLIP", plate
elif what != "no plate":
    scene.active_clip = plate
for one in scene.objects:
    one.select_set(one.type == "MESH")
settings = scene.nlens
settings.preset, settings.fit, settings.result = "draft", folder + "/fit.json", folder + "/out.mp4"
settings.words = "--track-focus off"
if what == "wrong option":
    settings.words = "--no-such-option"
told = {}
if what == "cancel":
    from nlens_video_blender.job import Job
    settings.words = ""
    job = Job(program, folder + "/in.mp4", Path(folder, "anim.glb"), Path(folder, "cut.mkv"), [])
    time.sleep(0.5)
    job.cancel()
    job.wait()
    told = {"error": job.error, "left": Path(folder, "cut.mkv").exists()}
else:
    try:
        told["result"] = sorted(bpy.ops.nlens.composite())
    except RuntimeError as error:
        told["error"] = str(error)
    told["selected"] = sorted(one.type for one in scene.objects if one.select_get())
    told["images"] = [one.name for one in bpy.data.images]
    editor = scene.sequence_editor
    strips = editor.sequences if editor else []
    told["strips"] = [[one.name, one.frame_final_duration] for one in strips]
    told["size"] = [scene.render.resolution_x, scene.render.resolution_y]
print("TOLD" + json.dumps(told))
"""


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


@pytest.fixture
def blender(files):
    """Runs the script in Blender; what it told."""

    def run(what, program=None):
        script = files / "script.py"
        script.write_text(SCRIPT)
        # Blender takes packages from the first Python of PATH; its glTF exporter needs numpy.
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        words = (ROOT / "dist" / "nlens_video_blender.zip", program or files / "nlens-video", files)
        run = subprocess.run(
            ["blender", "-b", "--factory-startup", "-P", script, "--", *words, what],
            capture_output=True, text=True, check=False, timeout=300,
            env={**os.environ, "PATH": path, "BLENDER_USER_SCRIPTS": str(files / "scripts")},
        )  # fmt: skip
        if "No module named 'numpy'" in run.stdout + run.stderr:
            pytest.skip("Blender's Python has no numpy, which its glTF exporter needs")
        line = next((line for line in run.stdout.splitlines() if line.startswith("TOLD")), None)
        assert line is not None, run.stdout + run.stderr
        return json.loads(line[4:])

    return run


@pytest.mark.parametrize("what", ["clip", "background"])
def test_selected_objects_are_composited_into_the_plate_and_the_result_is_shown(
    what, blender, files
):
    told = blender(what)
    assert told["result"] == ["FINISHED"], told
    assert told["selected"] == ["MESH"] and told["size"] == [1920, 1080]
    assert told["images"] == ["out.mp4"] and told["strips"] == [["nlens-video", 12]]
    words = ["--fit", "fit.json", "--preset", "draft", "--track-focus", "off"]
    for glb, out in (("out.glb", "same.mp4"), ("anim.glb", "own.mp4")):
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
    assert "--no-such-option" in blender("wrong option")["error"]


def test_cancelled_run_leaves_nothing(blender):
    told = blender("cancel")
    assert not told["left"]
