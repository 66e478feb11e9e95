"""A pipeline's frame graph as a diagram: Mermaid for documents, DOT for Graphviz."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from nlens_video.graph.base.node import LANES, Lane
from nlens_video.graph.pipeline_file import NodeSpec, PipelineFile

PLATE = "plate"
"""Name of the source's frame in the diagram."""
_UNDRAWN = ("frame", "frame_box", "following", "lens_before", "frames_fitted")  # no edges


class Edge(Struct, frozen=True):
    """A value that flows from one node to another.

    Attributes:
        source: name of the node that writes it, or `PLATE`.
        target: name of the node that takes it.
        port: the value.
        optional: whether the target runs without it.
    """

    source: str
    target: str
    port: str
    optional: bool


def edges(pipeline: PipelineFile) -> Iterator[Edge]:
    """The edges, in the nodes' order.

    Operations on a value form a chain: each reads it from the last one above. Alternatives, which
    write a value without reading it, all lead to its next reader.
    """
    writers: dict[str, list[str]] = {"picture": [PLATE]}
    changed: set[str] = set()
    for spec in pipeline.nodes:
        for port in spec.type.inputs():
            if port.name not in _UNDRAWN:
                for source in writers.get(port.name, []):
                    yield Edge(source, spec.name, port.name, port.optional)
        written = "fit" if spec.type.writes == "found_lens" else spec.type.writes
        if spec.type.is_operation():
            writers[written] = [spec.name]
            changed.add(written)
        elif written in changed:
            writers[written] = [spec.name]
        else:
            writers.setdefault(written, []).append(spec.name)


def mermaid(pipeline: PipelineFile) -> str:
    """The diagram as a Mermaid flowchart."""
    lines = [f"%% {pipeline.name}: {pipeline.summary}", "flowchart TD", f"    {PLATE}([{PLATE}])"]
    for lane in LANES:
        lines.append(f'    subgraph {lane}_lane ["{lane} lane"]')
        lines += [f"        {_box(spec)}" for spec in _of_lane(pipeline, lane)]
        lines.append("    end")
    for edge in edges(pipeline):
        arrow = "-.->" if edge.optional else "-->"
        lines.append(f"    {_id(edge.source)} {arrow}|{edge.port}| {_id(edge.target)}")
    return "\n".join(lines) + "\n"


def dot(pipeline: PipelineFile) -> str:
    """The diagram in Graphviz' language."""
    lines = [
        f'digraph "{pipeline.name}" {{',
        "    node [shape=box, fontname=sans];",
        "    edge [fontname=sans, fontsize=10];",
        f'    "{PLATE}" [shape=ellipse];',
    ]
    for lane in LANES:
        lines.append(f"    subgraph cluster_{lane} {{")
        lines.append(f'        label="{lane} lane";')
        for spec in _of_lane(pipeline, lane):
            style = ", style=dashed" if spec.type.effect else ""
            lines.append(f'        "{spec.name}" [label="{_label(spec)}"{style}];')
        lines.append("    }")
    for edge in edges(pipeline):
        style = ", style=dashed" if edge.optional else ""
        lines.append(f'    "{edge.source}" -> "{edge.target}" [label="{edge.port}"{style}];')
    return "\n".join([*lines, "}"]) + "\n"


def _of_lane(pipeline: PipelineFile, lane: Lane) -> list[NodeSpec]:
    return [spec for spec in pipeline.nodes if spec.type.lane == lane]


def _box(spec: NodeSpec) -> str:
    begin, end = ("([", "])") if spec.type.once else ("[", "]")
    return f"{_id(spec.name)}{begin}{_label(spec)}{end}"


def _id(name: str) -> str:
    """Identifier without hyphens, which Mermaid reads as arrows in places."""
    return name.replace("-", "_")


def _label(spec: NodeSpec) -> str:
    """Name, and the effect that the node belongs to where that says more."""
    effect = spec.type.effect
    return spec.name if effect in (None, spec.name) else f"{spec.name} · {effect}"
