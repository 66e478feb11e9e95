"""The preset `reference`: what is built where the lens can be sampled, and where it cannot."""

import json

import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens

from nlens_video.video.exr import write_layers

STANDS_IN = "the lens cannot be sampled"
START, SIZE = (0.0, 0.2, -3.4), 0.5


def succeed(*words):
    """What a successful run prints on standard output."""
    run = nlens(*words)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shot")
    shots.write_png(folder / "plate.png")
    shots.cube_glb(folder / "anim.glb", start=START, size=SIZE)
    shots.fit_json(folder / "fit.json")
    return folder


def composite(files, out, *words):
    return json.loads(
        succeed(
            files / "plate.png", files / "anim.glb", out, "--preset", "reference",
            "--fit", files / "fit.json", "--json", *words,
        )
    )  # fmt: skip


@pytest.mark.needs_gl
def test_reference_preset_samples_the_lens_and_keeps_the_plate_out_of_reach(files, tmp_path):
    words = ("--effects", "defocus", "--timings", tmp_path / "t.json")
    summary = composite(files, tmp_path / "out.png", *words)
    frames = json.loads((tmp_path / "t.json").read_text())["frames"]
    assert "lens-sampling" in frames[0]["nodes"] and "reblur" not in frames[0]["nodes"]
    assert not any(STANDS_IN in note for note in summary["notes"])
    composite(files, tmp_path / "sharp.png", "--effects", "none")
    seen = shots.camera().to_camera(np.float64(SIZE * shots.CUBE + START))
    coc = shots.SLOPE / -seen[:, 2] + shots.INTERCEPT
    reach = np.ceil(0.5 * np.abs(coc).max()).astype(int) + 1
    (top, left), (bottom, right) = changed(files, tmp_path / "sharp.png")
    (y0, x0), (y1, x1) = changed(files, tmp_path / "out.png")
    assert left - reach <= x0 < left and right < x1 <= right + reach
    assert top - reach <= y0 < top and bottom < y1 <= bottom + reach


def changed(files, out):
    """First and last row and column at which a picture differs from the plate."""
    differs = np.argwhere(
        (cv2.imread(str(files / "plate.png")) != cv2.imread(str(out))).any(axis=2)
    )
    return differs.min(axis=0), differs.max(axis=0)


@pytest.mark.needs_gl
def test_reference_preset_agrees_with_scatter_for_a_simple_object(files, tmp_path):
    composite(files, tmp_path / "reference.png", "--effects", "defocus")
    composite(files, tmp_path / "realtime.png", "--effects", "defocus", "--preset", "realtime")
    pictures = [
        cv2.imread(str(tmp_path / f"{preset}.png")).astype(float)
        for preset in ("reference", "realtime")
    ]
    plate = cv2.imread(str(files / "plate.png")).astype(float)
    assert np.abs(pictures[0] - plate).mean() > 1.0
    assert np.abs(pictures[0] - pictures[1]).mean() < 0.1


def test_prerendered_layers_fall_back_to_single_view_blur_with_a_note(files, tmp_path):
    rgba = np.zeros((shots.HEIGHT, shots.WIDTH, 4), np.float32)
    rgba[100:160, 200:260] = (0.3, 0.2, 0.1, 1.0)
    depth = np.where(rgba[..., 3] > 0, np.float32(1.2), np.float32(np.inf))
    channels = {name: rgba[..., at] for at, name in enumerate("RGBA")} | {"Z": depth}
    write_layers(tmp_path / "layer.exr", channels)
    words = ("--layers", tmp_path / "layer.exr", "--timings", tmp_path / "t.json")
    summary = composite(files, tmp_path / "out.png", *words)
    assert any(STANDS_IN in note for note in summary["notes"])
    nodes = json.loads((tmp_path / "t.json").read_text())["frames"][0]["nodes"]
    assert "reblur" in nodes and "lens-sampling" not in nodes
    plan = succeed(
        files / "plate.png", files / "anim.glb", tmp_path / "o.png", "--preset", "reference",
        "--layers", tmp_path / "layer.exr", "--plan", "-v",
    )  # fmt: skip
    views = "pre-rendered layers hold one view of the object"
    assert f"left out lens-sampling: {views}, so {STANDS_IN}" in plan
    assert "node reblur" in plan and "note: pre-rendered layers" in plan


def test_plan_states_the_number_of_aperture_samples(files, tmp_path):
    plan = succeed(
        files / "plate.png", files / "anim.glb", tmp_path / "o.png", "--preset", "reference",
        "--plan", "-v",
    )  # fmt: skip
    assert "aperture sampled at 29 points for 50 dB" in plan
    assert "left out reblur: not needed: lens-sampling runs" in plan
