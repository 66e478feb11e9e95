"""Nodes are found by name, and imported as far as pipelines name them."""

import subprocess
import sys

import pytest

from nlens_video.graph.node_registry import NODES
from nlens_video.graph.pipeline_file import load_pipeline, shipped_pipelines

PROBE = """
import sys
from nlens_video.graph.pipeline_file import load_pipeline
load_pipeline(sys.argv[1])
print(*(name for name in sys.modules if name.startswith("nlens_video.effects.")))
"""


@pytest.mark.parametrize(("preset", "casts"), [("realtime", False), ("standard", True)])
def test_a_preset_imports_the_effects_that_its_nodes_simulate(preset, casts):
    found = subprocess.run(
        [sys.executable, "-c", PROBE, preset], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "nlens_video.effects.exposure" in found
    for effect in ("shadow.cast", "camera.grain"):
        assert (f"nlens_video.effects.{effect}" in found) == casts


def test_all_nodes_of_the_shipped_pipelines_have_their_names():
    named = {
        spec.name: spec.type for one in shipped_pipelines() for spec in load_pipeline(one).nodes
    }
    assert named.items() <= dict(NODES).items()
    assert len(NODES) == len(set(NODES.values()))


def test_an_unknown_name_is_no_node():
    assert "shade" not in NODES
    with pytest.raises(KeyError):
        NODES["shade"]
