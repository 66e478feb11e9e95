"""A camera file of fewer frames than the run is told, with the frames that it has."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from support import shots

from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.cli.main import main
from nlens_video.run.checks.camera_frames import notes_on_camera_frames

RATE = 25


def camera(indices):
    """The shots' camera on some frames, turning from one to the next."""
    keys = []
    for index in indices:
        turn = np.eye(4)
        cos, sin = math.cos(0.02 * index), math.sin(0.02 * index)
        turn[:3, :3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
        pose = turn @ shots.camera().camera_from_world
        keys.append(
            CameraKey(index=index, pts_s=index / RATE, world_to_camera=pose, fov_x_deg=40.0)
        )
    return SolvedCamera(width=shots.WIDTH, height=shots.HEIGHT, keys=tuple(keys), path="rotation")


def told(indices, count, frames=(0, None)):
    info = SimpleNamespace(frame_count=count)
    return " ".join(notes_on_camera_frames(camera(indices), info, frames))


@pytest.mark.parametrize(
    ("indices", "count", "frames", "needed"),
    [
        (range(20, 44), 60, (0, None), "0 to 59"),
        (range(44), 60, (0, None), "0 to 59"),
        (range(20, 60), 60, (0, None), "0 to 59"),
        (range(20, 44), 60, (30, 50), "30 to 49"),
        (range(20, 44), None, (0, None), "all from 0 on"),
    ],
)
def test_camera_that_does_not_last_is_told_with_its_frames(indices, count, frames, needed):
    text = told(indices, count, frames)
    first, end = indices.start, indices.stop
    assert f"covers frames {first} to {end - 1}, the run needs {needed}" in text
    assert f"--range {first}:{end}" in text


@pytest.mark.parametrize(
    ("indices", "count", "frames"),
    [
        (range(60), 60, (0, None)),
        (range(60), 61, (0, None)),  # by the length of the container
        (range(20, 44), 60, (20, 44)),
        (range(60), None, (0, None)),
        ([0], 60, (0, None)),
        ([0, 30, 59], 60, (0, None)),
    ],
)
def test_camera_of_all_frames_or_of_one_is_not(indices, count, frames):
    assert not told(indices, count, frames)


def test_plate_without_a_camera_of_its_own_is_not():
    assert notes_on_camera_frames(None, SimpleNamespace(frame_count=60), (0, None)) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("indices", "has"), [(range(4, 16), "frames 4 to 15"), ([4, 10, 15], "3 of the frames 4 to 15")]
)
def test_frame_that_the_camera_lacks_is_told_with_those_that_it_has(tmp_path, capsys, indices, has):
    shots.write_shot(tmp_path, 30, still=False)
    shots.cube_glb(tmp_path / "bare.glb", camera=False)
    (tmp_path / "part.json").write_text(camera(indices).to_json())
    words = [
        *(str(tmp_path / name) for name in ("in.mp4", "bare.glb", "out.mp4")), "--camera-from",
        str(tmp_path / "part.json"), "--at", "0.5,0.8", "--size", "0.2", "--at-frame", "20",
    ]  # fmt: skip
    assert main(words) == 2
    assert f"no such frame; it has {has}" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.needs_gl
def test_run_and_plan_tell_of_the_missing_frames(tmp_path, capsys):
    shots.write_shot(tmp_path, 30, still=False)
    part = tmp_path / "part.json"
    part.write_text(camera(range(4, 16)).to_json())
    words = [
        *(str(tmp_path / name) for name in ("in.mp4", "anim.glb", "out.mp4")),
        "--camera-from", str(part), "--fit", str(tmp_path / "fit.json"), "--effects", "none",
        "--no-progress",
    ]  # fmt: skip
    covered = "the camera file covers frames 4 to 15, the run needs 0 to 29"
    assert main([*words, "--plan"]) == 0
    assert covered in capsys.readouterr().out
    assert main(words) == 0
    assert covered in capsys.readouterr().err
