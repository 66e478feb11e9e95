"""Nodes are found by name."""

import pytest

from nlens_video.graph.node_registry import NODES
from nlens_video.graph.pipeline_file import load_pipeline, shipped_pipelines


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
