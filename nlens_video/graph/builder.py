"""Builds the graph of a run from a pipeline file and the nodes' dependencies."""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass

from nlens_video.effects.planner import Decision
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.base.node import Lane, Node, Unavailable
from nlens_video.graph.pipeline_file import NodeSpec, PipelineFile

Built = MutableMapping[tuple[str, str], Node]
"""Nodes by name and options, which graphs of one run share."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Graph:
    """The nodes of a run, in order.

    Attributes:
        pipeline: name of the pipeline file.
        summary: what it does.
        nodes: those that were built.
        left_out: name of each node that was not, and why.
        notes: fallbacks in use, and why.
    """

    pipeline: str
    summary: str
    nodes: tuple[Node, ...]
    left_out: tuple[tuple[str, str], ...]
    notes: tuple[str, ...] = ()

    def has(self, name: str) -> bool:
        """Whether a node of that name was built."""
        return any(node.name == name for node in self.nodes)

    @property
    def stateful(self) -> tuple[Node, ...]:
        """Nodes whose result depends on all earlier frames."""
        return tuple(node for node in self.nodes if node.stateful)

    @property
    def find_lens(self) -> tuple[Node, ...]:
        """The nodes that find the lens, and the object's bounds before them."""
        return tuple(node for node in self.nodes if node.once or node.writes == "bounds")

    def lane(self, name: Lane) -> tuple[Node, ...]:
        """The nodes of one lane."""
        return tuple(node for node in self.nodes if node.lane == name)


def build(
    pipeline: PipelineFile,
    effects: Sequence[Decision],
    context: NodeContext,
    *,
    fit_given: bool,
    built: Built | None = None,
) -> Graph:
    """Construct the nodes of the effects that are simulated.

    Args:
        pipeline: the file.
        effects: which effects are simulated.
        context: dependencies of the nodes.
        fit_given: whether the lens is known already; then nothing that finds it is built.
        built: nodes of other graphs of the run, shared where name and options are the same;
            extended by new ones.

    Raises:
        UsageError: an option that a node cannot take.
    """
    built = {} if built is None else built
    unwanted = {decision.effect: decision.reason for decision in effects if not decision.wanted}
    nodes: list[Node] = []
    left_out: list[tuple[str, str]] = []
    missing: dict[str, str] = {}
    notes: dict[str, None] = dict.fromkeys(pipeline.notes)
    for spec in pipeline.nodes:
        effect = spec.type.effect
        if effect is not None and effect in unwanted:
            left_out.append((spec.name, f"{effect}: {unwanted[effect]}"))
        elif fit_given and spec.type.once:
            left_out.append((spec.name, "the lens fit is given"))
        elif spec.fallback_for is not None and spec.fallback_for not in missing:
            left_out.append((spec.name, f"not needed: {spec.fallback_for} runs"))
        else:
            try:
                nodes.append(_node(spec, context, built))
            except Unavailable as reason:
                left_out.append((spec.name, str(reason)))
                missing[spec.name] = str(reason)
                continue
            if spec.fallback_for is not None:
                notes[missing[spec.fallback_for]] = None
    return Graph(
        pipeline=pipeline.name,
        summary=pipeline.summary,
        nodes=tuple(nodes),
        left_out=tuple(left_out),
        notes=tuple(notes),
    )


def _node(spec: NodeSpec, context: NodeContext, built: Built) -> Node:
    key = (spec.name, repr(sorted(spec.options.items())))
    if key not in built:
        make: type[Node] = spec.type
        built[key] = make(context, **spec.options)  # type: ignore[call-arg]  # each class its own
    return built[key]
