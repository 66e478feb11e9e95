"""From settings to a graph that is ready to take frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial

from nlens_video.core.settings import REFLECTANCE, ObjectSettings
from nlens_video.effects.planner import OCCLUSION, Decision, request
from nlens_video.graph.adaptive_quality import (
    BudgetControl,
    QualityExecutor,
    check_level,
    lower_levels,
)
from nlens_video.graph.base.context import NodeContext, OcclusionSource
from nlens_video.graph.base.lazy_networks import lazy_coc_estimator, lazy_depth_order
from nlens_video.graph.base.object_setup import open_object, shadow_scene
from nlens_video.graph.base.object_source import RenderedObject, View, choose_camera
from nlens_video.graph.base.occlusion_source import closing_source, open_occlusion_source
from nlens_video.graph.base.profiler import FrameTiming, Profiler
from nlens_video.graph.builder import Built, Graph, build
from nlens_video.graph.effect_decisions import PlatePreview, ShotContext, decide_effects
from nlens_video.graph.executor import FrameState, GraphExecutor
from nlens_video.graph.lens_request import LensRequest
from nlens_video.graph.nodes.distortion import overscan_px
from nlens_video.graph.pipeline_file import PipelineFile, load_pipeline
from nlens_video.graph.scheduler import Worker
from nlens_video.networks.device import DeviceChoice, choose
from nlens_video.scene.scene import Scene
from nlens_video.stages.r_live_lens import LiveLens


@dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """Everything that a stream of frames is run with.

    Attributes:
        scene: the GLB.
        graph: the nodes.
        executor: runs them.
        decisions: which effects, and why.
        device: where networks and kernels run.
        quality: chooses each frame's level where quality is held to a budget, else None.
        render_context: holds what the render lane's thread must open and close.
        notes: what a person should know before the run.
    """

    scene: Scene
    graph: Graph
    executor: GraphExecutor
    decisions: tuple[Decision, ...]
    device: DeviceChoice
    quality: QualityExecutor | None
    render_context: Callable[[], AbstractContextManager[object]]
    notes: Callable[[], tuple[str, ...]]

    @property
    def graphs(self) -> tuple[Graph, ...]:
        """That of the run, and those of the levels that it may step down to."""
        return (self.graph,) if self.quality is None else tuple(self.quality.graphs.values())

    def wrote(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame is written: what holds the budget learns from its time."""
        if self.quality is not None:
            self.quality.wrote(state, timing)

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
) -> Session:
    """Load the scene, choose the backends and build the graph.

    Args:
        objects: the object.
        lens: how the lens is found and simulated.
        view: the frame that sees it.
        profiler: times the nodes.
        plate: the shot's first pictures, on which effects of its camera are looked for.
        pipeline: what runs; default: that of the lens' preset.

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
    scene = Scene.load(objects.glb, objects.playback, objects.scene)
    view, placed_note = choose_camera(objects, scene, view)
    ground = shadow_scene(objects, scene)
    estimator = cache(partial(lazy_coc_estimator, view.pixel_aspect, device))
    size = (view.width, view.height)
    occluded = request(lens.effects).asks_for(OCCLUSION)
    occlusion = open_occlusion_source(objects.real, size, estimator, asked_for=occluded)
    shot = ShotContext(
        scene=scene,
        ground=ground,
        ground_y=objects.ground_y,
        shutter=lens.shutter,
        plate=plate,
        real=objects.real,
        occlusion_source="" if occlusion is None else occlusion.description,
        optics=lens.optics,
    )
    effects = decide_effects(lens.effects, pipeline, shot, profiler)
    view = replace(view, overscan_px=overscan_px(scene, view, effects.measured))
    source, render_context, notes = open_object(objects, scene, view, ground.light)
    renderer = source.renderer if isinstance(source, RenderedObject) else None
    context = NodeContext(
        objects=source,
        estimate_coc=estimator,
        ground_y=objects.ground_y,
        fallback_constant=lens.fallback == "constant",
        pixel_aspect=view.pixel_aspect,
        aperture=lens.aperture,
        views=renderer,
        hidden=renderer,
        repair=lazy_depth_order(view.pixel_aspect, device),
        spread=device.spread,
        shadow_scene=ground,
        shutter=effects.shutter,
        measured=effects.measured,
        occlusion=occlusion,
        reflectance=_reflectance(objects),
    )
    fit = lens.fit.for_width(view.width, view.height) if lens.fit is not None else None
    known = lens.track or fit
    frame_s = lens.frame_s or 1 / 30
    live = LiveLens(frame_s) if lens.live and known is None else None
    built: Built = {}
    graph = build(pipeline, effects.decisions, context, fit_given=known is not None, built=built)
    executor = GraphExecutor(graph, profiler, known, live)
    quality = None
    if lens.hold_budget:
        graphs = lower_levels(graph, effects.decisions, context, built)
        control = BudgetControl(profiler.budget_ms, tuple(graphs), frame_s)
        quality = QualityExecutor(executor, graphs, control)
    return Session(
        scene=scene,
        graph=graph,
        executor=executor,
        quality=quality,
        decisions=effects.decisions,
        device=device,
        render_context=lambda: _with(render_context, occlusion),
        notes=lambda: (
            *placed_note,
            *scene.warnings,
            *graph.notes,
            *notes(),
            *_doubt(executor),
            *([lens.track.describe()] if lens.track is not None else []),
            *(quality.describe() if quality is not None else ()),
            *([live.describe()] if live is not None and live.fits > 1 else []),
        ),
    )


def _doubt(executor: GraphExecutor) -> tuple[str, ...]:
    found = executor.shot.found_lens
    return (found.warning,) if found is not None and found.warning else ()


@contextmanager
def _with(
    render_context: Callable[[], AbstractContextManager[object]], front: OcclusionSource | None
) -> Iterator[None]:
    with closing_source(front), render_context():
        yield


def _reflectance(objects: ObjectSettings) -> float:
    given = objects.real.reflectance
    return REFLECTANCE if given is None else given
