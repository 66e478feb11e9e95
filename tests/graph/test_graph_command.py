"""`nlens-video graph`: a pipeline's frame graph as text."""

import pytest
from support.command import nlens, one_line

from nlens_video.graph.pipeline_file import shipped_pipelines

FORMER = "".join(
    f'[[node]]\nname = "{name}"\nstage = "{name}"\ninputs = []\noutput = "any"\n'
    for name in ("locate", "render", "sharp", "composite")
)


@pytest.mark.parametrize("preset", shipped_pipelines())
def test_graph_command_prints_every_preset_as_mermaid_and_dot(preset):
    mermaid, dot = nlens("graph", preset), nlens("graph", preset, "--dot")
    assert mermaid.returncode == dot.returncode == 0
    assert "flowchart TD" in mermaid.stdout and "reblur" in mermaid.stdout
    assert dot.stdout.startswith(f'digraph "{preset}" {{') and dot.stdout.rstrip().endswith("}")
    assert mermaid.stderr == dot.stderr == ""


def test_graph_command_prints_a_pipeline_file(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(shipped_pipelines()["draft"].read_text())
    assert (
        nlens("graph", own).stdout.splitlines()[1:]
        == (nlens("graph", "draft").stdout.splitlines()[1:])
    )


def test_invalid_pipeline_is_refused_in_one_line(tmp_path):
    assert "'fast' is not one of" in one_line(nlens("graph", "fast"), 2)
    (tmp_path / "own.toml").write_text("nodes = 3\n")
    assert "no list 'nodes'" in one_line(nlens("graph", tmp_path / "own.toml"), 2)


def test_pipeline_file_in_the_old_format_is_printed_with_a_note(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(FORMER)
    run = nlens("graph", own)
    assert run.returncode == 0 and "object_bounds" in run.stdout, run.stderr
    assert (
        run.stderr
        == f"note   {own}: has the form before 1.0, which the next release no longer reads\n"
    )
