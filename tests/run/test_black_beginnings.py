"""Shots that begin with a black or a white picture, as recordings and fades do."""

import numpy as np
import pytest
from support import shots, takes
from support.command import nlens, one_line

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
    return gains, lift


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = shots.write_shot(tmp_path_factory.mktemp("shot"), 1, still=False, sun=True)
    plate = shots.plate() / 255.0
    for kind in ("ordinary", "black", "white", "fade"):
        pictures = [plate * gain + more for gain, more in zip(*beginning(kind), strict=True)]
        size = (shots.WIDTH, shots.HEIGHT)
        takes.encode(folder / f"{kind}.mp4", pictures, size=size, crf=8, audio=False)
    return folder


def last_frame(folder, kind):
    out = folder / f"{kind}.mkv"
    run = nlens(
        folder / f"{kind}.mp4", folder / "anim.glb", out, "--preset", "realtime", "--effects",
        "defocus,exposure", "--fit", folder / "fit.json", "--codec", "ffv1", "-y",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return shots.read_planes(out)[-1][1][0].astype(float), run.stderr


@pytest.mark.parametrize("kind", ["black", "white", "fade"])
def test_object_is_lit_by_the_first_frame_that_tells_the_light(folder, kind):
    usual, _ = last_frame(folder, "ordinary")
    found, told = last_frame(folder, kind)
    plate = shots.read_planes(folder / "ordinary.mp4")[-1][1][0].astype(float)
    there = np.abs(usual - plate) > 12.0
    assert there.sum() > 500
    assert np.abs(found - usual)[there].mean() < 6.0
    if kind != "fade":
        assert "far brighter than the plate's" not in told


def test_black_first_frame_is_told_where_the_lens_is_read_off_it(folder):
    words = [folder / "black.mp4", folder / "anim.glb", folder / "o.mp4", "-q"]
    line = one_line(nlens(*words), 5)
    assert "the picture is black" in line and "--range N:" in line
