"""CONTRIBUTING.md: its examples run as they stand, beside the package's own modules."""

import json
import re
import subprocess
import sys

import pytest
from support import shots
from support.folders import ROOT

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^`(nlens_video/\S+\.py)`:\n\n```python\n(.*?)^```", PAGE, re.M | re.S))
(NODES,) = re.findall(r"^```toml\n(nodes = .*?)^```", PAGE, re.M | re.S)
OURS = "lint.isort.known-first-party = ['nlens_video']"  # files that are not there yet
RUN = """
import sys
import nlens_video.effects, nlens_video.graph.nodes
for package in (nlens_video.effects, nlens_video.graph.nodes):
    package.__path__.append(sys.argv[1] + "/" + package.__name__.replace(".", "/"))
from nlens_video.cli.main import main
sys.exit(main(sys.argv[2:]))
"""

OPTION = """
import sys
import nlens_video.core, nlens_video.options
for package in (nlens_video.core, nlens_video.options):
    package.__path__.insert(0, sys.argv[1] + "/" + package.__name__.partition(".")[2])
from nlens_video.options.parser import parser_of
from nlens_video.options.to_settings import settings
words = parser_of("render").parse_args(["in.mp4", "anim.glb", "out.mp4", "--gop", "12"])
words.command = "render"
assert settings(words).output.group == 12
print(parser_of("render").format_help())
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of the page, and a shot whose plate has lifted blacks."""
    folder = tmp_path_factory.mktemp("contributing")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    shots.write_png(folder / "plate.png", (0.8 * shots.plate() + 51).astype("uint8"))
    shots.cube_glb(folder / "anim.glb")
    shots.fit_json(folder / "fit.json")
    return folder


def nlens(folder, *words):
    command = [sys.executable, "-c", RUN, str(folder), *map(str, words)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def nodes_of_the_run(folder, pipeline, out):
    """Render the shot, and name the nodes that ran."""
    path = folder / f"{out}.toml"
    path.write_text(pipeline)
    run = nlens(
        folder, "plate.png", "anim.glb", f"{out}.png", "--fit", "fit.json", "--preset", path,
        "--timings", f"{out}.json",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return json.loads((folder / f"{out}.json").read_text())["frames"][0]["nodes"]


def without(pipeline, node):
    return re.sub(rf".*{node}.*\n", "", pipeline)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_contributing_guides_example_node_changes_the_object(folder):
    assert "warmth" in nodes_of_the_run(folder, NODES, "warm")
    assert "warmth" not in nodes_of_the_run(folder, without(NODES, "warmth"), "plain")
    assert (folder / "warm.png").read_bytes() != (folder / "plain.png").read_bytes()


@pytest.mark.slow
@pytest.mark.needs_gl
def test_contributing_guides_example_effect_is_measured_planned_and_applied(folder):
    pipeline = NODES.replace('{ node = "warmth", gain = 1.3 }', '"veiling-glare"')
    assert pipeline != NODES
    assert "veiling-glare" in nodes_of_the_run(folder, pipeline, "veiled")
    plain = nodes_of_the_run(folder, without(NODES, "warmth"), "unveiled")
    assert "veiling-glare" not in plain
    assert (folder / "veiled.png").read_bytes() != (folder / "unveiled.png").read_bytes()
    plan = nlens(
        folder, "plate.png", "anim.glb", "out.png", "--plan", "-v", "--fit", "fit.json",
        "--preset", "veiled.toml", "--effects", "auto,-veiling-glare",
    )  # fmt: skip
    assert plan.returncode == 0 and "veiling-glare" in plan.stdout + plan.stderr


def test_contributing_guides_example_option_reaches_the_settings(tmp_path):
    field, row = re.findall(r"^```text\n(    .*?)^```", PAGE, re.M | re.S)
    changes = {
        "core/settings.py": ("    pix_fmt: str | None = None\n", field),
        "options/run_rows.py": ('feeds="output.pix_fmt"),\n', row),
    }
    for name, (above, lines) in changes.items():
        text = (ROOT / "nlens_video" / name).read_text(encoding="utf-8")
        assert text.count(above) == 1
        path = tmp_path / name
        path.parent.mkdir()
        path.write_text(text.replace(above, above + lines), encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-c", OPTION, tmp_path], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert "frames from key frame to key frame" in run.stdout


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("words", [["check"], ["format", "--check"]], ids=["check", "format"])
def test_contributing_guides_examples_pass_the_linter(name, words):
    run = subprocess.run(
        [sys.executable, "-m", "ruff", *words, "--stdin-filename", name, "--config", OURS, "-"],
        cwd=ROOT, input=FILES[name], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout


def test_github_workflow_runs_the_ci_script_and_builds_the_wheel():
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    commands = re.findall(r"^ +- run: (.*)$", workflow, re.M)
    assert ".ci/run" in commands and "python -m build" in commands
    assert "make test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
