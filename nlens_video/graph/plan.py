"""The resolved graph in words: what runs, on what, and why."""

from __future__ import annotations

from collections.abc import Iterator

from nlens_video.graph.base.node import Node
from nlens_video.graph.session import Session


def describe(session: Session, *, all_reasons: bool = True) -> Iterator[str]:
    """Lines for a person: pipeline, effects, nodes with backend and condition, warnings.

    Args:
        session: the resolved graph.
        all_reasons: also why the effects are off that are, in place of one line with their names.
    """
    graph = session.graph
    yield f"pipeline {graph.pipeline}: {graph.summary}"
    yield f"device {session.device.name}: {session.device.reason}"
    for decision in session.decisions:
        if decision.wanted or all_reasons:
            word = "yes" if decision.wanted else "no"
            yield f"effect {decision.effect}: {word}, {decision.reason}"
    off = [decision.effect for decision in session.decisions if not decision.wanted]
    if off and not all_reasons:
        yield f"effects off: {', '.join(off)} (-v says why)"
    for node in graph.nodes:
        yield f"node {node.name} [{_when(node)}; lane {node.lane}] {node.description}"
    for name, reason in graph.left_out:
        yield f"left out {name}: {reason}"
    for note in session.notes():
        yield f"note: {note}"


def _when(node: Node) -> str:
    cadence = "once a shot" if node.once else "each frame"
    return cadence if node.when is None else f"{cadence} when {node.when.description}"
