"""`--ignore-lines`: a solve without the lines that lead it astray."""

import json

import pytest
from support import shots
from support.command import nlens
from support.grounds import FOV_DEG
from support.misleading_lines import LINES, PITCH_DEG, angles_deg, plate

pytestmark = pytest.mark.slow
IGNORED = ",".join(f"{number:.4f}" for line in LINES for number in line)
BESIDE = "0.9,0.95,0.95,0.95"  # where the plate shows no line
THERE = ",".join(f"{number:.4f}" for number in LINES[3])
CHEAP = ("--effects", "none", "--preset", "draft")


def solved(tmp_path, *words):
    shots.write_png(tmp_path / "in.png", plate())
    camera = tmp_path / "camera.json"
    run = nlens("solve", tmp_path / "in.png", camera, "--fov", FOV_DEG, "-y", *words)
    assert run.returncode == 0, run.stderr
    return angles_deg(camera)


def test_camera_is_solved_without_the_lines_that_are_named(tmp_path):
    assert abs(solved(tmp_path)[0] - PITCH_DEG) > 5.0
    pitch, roll, _ = solved(tmp_path, f"--ignore-lines={IGNORED}")
    assert pitch == pytest.approx(PITCH_DEG, abs=0.5)
    assert roll == pytest.approx(0.0, abs=0.5)


def test_render_and_shot_file_solve_as_the_command_does(tmp_path):
    shots.write_png(tmp_path / "in.png", plate())
    shots.cube_glb(tmp_path / "bare.glb", camera=False, sun=False)
    words = ("--fov", FOV_DEG, f"--ignore-lines={IGNORED}", *CHEAP)
    shot = tmp_path / "shot.toml"
    run = nlens(tmp_path / "in.png", tmp_path / "bare.glb", tmp_path / "one.png", *words, "--json",
                "--save-shot", shot)  # fmt: skip
    assert run.returncode == 0, run.stderr
    first = (tmp_path / "one.png").read_bytes()
    again = nlens(shot, "-y")
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "one.png").read_bytes() == first
    without = [word for word in words if not str(word).startswith("--ignore")]
    other = nlens(tmp_path / "in.png", tmp_path / "bare.glb", tmp_path / "three.png", *without)
    assert other.returncode == 0, other.stderr
    assert first != (tmp_path / "three.png").read_bytes()
    assert json.loads(run.stdout)["output"].endswith("one.png")


@pytest.mark.parametrize(
    ("ignored", "named"),
    [(THERE, None), (BESIDE, BESIDE), (f"{THERE},{BESIDE}", BESIDE),
     (",".join([BESIDE] * 5), f"{BESIDE} or {BESIDE} or {BESIDE} or 2 others")],
)  # fmt: skip
def test_solve_says_once_which_lines_to_ignore_are_not_there(tmp_path, ignored, named):
    shots.write_png(tmp_path / "in.png", plate())
    run = nlens(
        "solve", tmp_path / "in.png", tmp_path / "camera.json", "--fov", FOV_DEG,
        f"--ignore-lines={ignored}",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    told = [line for line in run.stderr.splitlines() if "--ignore-lines" in line]
    assert len(told) == (named is not None)
    assert not told or f"no line of the first frame lies along {named};" in told[0]
    assert "missed" not in json.dumps(json.loads((tmp_path / "camera.json").read_text()))


def test_render_says_that_a_line_to_ignore_is_not_there(tmp_path):
    shots.write_png(tmp_path / "in.png", plate())
    shots.cube_glb(tmp_path / "bare.glb", camera=False, sun=False)
    run = nlens(
        tmp_path / "in.png", tmp_path / "bare.glb", tmp_path / "out.png", "--fov", FOV_DEG,
        *CHEAP, f"--ignore-lines={BESIDE}",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stderr.count(f"no line of the first frame lies along {BESIDE}") == 1
