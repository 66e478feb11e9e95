"""Shots that begin or end with a black or a white picture, or dim, as recordings and fades do."""

import json

import numpy as np
import pytest
from support import shots, takes
from support.command import nlens, one_line

from nlens_video import Compositor

pytestmark = pytest.mark.needs_gl
FRAMES = 10


def beginning(kind):
    """What each frame's codes are multiplied by, then raised by."""
    gains, lift = np.ones(FRAMES), np.zeros(FRAMES)
    if kind == "black":
        gains[0] = 0.0
    elif kind == "white":
        gains[0], lift[0] = 0.0, 1.0
    elif kind == "fade":
        gains[:6] = np.arange(6) / 6
    elif kind == "dim":
        gains[:6] = np.linspace(0.4, 1.0, 6)
    elif kind == "flicker":
        gains = 0.94 ** (np.arange(FRAMES) % 2.0)
        gains[0] = 0.0
    elif kind == "out":
        gains[-5:] = (0.7, 0.4, 0.1, 0.0, 0.0)
    return gains, lift


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = shots.write_shot(tmp_path_factory.mktemp("shot"), 1, still=False, sun=True)
    plate = shots.plate() / 255.0
    for kind in ("ordinary", "black", "white", "fade", "dim", "flicker", "out"):
        pictures = [plate * gain + more for gain, more in zip(*beginning(kind), strict=True)]
        size = (shots.WIDTH, shots.HEIGHT)
        takes.encode(folder / f"{kind}.mp4", pictures, size=size, crf=8, audio=False)
    return folder


def composited(folder, kind, *words):
    """Luma of every frame, and what the run printed."""
    out = folder / f"{kind}.mkv"
    run = nlens(
        folder / f"{kind}.mp4", folder / "anim.glb", out, "--preset", "realtime", "--effects",
        "defocus,exposure", "--fit", folder / "fit.json", "--codec", "ffv1", "-y", *words,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return luma(out), run.stderr


def luma(path):
    return [planes[0].astype(float) for _, planes in shots.read_planes(path)]


def object_of(usual, plate):
    there = np.abs(usual - plate) > 12.0
    assert there.sum() > 500
    return there


@pytest.mark.parametrize("kind", ["black", "white", "fade", "dim"])
def test_object_is_lit_by_the_first_frame_that_tells_the_light(folder, kind):
    usual, _ = composited(folder, "ordinary")
    found, told = composited(folder, kind)
    there = object_of(usual[-1], luma(folder / "ordinary.mp4")[-1])
    assert np.abs(found[-1] - usual[-1])[there].mean() < 6.0
    assert "far brighter than the plate's" not in told


@pytest.mark.parametrize("kind", ["fade", "dim", "out"])
def test_object_fades_with_the_plate(folder, kind):
    usual, _ = composited(folder, "ordinary")
    found, _ = composited(folder, kind)
    gains, _ = beginning(kind)
    for number, plate in enumerate(luma(folder / "ordinary.mp4")):
        there = object_of(usual[number], plate)
        wanted = 16.0 + gains[number] * (usual[number] - 16.0)
        assert abs((found[number] - wanted)[there].mean()) < 4.0, number


def test_object_fades_in_with_a_stream(folder):
    gains = np.concatenate([np.arange(12) / 12, np.ones(3)])
    plate = shots.plate()
    usual, found = (
        faded(folder, [np.round(plate * gain).astype(np.uint8) for gain in part])
        for part in (np.ones(15), gains)
    )
    there = np.abs(usual[0].astype(int) - plate).max(axis=2) > 12
    for number, gain in enumerate(gains):
        error = found[number].astype(float) - gain * usual[number].astype(float)
        assert abs(error[there].mean()) < 36.0, number


def test_lights_of_the_file_are_as_bright_on_every_frame_of_a_night(folder):
    night = np.clip(shots.plate() // 12, 1, None).astype(np.uint8)
    first, *others = faded(folder, [night] * 4)
    there = np.abs(first.astype(int) - night).max(axis=2) > 3
    assert there.sum() > 500
    for other in others:
        assert np.abs(other.astype(int) - first)[there].mean() < 1.0


def test_object_flickers_with_the_plate_after_a_black_frame(folder):
    usual, _ = composited(folder, "ordinary")
    found, _ = composited(folder, "flicker")
    there = object_of(usual[-1], luma(folder / "ordinary.mp4")[-1])
    light = [one[there].mean() - 16.0 for one in found]
    assert light[0] < 1.0
    gains, _ = beginning("flicker")
    wanted = light[-1] / gains[-1] * gains
    assert np.abs(light - wanted).max() < 3.0


def test_object_does_not_jump_where_the_lamps_of_a_night_flicker(folder):
    night = np.clip(shots.plate() // 12, 1, None) / 255.0
    flicker = np.random.default_rng(5).uniform(0.85, 1.15, 12)
    plate, out, glb = folder / "night.mp4", folder / "night.mkv", folder / "dim.glb"
    shots.cube_glb(glb, sun_lx=0.4)  # so little that it stays as bright as it is
    size = (shots.WIDTH, shots.HEIGHT)
    takes.encode(plate, [night * one for one in flicker], size=size, crf=4, audio=False)
    run = nlens(
        plate, glb, out, "--preset", "realtime", "--effects", "defocus,exposure",
        "--fit", folder / "fit.json", "--codec", "ffv1", "-y",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    codes = [np.uint8(np.rint(255.0 * night * one)) for one in flicker]
    streamed = faded(folder, codes, glb)
    for found, first in ((luma(out), luma(plate)[0]), (streamed, codes[0])):
        there = np.abs(found[0] - first.astype(float)) > 3.0
        assert there.sum() > 500
        light = [one[there].mean() for one in found]
        assert min(light) > 0.8 * max(light)


def faded(folder, plates, glb=None):
    glb = glb or folder / "anim.glb"
    with Compositor(glb, preset="realtime", fps=25, fit=folder / "fit.json") as lens:
        return [lens.process(plate) for plate in plates]


def test_range_within_a_fade_is_that_part_of_the_whole(folder):
    whole, _ = composited(folder, "fade")
    part, _ = composited(folder, "fade", "--range", "2:5")
    assert np.array_equal(part, whole[2:5])


@pytest.mark.parametrize("kind", ["black", "fade"])
def test_effects_and_what_moves_are_measured_after_the_beginning(folder, kind):
    rng = np.random.default_rng(3)
    plate = shots.plate() / 255.0
    gains, lift = (np.concatenate([part, part[-1:].repeat(40)]) for part in beginning(kind))
    pictures = [
        np.clip(plate + rng.normal(0.0, 3 / 255, plate.shape), 0.0, 1.0) * gain + more
        for gain, more in zip(gains, lift, strict=True)
    ]
    noisy = folder / f"noisy-{kind}.mp4"
    takes.encode(noisy, pictures, size=(shots.WIDTH, shots.HEIGHT), crf=8, audio=False)
    run = nlens(
        noisy, folder / "anim.glb", folder / "o.mkv", "--fit", folder / "fit.json", "--plan"
    )
    assert run.returncode == 0, run.stderr
    assert "effect grain: yes" in run.stdout
    assert "effect occlusion: no, nothing moves" in run.stdout


@pytest.mark.parametrize("kind", ["black", "white", "fade"])
def test_lens_is_read_off_the_first_picture_of_more_than_one_colour(folder, kind):
    saved = folder / f"{kind}.json"
    words = [folder / f"{kind}.mp4", folder / "anim.glb"]
    run = nlens(*words, folder / "o.mkv", "--preset", "realtime", "--save-fit", saved, "-y")
    assert run.returncode == 0, run.stderr
    assert "of one colour" not in run.stderr
    found = json.loads(saved.read_text())
    assert (
        found["frame"] == {"black": 1, "white": 1, "fade": 2}[kind]
    )  # the first one with 3 levels of light
    usual = json.loads((folder / "fit.json").read_text())
    assert found["slope"] == pytest.approx(usual["slope"], rel=0.2)
    again = folder / "again.json"
    assert nlens("fit", *words, again, "-y").returncode == 0
    assert json.loads(again.read_text())["slope"] == pytest.approx(found["slope"], rel=0.1)


def test_lens_of_a_stream_is_read_off_the_first_picture_of_more_than_one_colour(folder):
    glb = folder / "anim.glb"
    plate = shots.plate()
    with Compositor(glb, preset="realtime", fps=25) as lens:
        black = lens.process(np.zeros_like(plate))
        assert not black.any() and lens.fit is None
        assert np.abs(lens.process(plate).astype(int) - plate).max() > 40
        assert lens.fit.slope == pytest.approx(shots.SLOPE, rel=0.2)


@pytest.mark.parametrize("command", [(), ("fit",)])
def test_lens_of_a_black_shot_is_said_to_be_untold(folder, command):
    black = folder / "all-black.mp4"
    shots.write_video(black, 5, rgb=np.zeros_like(shots.plate()))
    out = folder / ("o.json" if command else "o.mp4")
    words = [*command, black, folder / "anim.glb", out, "-q", "-y"]
    line = one_line(nlens(*words), 5)
    assert "all pictures are of one colour, and tell no lens" in line
