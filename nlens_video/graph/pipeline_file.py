"""Pipeline files: which nodes, in which order, wired how."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.effects.planner import EFFECTS
from nlens_video.graph.node import CADENCES, CONDITIONS, GIVEN, LANES, PORTS, Cadence, LaneName

_KEYS = {
    "name",
    "stage",
    "inputs",
    "output",
    "cadence",
    "lane",
    "effect",
    "when",
    "without",
    "unless",
    "options",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSpec:
    """A node as the file states it; the attributes are those of `Node`.

    Attributes:
        unless: a node above that this one stands in for where that cannot be built, or none.
    """

    name: str
    stage: str
    inputs: tuple[str, ...]
    optional: tuple[str, ...]
    output: str
    cadence: Cadence
    lane: LaneName
    effect: str | None = None
    when: str | None = None
    without: str | None = None
    unless: str | None = None
    options: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineFile:
    """A pipeline: its name, what it does in a few words, its nodes in order."""

    name: str
    summary: str
    nodes: tuple[NodeSpec, ...]


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
    shipped = shipped_pipelines()
    path = shipped.get(preset)
    if path is None:
        path = Path(preset)
        if path.suffix != ".toml":
            known = ", ".join(shipped)
            raise UsageError(
                f"preset {preset!r} is not one of {known}, nor a pipeline file (*.toml)"
            )
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}: cannot be read as a pipeline file ({error})") from error
    nodes = raw.get("node")
    if not isinstance(nodes, list) or not nodes:
        raise UsageError(f"{path}: no [[node]] in it; see the shipped pipelines for the form")
    specs = tuple(_node(entry, path) for entry in nodes)
    _check_wiring(specs, path)
    about = raw.get("pipeline", {})
    if not isinstance(about, dict):
        raise UsageError(f"{path}: [pipeline] must be a table with a summary")
    summary = about.get("summary", "")
    return PipelineFile(name=path.stem, summary=str(summary), nodes=specs)


def _node(entry: object, path: Path) -> NodeSpec:
    if not isinstance(entry, dict):
        raise UsageError(f"{path}: a [[node]] is not a table")
    where = f"{path}: node {entry.get('name', '?')!r}"
    inputs, options = _checked(entry, where)
    return NodeSpec(
        name=entry["name"],
        stage=entry["stage"],
        inputs=tuple(port for port in inputs if not port.endswith("?")),
        optional=tuple(port.rstrip("?") for port in inputs if port.endswith("?")),
        output=entry["output"],
        cadence=entry["cadence"],
        lane=entry["lane"],
        effect=entry.get("effect"),
        when=entry.get("when"),
        without=entry.get("without"),
        unless=entry.get("unless"),
        options=options,
    )


def _checked(entry: dict[str, object], where: str) -> tuple[list[str], dict[str, object]]:
    """Inputs and options of a node's table, once every key is known to make sense."""
    if unknown := set(entry) - _KEYS:
        raise UsageError(f"{where}: unknown key {sorted(unknown)[0]!r}; known: {sorted(_KEYS)}")
    for key in ("name", "stage", "output"):
        if not isinstance(entry.get(key), str):
            raise UsageError(f"{where}: {key!r} must be a word")
    inputs = entry.get("inputs", [])
    if not isinstance(inputs, list) or not all(isinstance(port, str) for port in inputs):
        raise UsageError(f"{where}: 'inputs' must be a list of port names")
    for port in [*(port.rstrip("?") for port in inputs), entry["output"]]:
        if port not in PORTS:
            raise UsageError(f"{where}: no port {port!r}; there are {', '.join(PORTS)}")
    for key, allowed in (
        ("cadence", CADENCES),
        ("lane", LANES),
        ("when", (None, *CONDITIONS)),
        ("without", (None, *PORTS)),
        ("effect", (None, *EFFECTS)),
    ):
        if entry.get(key) not in allowed:
            raise UsageError(f"{where}: {key!r} is {entry.get(key)!r}, allowed: {allowed}")
    options = entry.get("options", {})
    if not isinstance(options, dict):
        raise UsageError(f"{where}: 'options' must be a table")
    return inputs, options


def _check_wiring(nodes: tuple[NodeSpec, ...], path: Path) -> None:
    """Each port is written before it is read, and lanes only go forward.

    One that may be missing may be written nowhere at all.
    """
    written = set(GIVEN)
    ever_written = {node.output for node in nodes}
    names: set[str] = set()
    lane = 0
    for node in nodes:
        if node.name in names:
            raise UsageError(f"{path}: two nodes are called {node.name!r}")
        if node.unless is not None and node.unless not in names:
            raise UsageError(
                f"{path}: node {node.name!r} stands in for {node.unless!r}, which is none above"
            )
        names.add(node.name)
        awaited = (port for port in node.optional if port in ever_written)
        for port in (*node.inputs, *awaited):
            if port not in written:
                raise UsageError(
                    f"{path}: node {node.name!r} reads {port!r}, which none above writes"
                )
        written.add(node.output)
        if LANES.index(node.lane) < lane:
            raise UsageError(f"{path}: node {node.name!r} goes back to lane {node.lane!r}")
        lane = LANES.index(node.lane)
