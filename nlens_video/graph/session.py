"""From settings to a graph that is ready to take frames, and its plan in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.settings import ObjectSettings
from nlens_video.effects.planner import Decision
from nlens_video.graph.adaptive_quality import (
    BudgetControl,
    QualityExecutor,
    check_level,
    lower_levels,
)
from nlens_video.graph.base.begun_coc import BegunCoc
from nlens_video.graph.base.context import CocEstimator, NodeContext
from nlens_video.graph.base.followed_lens import DISTORTION, followed_distortion
from nlens_video.graph.base.ground_level import note_on_ground
from nlens_video.graph.base.lens_search import LensSearch
from nlens_video.graph.base.live_lens import LiveLens
from nlens_video.graph.base.node import Node
from nlens_video.graph.base.objects_on_ground import is_placed, load_scene, stage
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import FrameTiming, Profiler
from nlens_video.graph.base.timeline import notes_on_timing
from nlens_video.graph.base.view import View
from nlens_video.graph.builder import Built, Graph, build, open_dependencies
from nlens_video.graph.camera_zoom import CameraZoom
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.executor import FrameState, GraphExecutor
from nlens_video.graph.pipeline_file import PipelineFile, load_pipeline
from nlens_video.graph.scheduler import Worker
from nlens_video.networks.device import DeviceChoice, choose
from nlens_video.networks.lazy import lazy_coc_estimator
from nlens_video.scene.scene import Scene
from nlens_video.stages.r_lens_track import FitTrack
from nlens_video.stages.r_samples import FitSamples

_WITH_BACKEND = ("estimate-coc", "render", "reblur", "lens-sampling")


class LensPasses(Struct, frozen=True):
    """What passes over a file have told of its lens before a run.

    Attributes:
        track: the lens over the length of the file, where it changes, in the pixels of its frames.
        others: samples of other frames for the fit, where the camera moves.
    """

    track: FitTrack | None = None
    others: tuple[FitSamples, ...] = ()


class Session(Struct, frozen=True, kw_only=True):
    """Everything that a stream of frames is run with.

    Attributes:
        graph: the nodes.
        context: their dependencies.
        view: how the plate's frames see the scene.
        executor: runs them.
        decisions: which effects, and why.
        device: where networks and kernels run.
        quality: chooses each frame's level where quality is held to a budget, else None.
        opening_notes: for the user, on how the session was opened.
    """

    graph: Graph
    context: NodeContext
    view: View
    executor: GraphExecutor
    decisions: tuple[Decision, ...]
    device: DeviceChoice
    quality: QualityExecutor | None
    opening_notes: tuple[str, ...]

    @property
    def nodes(self) -> tuple[Node, ...]:
        """Nodes of the graph and of those that adaptive quality may step down to."""
        graphs = (self.graph,) if self.quality is None else self.quality.graphs.values()
        return tuple(dict.fromkeys(node for graph in graphs for node in graph.nodes))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, as of now."""
        occlusion = self.context.occlusion
        quality = () if self.quality is None else self.quality.describe()
        return (
            *self.opening_notes,
            *self.context.objects.notes,
            *(() if occlusion is None else occlusion.notes()),
            *self.executor.notes,
            *quality,
        )

    @property
    def distortion_k1(self) -> float:
        """Distortion that was solved with the plate's camera, where the object follows it [1]."""
        followed = any(one.effect == "distortion" and one.wanted for one in self.decisions)
        solved = self.view.solved
        return solved.distortion_k1 if followed and solved is not None else 0.0

    @contextmanager
    def render_context(self) -> Iterator[None]:
        """Holds what the render lane's thread must open and close."""
        occlusion = self.context.occlusion
        try:
            with self.context.objects.opened():
                yield
        finally:
            if occlusion is not None:
                occlusion.close()

    def on_written(self, state: FrameState, timing: FrameTiming) -> None:
        """Tell adaptive quality the time of a frame that was written."""
        if self.quality is not None:
            self.quality.on_written(state, timing)

    def workers(self) -> list[Worker[object]]:
        """For `run_workers`."""
        step = self.quality.run if self.quality else None
        return self.executor.workers(self.render_context, step)


def open_session(
    objects: ObjectSettings,
    lens: LensRequest,
    view: View,
    profiler: Profiler,
    plate: PlatePreview,
    pipeline: PipelineFile | None = None,
    *,
    passes: Callable[[], LensPasses] = LensPasses,
    scene: Scene | None = None,
    estimate_coc: CocEstimator | None = None,
) -> Session:
    """Load the scene, choose the backends and build the graph.

    Args:
        objects: the objects.
        lens: how the lens is found and simulated.
        view: the frame that sees it.
        profiler: times the nodes.
        plate: the shot's first pictures, on which effects of its camera are measured.
        pipeline: what runs; default: that of the lens' preset.
        passes: waits for what passes over the file tell of the lens; asked once all that does not
            depend on it is done.
        scene: the objects' files, where another session has loaded them.
        estimate_coc: F, where another session has it; default: one of its own.

    Raises:
        UsageError: preset, effects, device or pipeline make no sense.
        SceneError: the GLB cannot be used.
        InputError: the layers cannot be read.
        LensFitError: the given fit cannot be used.
    """
    if lens.hold_budget:
        check_level(lens.preset)
    device = choose(lens.device)
    pipeline = pipeline or load_pipeline(lens.preset)
    if scene is None:
        scene = load_scene(objects)
    placed = is_placed(objects, scene) or objects.others or objects.keys
    measure = partial(plate.measured, {DISTORTION}) if placed else dict
    distortion = followed_distortion(
        lens.effects, pipeline.effects, lens.optics, view.solved, measure
    )
    view = replace(view, distortion=distortion)
    staged = stage(objects, scene, view)
    ground_given = objects.ground_y is not None
    objects, scene, view = staged.objects, staged.scene, staged.view
    coc = BegunCoc(estimate_coc or lazy_coc_estimator(view.pixel_aspect, device), profiler)
    context, effects = open_dependencies(
        objects, lens, view, device, scene, pipeline, plate, profiler, coc
    )
    told = passes()
    context = replace(context, other_samples=told.others, lens_search=LensSearch(lens.search_s))
    fit = lens.fit.for_width(view.width, view.height) if lens.fit is not None else None
    known = told.track or fit
    frame_s = lens.frame_s or 1 / 30
    built: Built = {}
    graph = build(pipeline, effects.decisions, context, fit_given=known is not None, built=built)
    if not graph.has("estimate-coc"):
        coc.forget()
    live = LiveLens(frame_s) if lens.live and known is None else None
    zoom = None
    if view.zoom_ends(scene):
        zoom = CameraZoom(lambda time_s: context.objects.camera(time_s).fx, frame_s)
    executor = GraphExecutor(graph, profiler, known, live, zoom)
    quality = None
    if lens.hold_budget:
        graphs = lower_levels(graph, effects.decisions, context, built)
        control = BudgetControl(profiler.budget_ms, tuple(graphs), frame_s)
        quality = QualityExecutor(executor, graphs, control)
    return Session(
        graph=graph,
        context=context,
        view=view,
        executor=executor,
        decisions=effects.decisions,
        device=device,
        quality=quality,
        opening_notes=(
            *staged.notes,
            *scene.warnings,
            *notes_on_timing(scene, view),
            *(() if ground_given else (note_on_ground(context.objects, context.ground_height),)),
            *effects.notes,
            *graph.notes,
        ),
    )


class PlanRow(Struct, frozen=True):
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
    """The plan and the notes of a run as lines of text.

    Args:
        session: the resolved graph.
        all_reasons: every row of `plan_rows`; else what fits a screen.
    """
    yield from map(str, plan_rows(session) if all_reasons else _short_rows(session))
    for note in session.notes:
        yield f"note: {note}"


def plan_rows(session: Session) -> Iterator[PlanRow]:
    """Pipeline, device, effects, and nodes with backend and condition."""
    graph = session.graph
    yield from _pipeline_rows(session)
    for decision in session.decisions:
        yield _effect_row(decision)
    for node in graph.nodes:
        yield PlanRow(
            f"node {node.name}", node.description, when=f"{_when(node)}; lane {node.lane}"
        )
    for name, reason in graph.left_out:
        yield PlanRow(f"left out {name}", reason)


def _short_rows(session: Session) -> Iterator[PlanRow]:
    """The effects, the names of the nodes, and the backends of the main ones."""
    graph = session.graph
    yield from _pipeline_rows(session)
    yield from map(_effect_row, session.decisions)
    for node in graph.nodes:
        if node.name in _WITH_BACKEND:
            yield PlanRow(f"node {node.name}", node.description)
    for lane in dict.fromkeys(node.lane for node in graph.nodes):
        names = ", ".join(node.name for node in graph.nodes if node.lane == lane)
        yield PlanRow(f"lane {lane}", names)
    left_out = len(graph.left_out)
    if left_out:
        yield PlanRow(
            "left out", f"{left_out} nodes that nothing calls for (-v gives every reason)"
        )


def _pipeline_rows(session: Session) -> Iterator[PlanRow]:
    yield PlanRow(f"pipeline {session.graph.pipeline}", session.graph.summary)
    yield PlanRow(f"device {session.device.name}", session.device.reason)


def _effect_row(decision: Decision) -> PlanRow:
    word = "yes" if decision.wanted else "no"
    return PlanRow(f"effect {decision.effect}", f"{word}, {decision.reason}")


def _when(node: Node) -> str:
    cadence = "once a shot" if node.once else "each frame"
    return cadence if node.when is None else f"{cadence} when {node.when.description}"
