"""The graphs of the rungs below a preset, made from the same tools as its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from nlens_video.core.errors import UsageError
from nlens_video.effects.planner import Decision
from nlens_video.graph.builder import build
from nlens_video.graph.executor import FrameSteps
from nlens_video.graph.held import HeldBudget
from nlens_video.graph.node import Node
from nlens_video.graph.nodes.context import Tools
from nlens_video.graph.pipeline_file import NodeSpec, load_pipeline
from nlens_video.graph.quality_control import LADDER, BudgetControl


def check_rung(preset: str) -> None:
    """See that a preset has rungs to step along.

    Raises:
        UsageError: it is none of the ladder's, or the lowest.
    """
    if preset not in LADDER[:-1]:
        raise UsageError(
            f"--hold-budget with --preset {preset}: quality steps down from one of "
            f"{', '.join(LADDER[:-1])}; choose one of them"
        )


def held_budget(
    steps: FrameSteps, decisions: Sequence[Decision], tools: Tools, *, budget_ms: float,
    frame_s: float,
) -> HeldBudget:  # fmt: skip
    """Build the rungs from that of `steps` downwards.

    Args:
        steps: with the best rung's graph.
        decisions: which effects are simulated, where a rung has them at all.
        tools: those of the best rung.
        budget_ms: what a frame may cost [ms].
        frame_s: from one frame to the next [s].
    """
    best = steps.graph
    names = LADDER[LADDER.index(best.pipeline) :]
    specs = {spec.name: spec for spec in load_pipeline(best.pipeline).nodes}
    shared = [(specs[node.name], node) for node in best.nodes]
    graphs = {best.pipeline: best}
    for name in names[1:]:
        pipeline = load_pipeline(name)
        graph = build(pipeline, decisions, tools, fit_given=not best.has("fit"))
        own = {spec.name: spec for spec in pipeline.nodes}
        nodes = tuple(_known(own[node.name], node, shared) for node in graph.nodes)
        shared += [(own[node.name], node) for node in nodes]
        graphs[name] = replace(graph, nodes=nodes)
    return HeldBudget(steps, graphs, BudgetControl(budget_ms, names, frame_s))


def _known(spec: NodeSpec, node: Node, shared: Sequence[tuple[NodeSpec, Node]]) -> Node:
    """The node with the stage of a better rung that does the same: a frame of both runs it once."""
    for other, known in shared:
        if (other.stage, other.options) == (spec.stage, spec.options):
            return replace(node, run=known.run)
    return node
