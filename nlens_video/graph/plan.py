"""The resolved graph in words: what runs, on what, and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from nlens_video.graph.base.node import Node
from nlens_video.graph.session import Session


@dataclass(frozen=True, slots=True)
class PlanRow:
    """One line of the plan.

    Attributes:
        subject: what it is about, such as `effect shadow`.
        text: what the plan says of it.
        when: of a node, its cadence and lane; else empty.
    """

    subject: str
    text: str
    when: str = ""

    def __str__(self) -> str:
        return f"{self.subject} [{self.when}] {self.text}" if self.when else (
            f"{self.subject}: {self.text}"
        )  # fmt: skip


def describe(session: Session, *, all_reasons: bool = True) -> Iterator[str]:
    """The plan and the notes of a run as lines of text; arguments as `plan_rows`."""
    yield from map(str, plan_rows(session, all_reasons=all_reasons))
    for note in session.notes():
        yield f"note: {note}"


def plan_rows(session: Session, *, all_reasons: bool = True) -> Iterator[PlanRow]:
    """Pipeline, device, effects, and nodes with backend and condition.

    Args:
        session: the resolved graph.
        all_reasons: also why the effects are off that are, in place of one line with their names.
    """
    graph = session.graph
    yield PlanRow(f"pipeline {graph.pipeline}", graph.summary)
    yield PlanRow(f"device {session.device.name}", session.device.reason)
    for decision in session.decisions:
        if decision.wanted or all_reasons:
            word = "yes" if decision.wanted else "no"
            yield PlanRow(f"effect {decision.effect}", f"{word}, {decision.reason}")
    off = [decision.effect for decision in session.decisions if not decision.wanted]
    if off and not all_reasons:
        yield PlanRow("effects off", f"{', '.join(off)} (-v says why)")
    for node in graph.nodes:
        yield PlanRow(
            f"node {node.name}", node.description, when=f"{_when(node)}; lane {node.lane}"
        )
    for name, reason in graph.left_out:
        yield PlanRow(f"left out {name}", reason)


def _when(node: Node) -> str:
    cadence = "once a shot" if node.once else "each frame"
    return cadence if node.when is None else f"{cadence} when {node.when.description}"
