"""Somebody crosses before the object in a shot with black frames, fades or the flash of a photo."""

import numpy as np
import pytest
from support import shots, takes
from support.command import nlens

from nlens_video.core.color import transfer

pytestmark = pytest.mark.needs_gl
FRAMES, CROSSES = 60, 25  # and a frame on which the card hides half of the object
SRGB = transfer("iec61966-2-1")
NEAR = 1.0 + 8.0 * np.exp(-np.square(np.linspace(-2.0, 2.0, shots.WIDTH)))[None, :, None]
KINDS = {  # light of a frame, by its number and what it shows without
    "plain": lambda index, light: light,
    "flash": lambda index, light: light * (4.0 if 9 <= index <= 12 else 1.0),
    "flash on it": lambda index, light: light * (4.0 if index == CROSSES else 1.0),
    "near flash on it": lambda index, light: light * (NEAR if index == CROSSES else 1.0),
    "flash at first": lambda index, light: light * (4.0 if index == 0 else 1.0),
    "black end": lambda index, light: light * (index < FRAMES - 6),
    "fade in": lambda index, light: light * min(1.0, index / 10),
    "fade out": lambda index, light: light * min(1.0, (FRAMES - 1 - index) / 24),
    "black on it": lambda index, light: light * (abs(index - CROSSES) > 1),
    "cut": lambda index, light: light if index < 45 else light[::-1, ::-1],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shot")
    shots.cube_glb(folder / "anim.glb", start=(0.0, 0.0, -2.2), size=0.4)
    shots.fit_json(folder / "fit.json")
    return folder


def pictures(kind):
    plate = SRGB.to_linear(shots.plate() / 255.0)
    card = SRGB.to_linear(takes.texture((150, 40), 3))
    for index in range(FRAMES):
        light, left = plate.copy(), 8 * index
        shown = light[100:250, left : left + 40]
        shown[:] = 0.3 * card[:, : shown.shape[1]]
        grain = np.random.default_rng(index).normal(0.0, 0.004, light.shape)
        seen = np.clip(KINDS[kind](index, light), 0.0, 1.0)
        yield np.clip(SRGB.to_coded(seen) + grain * (seen.max() > 0.0), 0.0, 1.0)


def changed(folder, kind):
    """Where (h, w) the object changes each frame, and what the run printed."""
    plate, out = folder / f"{kind}.mp4", folder / f"{kind}.mkv"
    size = (shots.WIDTH, shots.HEIGHT)
    takes.encode(plate, pictures(kind), size=size, crf=12, audio=False)
    run = nlens(
        plate, folder / "anim.glb", out, "--preset", "realtime", "--fit", folder / "fit.json",
        "--codec", "ffv1", "-v",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "Warning" not in run.stderr
    before, after = (
        [one[0].astype(int) for _, one in shots.read_planes(of)] for of in (plate, out)
    )
    return [np.abs(one - two) > 12 for one, two in zip(before, after, strict=True)], run.stderr


@pytest.fixture(scope="module")
def whole(folder):
    """Where (h, w) the object is, and the card before it on the middle frame."""
    frames, told = changed(folder, "plain")
    assert "effect occlusion on" in told
    assert_hidden(frames, frames[5], range(CROSSES - 3, CROSSES + 4))
    return frames[5]


def assert_hidden(frames, whole, numbers):
    """The object shows beside the card, and not through it."""
    columns = np.arange(shots.WIDTH)
    for number in numbers:
        left = 8 * number
        within = whole & (columns > left + 4) & (columns < left + 35)
        beside = whole & ((columns < left - 4) | (columns > left + 44))
        within[:105], beside[:105] = False, False
        assert frames[number][within].mean() < 0.1, number
        assert frames[number][beside].mean() > 0.4, number


@pytest.mark.parametrize(
    "kind",
    [
        "flash", "flash at first", "black end", "fade in", "fade out", "flash on it",
        "near flash on it", "black on it",
    ],
)  # fmt: skip
def test_what_crosses_hides_the_object(folder, whole, kind):
    frames, told = changed(folder, kind)
    assert "effect occlusion on" in told
    around = range(CROSSES - 3, CROSSES + 4)
    black = [number for number in around if not np.any(KINDS[kind](number, 1.0))]
    assert_hidden(frames, whole, [number for number in around if number not in black])
    assert not any(frames[number].any() for number in black)


def test_a_cut_to_another_picture_is_said_to_change_most_of_it(folder):
    _, told = changed(folder, "cut")
    assert "effect occlusion off: the camera moves, or most of the picture changes" in told
