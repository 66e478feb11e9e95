"""From a pipeline file and the run's tools to a graph of ready nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from nlens_video.effects.planner import Decision
from nlens_video.graph.node import LaneName, Node
from nlens_video.graph.nodes.context import Tools, Unavailable
from nlens_video.graph.nodes.registry import check_ports, make_stage
from nlens_video.graph.pipeline_file import PipelineFile


@dataclass(frozen=True, slots=True, kw_only=True)
class Graph:
    """The nodes of a run, in order.

    Attributes:
        pipeline: name of the pipeline file.
        summary: what it does.
        nodes: those that were built.
        left_out: name of each node that was not, and why.
        notes: what stands in for something better, and why.
    """

    pipeline: str
    summary: str
    nodes: tuple[Node, ...]
    left_out: tuple[tuple[str, str], ...]
    notes: tuple[str, ...] = ()

    def has(self, stage: str) -> bool:
        """Whether a node of that stage was built."""
        return any(node.stage == stage for node in self.nodes)

    @property
    def remembering(self) -> tuple[Node, ...]:
        """The nodes that must see every frame of the source."""
        return tuple(node for node in self.nodes if node.remembers)

    def lane(self, name: LaneName) -> tuple[Node, ...]:
        """The nodes of one lane."""
        return tuple(node for node in self.nodes if node.lane == name)


def build(
    pipeline: PipelineFile, effects: Sequence[Decision], tools: Tools, *, fit_given: bool
) -> Graph:
    """Make the nodes that this run calls for.

    Args:
        pipeline: the file.
        effects: which effects are simulated.
        tools: what stages are made from.
        fit_given: whether the lens is known already; then nothing that finds it is built.

    Raises:
        UsageError: a stage or option that does not exist.
    """
    unwanted = {decision.effect: decision.reason for decision in effects if not decision.wanted}
    nodes: list[Node] = []
    left_out: list[tuple[str, str]] = []
    missing: dict[str, str] = {}
    notes: dict[str, None] = {}
    for spec in pipeline.nodes:
        if spec.effect in unwanted:
            left_out.append((spec.name, f"{spec.effect}: {unwanted[spec.effect]}"))
        elif fit_given and spec.cadence == "shot":
            left_out.append((spec.name, "the lens fit is given"))
        elif spec.unless is not None and spec.unless not in missing:
            left_out.append((spec.name, f"not needed: {spec.unless} runs"))
        else:
            optional = tuple(f"{port}?" for port in spec.optional)
            check_ports(spec.name, spec.stage, (*spec.inputs, *optional), spec.output)
            try:
                made = make_stage(spec.stage, spec.options, tools)
            except Unavailable as reason:
                left_out.append((spec.name, str(reason)))
                missing[spec.name] = str(reason)
                continue
            if spec.unless is not None:
                notes[missing[spec.unless]] = None
            nodes.append(
                Node(
                    name=spec.name, stage=spec.stage, inputs=spec.inputs, optional=spec.optional,
                    output=spec.output, cadence=spec.cadence, lane=spec.lane, effect=spec.effect,
                    when=spec.when, without=spec.without, backend=made.backend, run=made.run,
                    remembers=made.remembers,
                )
            )  # fmt: skip
    return Graph(
        pipeline=pipeline.name,
        summary=pipeline.summary,
        nodes=tuple(nodes),
        left_out=tuple(left_out),
        notes=tuple(notes),
    )
