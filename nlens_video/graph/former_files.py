"""Pipeline files of the form before 1.0: `[[node]]` tables that spell out ports and lanes."""

from __future__ import annotations

from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.graph.nodes.registry import FORMER_NAMES, NODES

_LATE = ("crop-sharp",)
"""Nodes that now stand behind their alternatives: the first that can run does."""


def former_nodes(raw: dict[str, object], path: Path) -> dict[str, object]:
    """Today's form of such a file: stage, order and options; the rest is the nodes' own.

    Args:
        raw: the file, parsed.
        path: its name, for messages.

    Raises:
        UsageError: a table without a known stage.
    """
    tables, about = raw.get("node"), raw.get("pipeline", {})
    if not isinstance(tables, list) or not isinstance(about, dict):
        raise UsageError(f"{path}: 'node' must be a list of tables, 'pipeline' a table")
    names = {
        table["name"]: _today(table, path)
        for table in tables
        if isinstance(table, dict) and "name" in table
    }
    nodes = [_node(table, names, path) for table in tables]
    late = [node for node in nodes if node["node"] in _LATE]
    nodes = [node for node in nodes if node["node"] not in _LATE]
    for node in late:
        nodes.insert(_behind_alternatives(nodes), node)
    return {"summary": about.get("summary", ""), "nodes": nodes}


def _today(table: dict[str, object], path: Path) -> str:
    stage = table.get("stage")
    name = FORMER_NAMES.get(stage, stage) if isinstance(stage, str) else None
    if name not in NODES:
        raise UsageError(f"{path}: no stage {stage!r}; there are {', '.join(FORMER_NAMES)}")
    return name


def _node(table: object, names: dict[str, str], path: Path) -> dict[str, object]:
    if not isinstance(table, dict):
        raise UsageError(f"{path}: a [[node]] is not a table")
    options = table.get("options", {})
    if not isinstance(options, dict):
        raise UsageError(f"{path}: 'options' must be a table")
    node: dict[str, object] = {"node": _today(table, path), **options}
    if "unless" in table:
        node["fallback_for"] = names.get(table["unless"], table["unless"])
    return node


def _behind_alternatives(nodes: list[dict[str, object]]) -> int:
    """Where a last alternative goes: behind the others, before the operations on their result."""
    place = 0
    for at, node in enumerate(nodes):
        kind = NODES[str(node["node"])]
        if kind.writes == "blurred" and not kind.is_operation():
            place = at + 1
        elif kind.lane == "render":
            place = max(place, at + 1)
    return place
