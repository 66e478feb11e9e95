"""Folders and files without permissions are refused in one line before the run."""

import os

import pytest
from support import shots
from support.command import nlens, one_line
from support.rights import ordinary

pytestmark = [pytest.mark.needs_gl, pytest.mark.needs_programs("setpriv")]


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    return shots.write_shot(tmp_path_factory.mktemp("shot"), 3)


@pytest.fixture
def closed(tmp_path):
    """A folder in which nothing can be made."""
    folder = tmp_path / "closed"
    folder.mkdir()
    folder.chmod(0o555)
    yield folder
    folder.chmod(0o755)
    assert not list(folder.iterdir())


def commands(shot, closed, free):
    """Every command that writes, into a folder that is closed to it."""
    plate, glb = shot / "plate.png", shot / "anim.glb"
    run = ["render", plate, glb, free / "o.png"]
    return {
        "render": ["render", plate, glb, closed / "o.png"],
        "render --report": [*run, "--report", closed / "r"],
        "render --aov": [*run, "--aov", closed],
        "render --timings": [*run, "--timings", closed / "t.json"],
        "render --save-fit": [*run, "--save-fit", closed / "f.json"],
        "render --resume": ["render", shot / "in.mp4", glb, closed / "o.mp4", "--resume"],
        "render --as-chunk": [
            "render", shot / "in.mp4", glb, closed / "c", "--as-chunk", "--fit", shot / "fit.json",
        ],
        "fit": ["fit", plate, glb, closed / "f.json"],
        "place": ["place", plate, glb, closed / "s.png"],
        "check": ["check", plate, "--against", plate, "--report", closed / "r"],
        "bench": ["bench", "--quick", "--out", closed / "b"],
        "study make": ["study", "make", "--demo", closed / "s.html"],
    }  # fmt: skip


def test_unwritable_folder_is_refused_in_one_line_before_the_run(shot, tmp_path, closed):
    lines = commands(shot, closed, tmp_path)
    for command, run in zip(lines, ordinary(*lines.values()), strict=True):
        line = one_line(run, 6)
        assert "cannot be written to" in line or "cannot be made" in line, command
    assert [path.name for path in tmp_path.iterdir()] == ["closed"]


def test_unreadable_file_is_refused_in_one_line(shot, tmp_path):
    lines = []
    for hidden in ("plate.png", "anim.glb", "fit.json"):
        folder = tmp_path / hidden
        folder.mkdir()
        for name in ("plate.png", "anim.glb", "fit.json"):
            (folder / name).write_bytes((shot / name).read_bytes())
        (folder / hidden).chmod(0o000)
        plate, glb, out = folder / "plate.png", folder / "anim.glb", folder / "o.png"
        lines.append([plate, glb, out, "--fit", folder / "fit.json"])
    for run, code in zip(ordinary(*lines), (3, 4, 5), strict=True):
        assert "Permission denied" in one_line(run, code)
    assert not list(tmp_path.rglob("o.png"))


def test_folder_that_may_not_be_entered_is_told_in_one_line(shot, tmp_path):
    shut = tmp_path / "shut"
    shut.mkdir()
    plate, glb, run = shot / "in.mp4", shot / "anim.glb", ["--fit", shot / "fit.json"]
    reads = [
        [shut / "in.mp4", glb, tmp_path / "o.mp4", *run],
        [shut / "in_%04d.png", glb, tmp_path / "o.mp4", *run],
        [plate, shut / "anim.glb", tmp_path / "o.mp4", *run],
        [plate, glb, tmp_path / "o.mp4", *run, "--holdout", shut / "matte.png"],
        [plate, glb, tmp_path / "o.mp4", *run, "--camera-from", shut / "camera.json"],
        ["fit", shut / "in.mp4", glb, tmp_path / "f.json"],
        ["solve", shut / "in.mp4", tmp_path / "c.json"],
        ["check", shut / "in.mp4", "--plate", plate],
        ["farm", shut / "in.mp4", glb, tmp_path / "o.mp4"],
    ]
    writes = commands(shot, shut, tmp_path)
    shut.chmod(0o000)
    told = ordinary(*reads, *writes.values())
    shut.chmod(0o755)
    for one in told[: len(reads)]:
        assert one_line(one, 4 if "anim.glb" in one.stderr else 3)
    for command, one in zip(writes, told[len(reads) :], strict=True):
        assert one_line(one, 6), command
    assert not list(shut.iterdir()) and not list(tmp_path.glob("o.*"))


def test_files_in_a_read_only_folder_can_be_used(shot, tmp_path):
    folder = tmp_path / "footage"
    folder.mkdir()
    for name in ("in.mp4", "anim.glb", "fit.json"):
        (folder / name).write_bytes((shot / name).read_bytes())
        (folder / name).chmod(0o444)
    folder.chmod(0o555)
    (tmp_path / "work").mkdir()
    words = [folder / "in.mp4", folder / "anim.glb", "o.mp4", "--fit", folder / "fit.json"]
    (run,) = ordinary(words, cwd=tmp_path / "work")
    folder.chmod(0o755)
    assert run.returncode == 0, run.stderr
    assert os.access(tmp_path / "work" / "o.mp4", os.W_OK)  # the plate's protection is not its own


@pytest.mark.skipif(os.geteuid() != 0, reason="gives a file to another user, as root may")
def test_file_of_another_user_is_kept_unless_overwriting_is_requested(shot, tmp_path):
    out = tmp_path / "o.png"
    out.write_text("theirs")
    os.chown(out, 12345, 23456)
    out.chmod(0o644)
    words = [shot / "plate.png", shot / "anim.glb", out, "--fit", shot / "fit.json"]
    refused, done = ordinary(words, [*words, "-y"])
    assert "is write-protected; give -y" in one_line(refused, 6)
    assert done.returncode == 0, done.stderr
    assert out.read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize("command", [["farm"], ["--resume"]])
def test_chunks_of_standard_input_are_refused_before_a_folder_is_made(shot, tmp_path, command):
    words = ["-", shot / "anim.glb", tmp_path / "o.mp4", "--fit", shot / "fit.json"]
    run = nlens(*command, *words) if command == ["farm"] else nlens(*words, *command)
    assert "chunks are made of a file or a sequence" in one_line(run, 2)
    assert not list(tmp_path.iterdir())
