"""Reblur methods that `bench` compares: presets, the sampled lens at other view counts, rivals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from nlens_video.core.layers import DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import ObjectSettings
from nlens_video.evaluate.bench.case import Case
from nlens_video.evaluate.bench.rivals import RIVALS, GivenCoc, RivalReblur
from nlens_video.graph.base.node import Node
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.builder import Graph
from nlens_video.graph.effect_plan import LensRequest, PlatePreview
from nlens_video.graph.executor import GraphExecutor
from nlens_video.graph.pipeline_file import PipelineFile, load_pipeline, shipped_pipelines
from nlens_video.graph.session import open_session
from nlens_video.stages.l_lens_sampling import view_count

LENS_VIEWS = (8, 32)
"""Views of the lens that are measured beside those of the preset `reference`."""

ObjectCoc = Callable[[ObjectLayer], DefocusedLayer]

_ORDER = ("draft", "realtime", "standard", "paper", "reference")  # the ladder's own
_SAMPLED, _SCATTER = "reference", "realtime"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """One way to reblur.

    Attributes:
        name: of its row.
        preset: the shipped pipeline that runs.
        rival: what stands in for that pipeline's scatter, a key of `RIVALS`; None for nothing.
        needs_views: whether it draws the object from points of the lens.
        accuracy_db: what its lens sampling is to reach, None for the pipeline's own [dB].
    """

    name: str
    preset: str
    rival: str | None = None
    accuracy_db: float | None = None
    needs_views: bool = False

    def can_run(self, case: Case) -> bool:
        """Whether a case gives what it needs: layers hold one view of the object only."""
        return case.layers is None or not self.needs_views


def all_rungs() -> list[Rung]:
    """Every rung, rivals first, then from the cheapest of ours to the dearest."""
    rungs = [rival_rung(name) for name in RIVALS]
    for rung in preset_rungs():
        if rung.needs_views:
            rungs += [_sampled(rung.preset, views) for views in LENS_VIEWS]
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


def _sampled(preset: str, views: int) -> Rung:
    """The preset `reference` for the accuracy that takes so many views."""
    accuracy = next(db / 1000 for db in range(30_000, 70_000) if view_count(db / 1000) == views)
    return Rung(name=f"lens, {views} views", preset=preset, accuracy_db=accuracy, needs_views=True)


@contextmanager
def opened(
    rung: Rung,
    case: Case,
    profiler: Profiler,
    fit: LensFit | None,
    object_coc: ObjectCoc | None = None,
) -> Iterator[GraphExecutor]:
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
    session = open_session(
        ObjectSettings(glb=case.glb, layers=None if case.layers is None else str(case.layers)),
        LensRequest(preset=rung.preset, effects="defocus", fit=fit),
        View(width=width, height=height),
        profiler,
        PlatePreview(lambda: ()),
        _pipeline(rung),
    )
    stand_ins: list[Node] = []
    if rung.rival is not None:
        stand_ins.append(RivalReblur(RIVALS[rung.rival]))
    if object_coc is not None:
        stand_ins.append(GivenCoc(object_coc))
    steps = session.executor
    if stand_ins:
        steps = GraphExecutor(_with(stand_ins, session.graph), profiler, fit)
    with session.render_context():
        yield steps


def _pipeline(rung: Rung) -> PipelineFile:
    """The rung's pipeline, its lens sampled as accurately as the rung asks."""
    pipeline = load_pipeline(rung.preset)
    if rung.accuracy_db is None:
        return pipeline
    options: dict[str, object] = {"accuracy_db": rung.accuracy_db}
    specs = (
        replace(spec, options=options) if spec.name == "lens-sampling" else spec
        for spec in pipeline.nodes
    )
    return replace(pipeline, nodes=tuple(specs))


def _with(stand_ins: Sequence[Node], graph: Graph) -> Graph:
    by_name = {node.name: node for node in stand_ins}
    return replace(graph, nodes=tuple(by_name.get(node.name, node) for node in graph.nodes))
