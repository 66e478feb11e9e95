"""Every option of every command, once with a valid and once with an invalid value."""

from __future__ import annotations

import cv2
import numpy as np
import OpenEXR
import pytest
from end_to_end.option_rows import PLACED, Row
from end_to_end.option_table import COMMANDS
from support import shots
from support.command import nlens, one_line
from support.folders import ROOT

from nlens_video.options import parser as command_line

pytestmark = pytest.mark.needs_gl


def actions(name):
    """The words of a command by the name that argparse keeps them under, a second by its own."""
    command, _, kind = name.partition(" ")
    parser = command_line.parser_of(command)
    if kind:
        parser = parser._subparsers._group_actions[0].choices[kind]
    found = {}
    for action in parser._actions:
        taken = action.dest in found
        found[action.option_strings[-1].lstrip("-") if taken else action.dest] = action
    return found


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("end_to_end")
    shots.write_png(folder / "in.png")
    shots.write_video(folder / "in.mp4", frames=4)
    shots.cube_glb(folder / "anim.glb", end=(0.1, 0.0, -1.6), name="cube")
    shots.cube_glb(folder / "bare.glb", end=(0.1, 0.0, -1.6), name="cube", camera=False, sun=False)
    shots.camera_json(folder / "camera.json")
    shots.fit_json(folder / "fit.json")
    shots.fit_json(folder / "other.json").write_text('{"slope": 1}')
    sky = np.full((8, 16, 3), 0.5, np.float32)
    assert cv2.imwrite(str(folder / "map.hdr"), sky)
    drawn = np.zeros((shots.HEIGHT, shots.WIDTH, 4), np.float32)
    drawn[100:160, 200:260] = 0.5
    far = np.where(drawn[..., 3] > 0, 2.0, 1e9).astype(np.float32)
    planes = {name: drawn[..., at].copy() for at, name in enumerate("RGBA")}
    OpenEXR.File({}, {**planes, "Z": far}).write(str(folder / "layers.exr"))
    (folder / "folder").mkdir()
    (folder / "text.txt").write_text("hello\n")
    (folder / "empty.file").write_bytes(b"")
    assert nlens(folder / "in.mp4", folder / "anim.glb", folder / "chunks", "--preset", "draft",
                 "--fit", folder / "fit.json", "--as-chunk").returncode == 0  # fmt: skip
    return folder


def command_words(name, dest, value, tmp):
    """The words of a command of which one has a value."""
    command = COMMANDS[name]
    row = command.rows[dest]
    words = [word.format(tmp=tmp) for word in row.words or command.words]
    value = [word.format(tmp=tmp) for word in value]
    if dest in command.places:
        words[command.places[dest]] = value[0]
        return words
    if row.placed:
        words[command.places["glb"]] = "bare.glb"
        words += [word for pair in PLACED.items() for word in pair]
    return [*words, *value]  # the later of two wins


def rows(kind):
    return [
        one
        for name, command in COMMANDS.items()
        for dest, row in command.rows.items()
        for one in kind(name, dest, row)
    ]


def sensible(name, dest, row: Row):
    if not row.elsewhere:
        yield pytest.param(name, dest, id=f"{name} {dest}")


def senseless(name, dest, row: Row):
    if row.nonsense or actions(name)[dest].nargs == 0:
        yield pytest.param(name, dest, id=f"{name} {dest}")


def state(*folders):
    """Every file and what it holds."""
    return {
        path: path.read_bytes() if path.is_file() else None
        for folder in folders
        for path in sorted(folder.rglob("*"))
    }


@pytest.mark.parametrize("command", command_line.COMMANDS)
def test_every_option_in_the_help_has_a_row_in_the_test_table(command):
    names = [name for name in COMMANDS if name.split()[0] == command]
    assert names, f"{command} has no rows"
    for name in names:
        assert set(COMMANDS[name].rows) == set(actions(name)), name


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_a_help_text(name):
    assert [dest for dest, action in actions(name).items() if not action.help] == []


@pytest.mark.parametrize(("name", "dest"), rows(sensible))
def test_valid_option_value_has_its_effect(name, dest, files, tmp_path, monkeypatch):
    monkeypatch.chdir(files)
    row = COMMANDS[name].rows[dest]
    words = command_words(name, dest, row.sense, tmp_path)
    if dest in ("help", "version"):
        with pytest.raises(SystemExit, match="0"):
            nlens(*words)
        return
    run = nlens(*words)
    assert run.returncode == row.code, run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize(("name", "dest"), rows(senseless))
def test_invalid_option_value_is_refused_in_one_line_and_nothing_is_written(
    name, dest, files, tmp_path, monkeypatch
):
    monkeypatch.chdir(files)
    row, action = COMMANDS[name].rows[dest], actions(name)[dest]
    before = state(files, tmp_path)
    for value in row.nonsense or ("value",):
        words = (
            [value] if dest in COMMANDS[name].places else [f"{action.option_strings[-1]}={value}"]
        )
        run = nlens(*command_words(name, dest, words, tmp_path))
        assert run.returncode in row.codes, (value[:40], run.returncode, run.stderr)
        one_line(run, run.returncode)
        assert state(files, tmp_path) == before, value[:40]


def test_tests_named_in_the_option_table_exist():
    named = {row.elsewhere for one in COMMANDS.values() for row in one.rows.values()} - {""}
    assert [path for path in named if not (ROOT / path).is_file()] == []
