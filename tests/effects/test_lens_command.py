"""Effects of the lens on whole runs of the command."""

import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens, one_line


def run(folder, name, *words):
    """The written picture, or the plan that a run with --plan prints."""
    plate, glb, fit = folder / "in.png", folder / "cube.glb", folder / "fit.json"
    if not plate.exists():
        shots.write_png(plate)
        shots.cube_glb(glb, start=(0.7, 0.0, -2.2), size=0.5)
        shots.fit_json(fit)
    out = folder / f"{name}.png"
    ran = nlens(plate, glb, out, "--fit", fit, *words)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout if "--plan" in words else cv2.imread(str(out)).astype(int)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_vignetting_option_darkens_only_the_object(tmp_path):
    bare = run(tmp_path, "bare", "-q", "--effects", "defocus")
    dark = run(tmp_path, "dark", "-q", "--effects", "defocus,vignetting", "--vignetting", "2")
    plate = cv2.imread(str(tmp_path / "in.png")).astype(int)
    bright = (np.abs(bare - plate).max(axis=2) > 12)[..., None] & (bare > 60)
    assert (dark <= bare + 1).all()
    # a third of a stop or so where the object stands
    assert 0.85 < (dark[bright] / bare[bright]).mean() < 0.95
    touched = cv2.dilate((bare != plate).any(axis=2).astype(np.uint8), np.ones((9, 9))) > 0
    assert 0.01 < touched.mean() < 0.5
    assert np.array_equal(dark[~touched], plate[~touched])


@pytest.mark.needs_gl
def test_barrel_distortion_option_moves_the_object_towards_the_centre(tmp_path):
    plate, places = None, []
    for name, words in (("bare", []), ("bent", ["--distortion", "-0.25"])):
        effects = "defocus,distortion" if words else "defocus"
        picture = run(tmp_path, name, "-q", "--effects", effects, *words)
        plate = cv2.imread(str(tmp_path / "in.png")).astype(int)
        off = np.abs(picture - plate).max(axis=2) > 25
        places.append(np.flatnonzero(off.any(axis=0)).mean())
    middle = shots.WIDTH / 2
    assert middle < places[1] < places[0] - 3


@pytest.mark.needs_gl
def test_requested_effect_without_a_measurement_is_left_out_with_a_reason(tmp_path):
    said = run(tmp_path, "plan", "--effects", "defocus,aberration,bloom", "--plan", "-v")
    assert "left out chromatic-aberration: edges of red and blue against green" in said
    assert "left out bloom: " in said
    bare = run(tmp_path, "bare", "-q", "--effects", "defocus")
    asked = run(tmp_path, "asked", "-q", "--effects", "defocus,aberration,bloom")
    assert np.array_equal(bare, asked)


@pytest.mark.needs_gl
def test_effect_that_is_not_needed_changes_no_bit(tmp_path):
    names = "defocus,shadow"
    bare = run(tmp_path, "bare", "-q", "--effects", names)
    told = run(tmp_path, "told", "-q", "--effects", names, "--vignetting", "1.5")
    assert np.array_equal(bare, told)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--vignetting", "-1"], "from 0 to 8 stops"),
        (["--vignetting", "dark"], "from 0 to 8 stops"),
        (["--distortion", "barrel"], "K1 or K1,K2"),
        (["--distortion", "0.1,0.2,0.3"], "K1 or K1,K2"),
        (["--distortion", "nan"], "K1 or K1,K2"),
        (["--distortion", "-0.9"], "the frame's corners stay empty"),
        (["--effects", "vignetting", "--preset", "draft"], "no node for vignetting"),
    ],
)
def test_invalid_lens_options_are_refused_in_one_line(tmp_path, words, expected):
    shots.write_png(tmp_path / "in.png")
    shots.cube_glb(tmp_path / "cube.glb")
    files = [tmp_path / name for name in ("in.png", "cube.glb", "out.png")]
    assert expected in one_line(nlens(*files, *words), 2)
