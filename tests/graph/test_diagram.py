"""The diagram of a pipeline: every port that is read has a writer above."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from nlens_video.effects.planner import EFFECTS
from nlens_video.graph.base.values import GIVEN
from nlens_video.graph.diagram import PLATE, dot, edges, mermaid
from nlens_video.graph.pipeline_file import load_pipeline, shipped_pipelines

PIPELINES = {name: load_pipeline(name) for name in shipped_pipelines()}


def of_effects(pipeline, effects):
    """The nodes that are built for some effects."""
    kept = [spec for spec in pipeline.nodes if spec.type.effect in (None, *effects)]
    return replace(pipeline, nodes=tuple(kept))


@pytest.mark.parametrize("name", PIPELINES)
def test_every_edge_leads_from_a_ports_writer_to_a_later_reader(name):
    pipeline = PIPELINES[name]
    place = {spec.name: at for at, spec in enumerate(pipeline.nodes)}
    types = {spec.name: spec.type for spec in pipeline.nodes}
    for edge in edges(pipeline):
        assert edge.port in [port.name for port in types[edge.target].inputs()]
        if edge.source != PLATE:
            assert place[edge.source] < place[edge.target], edge
            writes = types[edge.source].writes
            assert edge.port == ("fit" if writes == "found_lens" else writes)


@given(st.sampled_from(sorted(PIPELINES)), st.sets(st.sampled_from(EFFECTS)))
def test_object_reaches_the_picture_for_every_subset_of_effects(name, effects):
    pipeline = of_effects(PIPELINES[name], effects)
    written = {*GIVEN}
    for spec in pipeline.nodes:
        missing = {port.name for port in spec.type.inputs() if not port.optional} - written
        if spec.type.writes == "blurred" and spec.type.is_operation():
            assert "blurred" not in missing, spec.name
        if not missing:
            written.add(spec.type.writes)
    assert {"layer", "blurred"} <= written and not missing


@pytest.mark.parametrize("name", PIPELINES)
def test_port_has_alternative_writers_first_and_then_a_single_chain(name):
    changed = set()
    for spec in PIPELINES[name].nodes:
        if spec.type.is_operation():
            changed.add(spec.type.writes)
        else:
            assert spec.type.writes not in changed, spec.name


@pytest.mark.parametrize("name", PIPELINES)
def test_mermaid_and_dot_hold_every_node_and_edge(name):
    pipeline = PIPELINES[name]
    drawn, graphviz = mermaid(pipeline), dot(pipeline)
    for spec in pipeline.nodes:
        assert spec.name.replace("-", "_") in drawn and f'"{spec.name}"' in graphviz
    count = len(list(edges(pipeline)))
    assert drawn.count("-->|") + drawn.count("-.->|") == count == graphviz.count(" -> ")
