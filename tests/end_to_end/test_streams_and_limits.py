"""Standard streams that are closed or write few characters, little memory, early signals."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support import shots
from support.command import nlens
from support.terminal import program

from nlens_video.cli.doctor import address_space

pytestmark = pytest.mark.needs_gl


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return shots.write_shot(tmp_path_factory.mktemp("shot"), 3)


def shell(line, *words, environment=None, **options):
    """Run a line of the shell, in which "$@" stands for the command."""
    return subprocess.run(
        ["sh", "-c", line, "sh", *map(str, words)], capture_output=True, check=False,
        timeout=300, env={**os.environ, **(environment or {})}, **options,
    )  # fmt: skip


def quick(files, plate, out, *more):
    return program(
        files / plate, files / "anim.glb", out, "--fit", files / "fit.json", "--preset", "draft",
        "--effects", "none", *more,
    )  # fmt: skip


def test_closed_standard_input_as_plate_is_refused_in_one_line(files, tmp_path):
    run = shell('"$@" <&-', *program("-", files / "anim.glb", tmp_path / "out.mp4"))
    assert run.returncode == 3
    assert run.stderr == (
        b"nlens-video: standard input: it is closed; pipe a stream in or name a file\n"
    )
    assert not list(tmp_path.iterdir())


def test_result_does_not_depend_on_closed_standard_streams(files, tmp_path):
    results = []
    for name, closed in enumerate(("", "<&-", ">&-", "2>&-", "<&- >&- 2>&-")):
        out = tmp_path / f"{name}.png"
        assert shell(f'"$@" {closed}', *quick(files, "plate.png", out)).returncode == 0, closed
        results.append(out.read_bytes())
    assert len(set(results)) == 1


def test_library_messages_do_not_corrupt_files_if_standard_error_is_closed(tmp_path):
    """The first file that is opened would get the number 2, and what is written to it."""
    code = (
        "import os, sys; from nlens_video.core import stdio; stdio.prepare_streams()\n"
        "file = open(sys.argv[1], 'wb'); os.write(2, b'words'); file.write(b'picture')"
    )
    assert shell('"$@" <&- >&- 2>&-', sys.executable, "-c", code, tmp_path / "a").returncode == 0
    assert (tmp_path / "a").read_bytes() == b"picture"


@pytest.mark.parametrize(
    "environment",
    [
        {"PYTHONIOENCODING": "ascii"},
        {"PYTHONIOENCODING": "latin-1"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    ],
    ids=["ascii", "latin-1", "C"],
)
@pytest.mark.parametrize("words", [("render", "--help"), ("place", "--help")])
def test_messages_are_written_in_any_terminal_encoding(environment, words):
    run = shell('"$@"', *program(*words), environment=environment)
    assert run.returncode == 0, run.stderr.decode()
    assert run.stderr == b"" and b"\\u" not in run.stdout
    if words[0] == "render":
        assert b"..." in run.stdout


def test_summary_and_progress_are_written_in_ascii(files, tmp_path):
    fit = tmp_path / "fit.json"
    run = shell(
        '"$@"', *program("fit", files / "plate.png", files / "anim.glb", fit),
        environment={"PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr.decode()
    assert b"+-" in run.stderr and b"\\x" not in run.stderr


def test_file_names_that_are_not_valid_text_are_supported(files, tmp_path):
    folder = os.fsencode(tmp_path)
    plate, out = folder + b"/pl\xff.png", folder + b"/o\xfe.png"
    shutil.copy(os.fsencode(files / "plate.png"), plate)
    command = [os.fsencode(word) for word in quick(files, "plate.png", "out.png")]
    command[3], command[5] = plate, out
    for more in ([], [b"--json"], [b"--report", folder + b"/rep\xfd"]):
        run = subprocess.run([*command, b"-y", *more], capture_output=True, check=False)
        assert run.returncode == 0, run.stderr
        assert b"Traceback" not in run.stderr
        if more == [b"--json"]:
            assert os.fsencode(json.loads(run.stdout)["output"]) == out
        else:
            assert out in run.stderr
    missing = subprocess.run(
        [*command[:3], folder + b"/no\xff.png", *command[4:]], capture_output=True, check=False
    )
    assert missing.returncode == 3 and b"no\xff.png" in missing.stderr


def test_contact_sheet_and_aperture_may_have_names_that_are_not_valid_text(files, tmp_path):
    folder = os.fsencode(tmp_path)
    shots.cube_glb(tmp_path / "bare.glb", camera=False)
    sheet = program("place", files / "plate.png", tmp_path / "bare.glb")
    command = [*map(os.fsencode, sheet), folder + b"/s\xfe.png", b"-q"]
    assert subprocess.run(command, check=False).returncode == 0
    assert Path(os.fsdecode(folder + b"/s\xfe.png")).stat().st_size > 1000
    aperture = folder + b"/tri\xe9.png"
    white = shots.write_png(tmp_path / "a.png", np.full((9, 9, 3), 255, np.uint8))
    white.rename(os.fsdecode(aperture))
    words = ("--fit", files / "fit.json", "--preset", "draft", "--effects", "defocus")
    blurred = program(files / "plate.png", files / "anim.glb", tmp_path / "out.png", *words)
    command = [*map(os.fsencode, blurred), b"--aperture=" + aperture]
    assert subprocess.run(command, check=False).returncode == 0


def test_names_that_are_not_valid_text_are_refused_where_a_format_holds_none(files, tmp_path):
    folder = os.fsencode(tmp_path)
    for name, more, said in (
        (b"/o\xfe.exr", [], b"OpenEXR takes names in UTF-8 alone"),
        (b"/o\xfe.png", [b"--save-shot", folder + b"/s.toml"], b"s.toml: TOML holds UTF-8 alone"),
    ):
        command = [os.fsencode(word) for word in quick(files, "plate.png", "out.png")]
        command[5] = folder + name
        run = subprocess.run([*command, *more], capture_output=True, check=False)
        assert run.returncode == 6 and said in run.stderr
        assert run.stderr.count(b"\n") == 1
    assert not (tmp_path / "s.toml").exists()


def test_current_folder_that_was_deleted_is_told_in_one_line(files, tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    run = shell('cd "$1" && rmdir "$1" && shift && "$@"', gone, *quick(files, "plate.png", "o.png"))
    assert run.returncode == 2
    assert run.stderr == b"nlens-video: the current folder was deleted; change to one that exists\n"


def limited(kind, size):
    return lambda: resource.setrlimit(kind, (size, size))


@pytest.mark.parametrize("gigabytes", [0.6, 1.0, 2.0, address_space() / 2**30 - 0.02])
def test_too_small_address_space_is_reported_before_libraries_abort(files, tmp_path, gigabytes):
    run = subprocess.run(
        quick(files, "plate.png", tmp_path / "out.png"), capture_output=True, text=True,
        check=False, preexec_fn=limited(resource.RLIMIT_AS, int(gigabytes * 2**30)),
    )  # fmt: skip
    assert run.returncode == 1
    assert run.stderr.startswith(
        f"nlens-video: the address space is limited to {gigabytes:.2f} GB, at least "
    )
    assert f"{gigabytes:.2f} GB are needed" not in run.stderr
    assert run.stderr.endswith("are needed; call ulimit -v unlimited before\n")
    assert run.stderr.count("\n") == 1 and not list(tmp_path.iterdir())


def test_run_fits_into_the_required_address_space(files, tmp_path):
    run = subprocess.run(
        program(files / "in.mp4", files / "anim.glb", tmp_path / "out.mp4"), capture_output=True,
        text=True, check=False, preexec_fn=limited(resource.RLIMIT_AS, address_space()),
    )  # fmt: skip
    assert run.returncode == 0, run.stderr


def test_help_runs_with_little_memory():
    run = subprocess.run(
        program("--help"), capture_output=True, text=True, check=False,
        preexec_fn=limited(resource.RLIMIT_AS, 300 << 20),
    )  # fmt: skip
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("loaded", ["nlens_video.core.errors", "nlens_video.options.parser"])
def test_interrupt_during_loading_gives_no_traceback(files, tmp_path, loaded):
    words = ("-", files / "anim.glb", tmp_path / "out.mp4")  # an open pipe: it waits for pictures
    command = [sys.executable, "-X", "importtime", *program(*words)[1:]]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as run:
        for line in run.stderr:
            if line.split("|")[-1].strip() == loaded:
                break
        run.send_signal(signal.SIGINT)
        rest = [line for line in run.stderr if not line.startswith("import time:")]
    assert run.returncode == 130, rest
    assert rest in ([], ["nlens-video: interrupted, no output written\n"])


def test_run_under_nohup_survives_the_terminal(files, tmp_path):
    command = quick(files, "in.mp4", tmp_path / "out.mp4")
    hang_up = "while kill -HUP $pid 2>/dev/null; do sleep 0.05; done"
    line = f'trap "" HUP; "$@" & pid=$!; {hang_up}; wait $pid'
    run = shell(line, *command)
    assert run.returncode == 0, run.stderr.decode()
    assert (tmp_path / "out.mp4").is_file()


def test_summary_lists_disabled_effects_in_one_line_and_the_plan_says_why(files, tmp_path):
    command = (files / "in.mp4", files / "anim.glb", tmp_path / "out.mp4", "--fit",
               files / "fit.json", "--preset", "draft", "-y")  # fmt: skip
    short, long = nlens(*command), nlens(*command, "-v")
    off = [line for line in short.stderr.splitlines() if line.startswith("effect off: ")]
    assert len(off) == 1 and off[0].endswith("(-v says why)")
    assert " off: " not in short.stderr.replace(off[0], "") and "median of each" not in short.stderr
    names = off[0].removeprefix("effect off: ").removesuffix(" (-v says why)").split(", ")
    for name in names:
        assert f"effect {name} off: " in long.stderr
    assert "median of each node" in long.stderr and "effect off: " not in long.stderr
    told = json.loads(nlens(*command, "--json").stdout)["decisions"]
    assert {one["effect"] for one in told if not one["wanted"]} == set(names)

    plan = nlens(*command, "--plan").stdout
    assert all(f"\neffect {name}: no, " in plan for name in names)
    end = r"^left out: \d+ nodes that nothing calls for \(-v gives every reason\)$"
    assert len(re.findall(end, plan, re.MULTILINE)) == 1
    for words in (("--plan", "-v"), ("--plan", "--json")):
        whole = nlens(*command, *words).stdout
        assert f"effect {names[0]}: no, " in whole
        assert "nothing calls for" not in whole
