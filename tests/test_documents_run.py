"""Each command that users are shown runs as it stands there, or is named here with why not."""

import contextlib
import io
import re
import shlex
import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest
from support import shots
from support.documents import PAGES, ROOT, commands
from support.glb_builder import GlbBuilder

from nlens_video.cli.main import main

OTHER_PROGRAMS = (
    "make ",
    "sudo apt-get install ",
    "pip install ",
    "pipx install ",
    "cp samples/",
    "python docs/",
)
IN_A_SHELL = "tests/end_to_end/test_documents_in_a_shell.py"
ELSEWHERE = {
    " | ": IN_A_SHELL,
    "/dev/video": IN_A_SHELL,
    "! nlens glb=": "tests/adapters/test_gstreamer.py",
    "gst-inspect-1.0 nlens": "tests/adapters/test_gstreamer.py",
    "python -m nlens_video.adapters.gstreamer_install": "tests/adapters/test_gstreamer.py",
    "nlens-video farm": "tests/farm",
    "nlens-video merge": IN_A_SHELL,
    "nlens-video studio": "tests/studio; it serves until it is interrupted",
    "nlens-video study make --demo": "tests/evaluate; it renders for minutes",
    "nlens-video study make PICTURES": IN_A_SHELL,
    "nlens-video study analyse": IN_A_SHELL,
    "--marker 0.2m": "tests/cli/test_solve_scale.py, whose plate shows a marker",
}
HERE = {
    page.relative_to(ROOT).as_posix(): [
        line
        for line in commands([page])
        if not line.startswith(OTHER_PROGRAMS) and not any(part in line for part in ELSEWHERE)
    ]
    for page in PAGES
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files that the pages speak of."""
    folder = tmp_path_factory.mktemp("reader")
    shots.write_video(folder / "in.mp4", frames=14)
    shots.cube_glb(folder / "anim.glb", end=(0.1, 0.0, -1.6))
    shots.cube_glb(folder / "object.glb", start=(0.0, 0.0, -4.0), camera=False)
    shots.fit_json(folder / "fit.json")
    for number in range(14):
        matte = np.zeros((shots.HEIGHT, shots.WIDTH), np.uint8)
        matte[:, : shots.WIDTH // 2] = 255
        cv2.imwrite(str(folder / f"roto.{number:04d}.png"), matte)
    fox = GlbBuilder()
    node = fox.node(mesh=fox.mesh(shots.CUBE, shots.CUBE_FACES))
    keys = np.array([[0, 0, 0], [0.1, 0, 0]], np.float32)
    fox.animation((node, "translation", [0.0, 0.2], keys, "LINEAR"), name="Run")
    fox.write(folder / "fox.glb")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert main([str(folder / name) for name in ("in.mp4", "anim.glb", "out.mp4")]) == 0
    return folder


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("page", [page for page, lines in HERE.items() if lines])
def test_documented_commands_of_a_page_run_as_written(page, folder, tmp_path, monkeypatch):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    for command in HERE[page]:  # later ones read what earlier ones wrote
        program, *words = shlex.split(command)
        assert program == "nlens-video", f"{command}: run it here, or say in ELSEWHERE why not"
        told = io.StringIO()
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
            code = main(words)
        assert code == 0, f"{command}\n{told.getvalue()}"


def test_every_exception_from_running_commands_is_needed():
    shown = "\n".join(commands())
    assert [part for part in ELSEWHERE if part not in shown] == []


def test_make_targets_extras_and_scripts_named_in_documents_exist():
    makefile = (ROOT / "Makefile").read_text()
    project = (ROOT / "pyproject.toml").read_text()
    text = "\n".join(page.read_text() for page in PAGES)
    targets = set(re.findall(r"(?:^|`)make (\w+)", text, re.M))
    assert targets and all(re.search(rf"^{name}:", makefile, re.M) for name in targets)
    extras = set(re.findall(r"nlens-video\[(\w+)\]", text))
    assert extras and all(re.search(rf"^{name} = \[", project, re.M) for name in extras)
    scripts = set(re.findall(r"`python (docs/\w+\.py)", text))
    assert scripts and all((ROOT / script).exists() for script in scripts)


def test_make_targets_of_the_head_run_though_a_file_has_their_name():
    makefile = (ROOT / "Makefile").read_text()
    head = set(re.findall(r"^# make (\w+)", makefile, re.M))
    (phony,) = re.findall(r"^\.PHONY: (.*)$", makefile, re.M)
    assert head and head <= set(phony.split())


def test_make_clean_removes_every_environment_that_targets_make():
    makefile = (ROOT / "Makefile").read_text()
    cleaned = re.search(r"^clean:\n\t(.*)$", makefile, re.M)[1].split()
    made = set(re.findall(r"-m venv (\.venv-\w+)", makefile))
    assert made and made | {"$(VENV)", "tests/studio/node_modules"} <= set(cleaned)


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("page", ["README.md", "docs/python.md", "docs/adapters.md"])
def test_documented_python_example_runs_on_an_opencv_capture(page, folder, monkeypatch):
    monkeypatch.chdir(folder)
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.M | re.S)
    assert blocks
    for block in blocks:
        seen = []
        capture = cv2.VideoCapture("in.mp4")
        with contextlib.redirect_stdout(io.StringIO()):
            exec(block, {"capture": capture, "show": seen.append})
        assert len(seen) == 14 and all(frame.shape == seen[0].shape for frame in seen)


PRELUDE = """from typing import Any

import cv2

capture: Any = cv2.VideoCapture("in.mp4")


def show(frame: object) -> None: ...
"""


@pytest.mark.slow
def test_documented_python_examples_have_the_right_types(tmp_path):
    for page in ("README.md", "docs/python.md", "docs/adapters.md"):
        blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.M | re.S)
        for number, block in enumerate(blocks):
            name = re.sub(r"\W", "_", page).lower()
            (tmp_path / f"{name}_{number}.py").write_text(f"{PRELUDE}\n\n{block}")
    run = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", *sorted(tmp_path.glob("*.py"))], cwd=ROOT,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout


@pytest.mark.slow
def test_documentation_site_builds_without_warnings(tmp_path):
    run = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    pages = {path.stem for path in (tmp_path / "site").glob("*.html")}
    assert {
        "index",
        "tutorial",
        "python",
        "architecture",
        "contributing",
        "how-the-lens-is-found",
    } <= pages
    python = (tmp_path / "site" / "python.html").read_text()
    assert "process_av" in python and "shutter_deg" in python
    words = "".join(re.sub("<[^>]+>", "", python).split())
    assert "LensFit(*,slope:float,intercept:float,slope_stderr:float=0.0," in words  # a struct's
