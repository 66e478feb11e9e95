"""From settings to a graph that is ready to take frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TYPE_CHECKING

from nlens_video.core.layers import (
    BlurredLayer,
    CocMap,
    DefocusedLayer,
    Picture,
)
from nlens_video.core.settings import REFLECTANCE, ObjectSettings
from nlens_video.effects.planner import OCCLUSION, Decision, request
from nlens_video.graph.builder import Graph, build
from nlens_video.graph.effect_decisions import Plate, Shot, call_for
from nlens_video.graph.executor import FrameState, FrameSteps
from nlens_video.graph.held import HeldBudget
from nlens_video.graph.ladder import check_rung, held_budget
from nlens_video.graph.lens_request import Lens
from nlens_video.graph.nodes.camera import seen_beyond
from nlens_video.graph.nodes.context import (
    FrontSource,
    LitGround,
    ShotRecord,
    Tools,
)
from nlens_video.graph.nodes.object_source import (
    ObjectSource,
    RenderedObject,
    View,
    stand,
)
from nlens_video.graph.nodes.prerendered import LayeredObject
from nlens_video.graph.occlusion_source import closing, open_front
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.graph.profiler import FrameTiming, Profiler
from nlens_video.graph.scheduler import Lane
from nlens_video.networks.device import Chosen, choose
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.stages.protocols import ReblurNetwork
from nlens_video.stages.r_live_lens import LiveLens

if TYPE_CHECKING:
    from nlens_video.stages.reblur.depth_order_repair import RepairNetwork


@dataclass(frozen=True, slots=True, kw_only=True)
class Assembly:
    """Everything that a stream of frames is run with.

    Attributes:
        scene: the GLB.
        graph: the nodes.
        steps: runs them.
        decisions: which effects, and why.
        record: what the fit was made from.
        device: where networks and kernels run.
        held: chooses each frame's rung where quality is held to a budget, else None.
        render_context: holds what the render lane's thread must open and close.
        notes: what a person should know before the run.
    """

    scene: Scene
    graph: Graph
    steps: FrameSteps
    decisions: tuple[Decision, ...]
    record: ShotRecord
    device: Chosen
    held: HeldBudget | None
    render_context: Callable[[], AbstractContextManager[object]]
    notes: Callable[[], tuple[str, ...]]

    @property
    def graphs(self) -> tuple[Graph, ...]:
        """That of the run, and those of the rungs that it may step down to."""
        return (self.graph,) if self.held is None else tuple(self.held.graphs.values())

    def wrote(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame is written: what holds the budget learns from its time."""
        if self.held is not None:
            self.held.wrote(state, timing)

    def lanes(self) -> list[Lane[object]]:
        """For `run_lanes`."""
        return self.steps.lanes(self.render_context, self.held.run if self.held else None)


def assemble(
    objects: ObjectSettings,
    lens: Lens,
    view: View,
    profiler: Profiler,
    plate: Plate,
) -> Assembly:
    """Load the scene, choose the backends and build the graph.

    Args:
        objects: the object.
        lens: how the lens is found and simulated.
        view: the frame that sees it.
        profiler: times the nodes.
        plate: the shot's first pictures, on which effects of its camera are looked for.

    Raises:
        UsageError: preset, effects, device or pipeline make no sense.
        SceneError: the GLB cannot be used.
        InputError: the layers cannot be read.
        LensFitError: the given fit cannot be used.
    """
    if lens.hold_budget:
        check_rung(lens.preset)
    device = choose(lens.device)
    pipeline = load_pipeline(lens.preset)
    scene = Scene.load(objects.glb, objects.playback, objects.scene)
    view, placed_note = stand(objects, scene, view)
    ground = _lit_ground(objects, scene)
    estimator = cache(partial(_load_estimator, view.pixel_aspect, device))
    size = (view.width, view.height)
    occluded = request(lens.effects).asks_for(OCCLUSION)
    front = open_front(objects.real, size, estimator, asked_for=occluded)
    called_for = call_for(
        lens.effects,
        pipeline,
        Shot(
            scene=scene,
            ground=ground,
            ground_y=objects.ground_y,
            shutter=lens.shutter,
            plate=plate,
            real=objects.real,
            front="" if front is None else front.description,
            optics=lens.optics,
        ),
        profiler,
    )
    view = replace(view, beyond=seen_beyond(scene, view, called_for.measured))
    source, render_context, notes = _object_source(objects, scene, view, ground.light)
    record = ShotRecord()
    tools = Tools(
        objects=source,
        estimate_coc=estimator,
        ground_y=objects.ground_y,
        fallback_constant=lens.fallback == "constant",
        pixel_aspect=view.pixel_aspect,
        record=record,
        aperture=lens.aperture,
        views=source.renderer if isinstance(source, RenderedObject) else None,
        behind=source.renderer if isinstance(source, RenderedObject) else None,
        repair=_repair(view.pixel_aspect, device),
        spread=device.spread,
        ground=ground,
        shutter=called_for.shutter,
        measured=called_for.measured,
        front=front,
        reflectance=_reflectance(objects),
    )
    fit = lens.fit.for_width(view.width, view.height) if lens.fit is not None else None
    known = lens.track or fit
    live = LiveLens(lens.frame_s or 1 / 30) if lens.live and known is None else None
    graph = build(pipeline, called_for.decisions, tools, fit_given=known is not None)
    steps = FrameSteps(graph, profiler, known, live)
    held = None
    if lens.hold_budget:
        held = held_budget(
            steps, called_for.decisions, tools,
            budget_ms=profiler.budget_ms, frame_s=lens.frame_s or 1 / 30,
        )  # fmt: skip
    return Assembly(
        scene=scene,
        graph=graph,
        steps=steps,
        held=held,
        decisions=called_for.decisions,
        record=record,
        device=device,
        render_context=lambda: _with(render_context, front),
        notes=lambda: (
            *placed_note,
            *scene.warnings,
            *graph.notes,
            *notes(),
            *([record.note] if record.note else []),
            *([lens.track.words()] if lens.track is not None else []),
            *(held.words() if held is not None else ()),
            *([live.words()] if live is not None and live.fits > 1 else []),
        ),
    )


@contextmanager
def _with(
    render_context: Callable[[], AbstractContextManager[object]], front: FrontSource | None
) -> Iterator[None]:
    with closing(front), render_context():
        yield


def _reflectance(objects: ObjectSettings) -> float:
    given = objects.real.reflectance
    return REFLECTANCE if given is None else given


def _lit_ground(objects: ObjectSettings, scene: Scene) -> LitGround:
    environment = None
    light = objects.light
    if light.env is not None:
        from nlens_video.scene.environment import load_environment

        environment = load_environment(light.env, light.env_rotation_deg, light.env_exposure_ev)
    given = light.shadow_strength
    return LitGround(
        pose=scene.pose,
        light=SceneLight(scene.light_count, environment),
        pre_rendered=objects.layers is not None,
        strength=1.0 if given is None else given,
        strength_given=given is not None,
    )


def _object_source(
    objects: ObjectSettings, scene: Scene, view: View, light: SceneLight
) -> tuple[
    ObjectSource,
    Callable[[], AbstractContextManager[object]],
    Callable[[], tuple[str, ...]],
]:
    if objects.footprint is not None:
        scene.triangles(0.0, objects.footprint)  # a wrong name speaks up before the run
    if objects.layers is not None:
        from nlens_video.video.exr import LayerReader

        layers = LayerReader(objects.layers, (view.width, view.height))
        return LayeredObject(scene, layers, view, objects.footprint), nullcontext, tuple
    from nlens_video.render.select import choose_renderer

    renderer = choose_renderer(scene, light)
    return (
        RenderedObject(scene, renderer, view, objects.footprint),
        lambda: renderer,
        lambda: (renderer.light_note, *renderer.notes),
    )


def _repair(pixel_aspect: float, device: Chosen) -> ReblurNetwork:
    repairing: ReblurNetwork | None = None

    @cache
    def network() -> RepairNetwork:
        from nlens_video.networks.depth_order_onnx import OnnxRepairNetwork
        from nlens_video.networks.model_store import find_model

        return OnnxRepairNetwork(find_model("reblur").path, device=device)

    def repair(defocused: DefocusedLayer, blurred: BlurredLayer) -> BlurredLayer:
        nonlocal repairing
        if repairing is None:  # loaded by the first frame that has a depth step
            from nlens_video.kernels.scatter.scatter import blur_reach, scatter
            from nlens_video.stages.reblur.depth_order_repair import RepairLayer

            repairing = RepairLayer(
                network=lambda geometry: network()(geometry),  # it may never be asked
                scatter=partial(scatter, spread=device.spread),
                reach=blur_reach,
                pixel_aspect=pixel_aspect,
            )
        return repairing(defocused, blurred)

    return repair


def _load_estimator(
    pixel_aspect: float, device: Chosen
) -> Callable[[Picture, Sequence[Picture]], CocMap]:
    from nlens_video.networks.coc_onnx import OnnxCocNetwork
    from nlens_video.networks.model_store import find_model
    from nlens_video.stages.f_coc import EstimateCoc

    estimator: Callable[[Picture, Sequence[Picture]], CocMap] | None = None

    def estimate(picture: Picture, following: Sequence[Picture]) -> CocMap:
        nonlocal estimator
        if estimator is None:  # loading takes as long as a few frames: only when it is needed
            estimator = EstimateCoc(
                OnnxCocNetwork(find_model("coc").path, device=device), pixel_aspect
            )
        return estimator(picture, following)

    return estimate
