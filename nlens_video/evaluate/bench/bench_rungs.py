"""The rungs of the ladder: shipped presets, the lens at other counts of views, and rivals."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from nlens_video.core.layers import DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import ObjectSettings
from nlens_video.evaluate.bench.bench_case import Case
from nlens_video.evaluate.bench.bench_rivals import RIVALS
from nlens_video.graph.builder import Graph
from nlens_video.graph.effect_decisions import Plate
from nlens_video.graph.executor import FrameSteps
from nlens_video.graph.lens_request import Lens
from nlens_video.graph.nodes.object_source import View
from nlens_video.graph.pipeline_file import shipped_pipelines
from nlens_video.graph.profiler import Profiler
from nlens_video.graph.session import assemble
from nlens_video.stages.reblur.lens_sampling import view_count

LENS_VIEWS = (8, 32)
"""Views of the lens that are measured beside those of the preset `reference`."""

ObjectCoc = Callable[[ObjectLayer], DefocusedLayer]

_ORDER = ("draft", "realtime", "standard", "paper", "reference")  # the ladder's own
_SAMPLED, _SCATTER = "reference", "realtime"
_ACCURACY = re.compile(r"accuracy_db *= *[\d.]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """One way to reblur.

    Attributes:
        name: of its row.
        preset: the pipeline that runs, a shipped one or a file.
        rival: what stands in for that pipeline's scatter, a key of `RIVALS`; None for nothing.
        needs_views: whether it draws the object from points of the lens.
    """

    name: str
    preset: str
    rival: str | None = None
    needs_views: bool = False

    def can_run(self, case: Case) -> bool:
        """Whether a case gives what it needs: layers hold one view of the object only."""
        return case.layers is None or not self.needs_views


def all_rungs(folder: Path) -> list[Rung]:
    """Every rung, rivals first, then from the cheapest of ours to the dearest.

    Args:
        folder: gets the pipeline files of the rungs that no shipped preset is.
    """
    rungs = [rival_rung(name) for name in RIVALS]
    for rung in preset_rungs():
        if rung.needs_views:
            shipped = shipped_pipelines()[rung.preset]
            rungs += [_sampled(shipped, views, folder) for views in LENS_VIEWS]
        rungs.append(rung)
    return rungs


def rival_rung(name: str) -> Rung:
    """The rung of a rival, a key of `RIVALS`."""
    return Rung(name=name, preset=_SCATTER, rival=name)


def preset_rungs() -> list[Rung]:
    """The shipped presets, from the cheapest to the dearest."""
    shipped = shipped_pipelines()
    known = [name for name in _ORDER if name in shipped]
    others = [name for name in shipped if name not in _ORDER]
    return [
        Rung(name=name, preset=name, needs_views=name == _SAMPLED) for name in (*known, *others)
    ]


def _sampled(shipped: Path, views: int, folder: Path) -> Rung:
    """The preset `reference` for the accuracy that takes so many views."""
    accuracy = next(db / 1000 for db in range(30_000, 70_000) if view_count(db / 1000) == views)
    text, changed = _ACCURACY.subn(f"accuracy_db = {accuracy}", shipped.read_text())
    if not changed:
        raise RuntimeError(f"{shipped}: no accuracy_db in it")
    path = folder / f"lens-{views}.toml"
    path.write_text(text)
    return Rung(name=f"lens, {views} views", preset=str(path), needs_views=True)


@contextmanager
def opened(
    rung: Rung,
    case: Case,
    profiler: Profiler,
    fit: LensFit | None,
    object_coc: ObjectCoc | None = None,
) -> Iterator[FrameSteps]:
    """The graph that runs a rung on a case, ready for frames on this thread.

    Args:
        rung: what runs.
        case: on what; its true lens is not looked at.
        profiler: times the nodes.
        fit: the lens, None to find it on the plate.
        object_coc: gives the object its CoC in the place of a lens fit.

    Raises:
        As `assemble`.
    """
    height, width = case.plate.shape[:2]
    assembly = assemble(
        ObjectSettings(glb=case.glb, layers=None if case.layers is None else str(case.layers)),
        Lens(preset=rung.preset, effects="defocus", fit=fit),
        View(width=width, height=height),
        profiler,
        Plate(lambda: ()),
    )
    stand_ins: dict[str, Callable[..., object]] = {}
    if rung.rival is not None:
        stand_ins["scatter"] = RIVALS[rung.rival]
    if object_coc is not None:
        stand_ins["object-coc"] = lambda layer, _: object_coc(layer)
    steps = assembly.steps
    if stand_ins:
        steps = FrameSteps(_with(stand_ins, assembly.graph), profiler, fit)
    with assembly.render_context():
        yield steps


def _with(stand_ins: Mapping[str, Callable[..., object]], graph: Graph) -> Graph:
    nodes = tuple(replace(node, run=stand_ins.get(node.stage, node.run)) for node in graph.nodes)
    return replace(graph, nodes=nodes)
