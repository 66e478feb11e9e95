"""Pipeline files: which nodes, in which order, with which options.

    summary = "what it does"
    nodes = [
        "object-bounds",
        { node = "measure-motion", most_moments = 17 },
        { node = "reblur", fallback_for = "lens-sampling" },
    ]

Ports, thread and condition of a node are its class's own (see `graph.base.node`). Files of the form
before 1.0 (`[[node]]` tables) are read as well.
"""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

from msgspec import Struct, field

from nlens_video.core.errors import UsageError
from nlens_video.graph.base.node import LANES, Node
from nlens_video.graph.base.node_options import check_options
from nlens_video.graph.base.values import GIVEN
from nlens_video.graph.node_registry import NODES

_KEYS = {"summary", "nodes"}
_NODE_KEYS = ("node", "fallback_for")


FORMER_NAMES = {
    "locate": "object-bounds",
    "project": "ground-footprint",
    "light": "estimate-light",
    "follow": "match-exposure",
    "motion": "measure-motion",
    "moments": "select-samples",
    "expose": "render-motion",
    "smear": "motion-blur",
    "sharp": "crop-sharp",
    "scatter": "reblur",
    "lens": "lens-sampling",
    "views": "aperture-views",
    "lay-views": "blend-views",
    "peel": "depth-peel",
    "past-edges": "edge-parallax",
    "repair": "depth-order",
    "matte": "occlusion-cue",
    "hold-out": "foreground",
    "darken": "composite-shadow",
    "lay-reflection": "composite-reflection",
    "widen": "add-overscan",
    "narrow": "remove-overscan",
    "bend": "distort",
    "bend-shadow": "distort-shadow",
    "bend-reflection": "distort-reflection",
    "fringe": "chromatic-aberration",
}
"""Names of nodes before 1.0, as older pipeline files have them, to today's."""


class NodeSpec(Struct, frozen=True, kw_only=True):
    """A node as the file states it.

    Attributes:
        type: its class.
        options: keyword arguments of the class, beside the context.
        fallback_for: a node above that this one stands in for where that cannot be built, or none.
    """

    type: type[Node]
    options: dict[str, object] = field(default_factory=dict)
    fallback_for: str | None = None

    @property
    def name(self) -> str:
        """The node's name."""
        return self.type.name


class PipelineFile(Struct, frozen=True, kw_only=True):
    """A pipeline: its name, what it does in a few words, its nodes in order, notes on the file."""

    name: str
    summary: str
    nodes: tuple[NodeSpec, ...]
    notes: tuple[str, ...] = ()

    @property
    def effects(self) -> frozenset[str]:
        """The effects that it has nodes for."""
        return frozenset(spec.type.effect for spec in self.nodes if spec.type.effect)


def pipelines_folder() -> Path:
    """Where the shipped pipelines lie: in the installed package, or beside it in a checkout."""
    installed = Path(str(resources.files("nlens_video"))) / "data" / "pipelines"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "pipelines"


def shipped_pipelines() -> dict[str, Path]:
    """Preset name to file."""
    return {path.stem: path for path in sorted(pipelines_folder().glob("*.toml"))}


def load_pipeline(preset: str) -> PipelineFile:
    """Read a shipped preset by its name, or one's own pipeline file by its path.

    Raises:
        UsageError: unknown preset, unreadable file, or a node that makes no sense.
    """
    path = _path_of(preset)
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}: cannot be read as a pipeline file ({error})") from error
    notes: tuple[str, ...] = ()
    if "node" in raw:
        raw = _from_former(raw, path)
        notes = (f"{path}: has the form before 1.0, which the next release no longer reads",)
    if unknown := set(raw) - _KEYS:
        raise UsageError(f"{path}: unknown key {min(unknown)!r}; known: {', '.join(sorted(_KEYS))}")
    nodes = raw.get("nodes")
    if not isinstance(nodes, list) or not nodes:
        raise UsageError(f"{path}: no list 'nodes'; see the shipped pipelines for the form")
    summary = raw.get("summary", "")
    if not isinstance(summary, str):
        raise UsageError(f"{path}: 'summary' is {summary!r}, expected a text")
    specs = tuple(_spec(entry, path) for entry in nodes)
    _check_order(specs, path)
    return PipelineFile(name=path.stem, summary=summary, nodes=specs, notes=notes)


def load_compositing_pipeline(preset: str) -> PipelineFile:
    """As `load_pipeline`, for runs that write pictures: one that composites the object.

    Raises:
        UsageError: as there, or the object would not be in the pictures.
    """
    pipeline = load_pipeline(preset)
    if all(spec.name != "composite" for spec in pipeline.nodes):
        raise UsageError(
            f"{preset}: has no node 'composite', so the object would not be in the pictures; add "
            "it as the last of 'nodes'"
        )
    return pipeline


def _path_of(preset: str) -> Path:
    shipped = shipped_pipelines()
    if preset in shipped:
        return shipped[preset]
    path = Path(preset)
    if path.suffix != ".toml":
        known = ", ".join(shipped)
        raise UsageError(f"preset {preset!r} is not one of {known}, nor a pipeline file (*.toml)")
    return path


def _spec(entry: object, path: Path) -> NodeSpec:
    table = {"node": entry} if isinstance(entry, str) else entry
    if not isinstance(table, dict) or not isinstance(table.get("node"), str):
        raise UsageError(
            f"{path}: {entry!r} in 'nodes' is neither a name nor a table {{ node = NAME, … }}"
        )
    name, fallback_for = table["node"], table.get("fallback_for")
    if name not in NODES:
        raise UsageError(f"{path}: no node {name!r}; there are {', '.join(NODES)}")
    if fallback_for is not None and fallback_for not in NODES:
        raise UsageError(f"{path}: node {name!r} stands in for {fallback_for!r}, which is no node")
    options = {key: value for key, value in table.items() if key not in _NODE_KEYS}
    check_options(NODES[name], options, path)
    return NodeSpec(type=NODES[name], options=options, fallback_for=fallback_for)


def _check_order(specs: tuple[NodeSpec, ...], path: Path) -> None:
    """Each port is written before it is read, and a frame passes the lanes in order.

    An optional port may be written nowhere at all.
    """
    written = set(GIVEN)
    ever_written = {spec.type.writes for spec in specs}
    names: set[str] = set()
    lane = 0
    for spec in specs:
        node = spec.type
        if node.name in names:
            raise UsageError(f"{path}: node {node.name!r} stands twice")
        if spec.fallback_for is not None and spec.fallback_for not in names:
            raise UsageError(
                f"{path}: node {node.name!r} stands in for {spec.fallback_for!r}, which does not "
                "stand above it"
            )
        names.add(node.name)
        for port in node.inputs():
            awaited = not port.optional or port.name in ever_written
            if awaited and port.name not in written:
                raise UsageError(
                    f"{path}: node {node.name!r} reads {port.name!r}, which none above it writes"
                )
        written.add(node.writes)
        if node.writes == "found_lens":
            written.add("fit")
        if LANES.index(node.lane) < lane:
            raise UsageError(
                f"{path}: node {node.name!r} runs on lane {node.lane!r}, but stands below nodes of "
                f"lane {LANES[lane]!r}"
            )
        lane = LANES.index(node.lane)


_LATE = ("crop-sharp",)
"""Nodes that now stand behind their alternatives: the first that can run does."""
_BEFORE = {"composite-shadow": "blur-shadow", "composite-reflection": "blur-reflection"}
"""Nodes with the one whose result they take, which files of the former form do not list."""


_READ_SHADOW = ("distort-shadow", "foreground", "blur-shadow")


def _from_former(raw: dict[str, object], path: Path) -> dict[str, object]:
    """Today's form of a file from before 1.0, whose tables also spell out ports and lanes."""
    tables, about = raw.get("node"), raw.get("pipeline", {})
    if not isinstance(tables, list) or not isinstance(about, dict):
        raise UsageError(f"{path}: 'node' must be a list of tables, 'pipeline' a table")
    names = {
        table["name"]: _current_name(table, path)
        for table in tables
        if isinstance(table, dict) and "name" in table
    }
    nodes = [_node(table, names, path) for table in tables]
    late = [node for node in nodes if node["node"] in _LATE]
    nodes = [node for node in nodes if node["node"] not in _LATE]
    for node in late:
        nodes.insert(_behind_alternatives(nodes), node)
    for after, before in _BEFORE.items():
        for at in [at for at, node in enumerate(nodes) if node["node"] == after]:
            nodes.insert(at, {"node": before})
    _split_shadow(nodes)
    return {"summary": about.get("summary", ""), "nodes": nodes}


def _split_shadow(nodes: list[dict[str, object]]) -> None:
    """Put `shadow-casters` where `shadow` stands, and that before the first node that reads it."""
    for at, node in enumerate(nodes):
        if node["node"] == "shadow":
            nodes[at] = {"node": "shadow-casters"}
            if "most_moments" in node:
                nodes[at]["most_moments"] = node.pop("most_moments")
            readers = (k for k, one in enumerate(nodes) if one["node"] in _READ_SHADOW)
            nodes.insert(next(readers, len(nodes)), node)
            return


def _current_name(table: dict[str, object], path: Path) -> str:
    stage = table.get("stage")
    name = FORMER_NAMES.get(stage, stage) if isinstance(stage, str) else None
    if name is None or name not in NODES:
        raise UsageError(f"{path}: no stage {stage!r}; there are {', '.join(FORMER_NAMES)}")
    return name


def _node(table: object, names: dict[str, str], path: Path) -> dict[str, object]:
    if not isinstance(table, dict):
        raise UsageError(f"{path}: a [[node]] is not a table")
    options = table.get("options", {})
    if not isinstance(options, dict):
        raise UsageError(f"{path}: 'options' must be a table")
    node: dict[str, object] = {"node": _current_name(table, path), **options}
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
