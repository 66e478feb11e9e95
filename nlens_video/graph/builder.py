"""Builds the graph of a run: what its nodes depend on, and the nodes of a pipeline file."""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.settings import REFLECTANCE, ObjectSettings
from nlens_video.effects.finding import Finding
from nlens_video.effects.planner import DEFOCUS, OCCLUSION, Decision, EffectRequest
from nlens_video.graph.base.begun_coc import BegunCoc
from nlens_video.graph.base.context import (
    NodeContext,
    ShadowScene,
)
from nlens_video.graph.base.node import LANES, Lane, Node, Unavailable
from nlens_video.graph.base.object_source import RenderedObject, open_object
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.timeline import moments_of
from nlens_video.graph.base.view import View, begins_in_frame
from nlens_video.graph.effect_plan import EffectPlan, LensRequest, plan_effects
from nlens_video.graph.nodes.camera import overscan_px
from nlens_video.graph.occlusion_source import open_occlusion_source
from nlens_video.graph.pipeline_file import PipelineFile
from nlens_video.networks.device import DeviceChoice
from nlens_video.networks.lazy import lazy_depth_order, lazy_lens_network, lazy_sun_reader
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight


def open_dependencies(
    objects: ObjectSettings,
    lens: LensRequest,
    view: View,
    device: DeviceChoice,
    scene: Scene,
    pipeline: PipelineFile,
    plate: PlatePreview,
    profiler: Profiler,
    coc: BegunCoc,
) -> tuple[NodeContext, EffectPlan]:
    """Decide on the effects and open what their nodes depend on; begin F on the first frame.

    Raises:
        UsageError: effects or a given distortion make no sense.
        SceneError: there is no node of the footprint's name.
        InputError: layers, holdout or environment map cannot be read.
    """
    ground = replace(shadow_scene(objects, scene), moments=moments_of(scene, view.length_s))
    request = EffectRequest.parse(lens.effects)
    possible = pipeline.effects.intersection(request.possible)
    again = plate.again if OCCLUSION in possible else None
    reads_first = plate.begins_run and DEFOCUS in possible and lens.fit is None
    reads_first = reads_first and objects.layers is None and begins_in_frame(scene, view)
    with ThreadPoolExecutor(1, "nlens-occlusion") as beside:  # while the effects are measured
        opening = beside.submit(
            open_occlusion_source, objects, scene, view, coc, again, plate.survey, ground.light,
            asked_for=request.asks_for(OCCLUSION),
        )  # fmt: skip

        def found_in_front() -> Finding | None:
            if reads_first and (pictures := plate.pictures()):
                coc.begin(pictures)  # while the shot is still looked at
            return opening.result()[1]

        effects = plan_effects(
            lens, pipeline, objects, scene, ground, found_in_front, plate, profiler, view
        )
    view = replace(view, overscan_px=overscan_px(scene, view, effects.measured))
    source = open_object(objects, scene, view, ground.light)
    given = objects.real.reflectance
    context = NodeContext(
        objects=source,
        estimate_coc=coc,
        ground_y=objects.ground_y,
        fallback_constant=lens.fallback == "constant",
        pixel_aspect=view.pixel_aspect,
        known_lens=lens.known,
        tagged_lens=lens.tagged,
        fit_region=lens.fit_region,
        unit_m=view.unit_m,
        aperture=effects.aperture,
        renderer=source.renderer if isinstance(source, RenderedObject) else None,
        read_lens=lazy_lens_network(),
        read_sun=lazy_sun_reader(),
        repair=lazy_depth_order(view.pixel_aspect, device),
        spread=device.spread,
        shadow_scene=ground,
        shutter=effects.shutter,
        measured=effects.measured,
        occlusion=opening.result()[0],
        reflectance=REFLECTANCE if given is None else given,
        first_lit_frame=plate.first_lit_frame,
    )
    return context, effects


def shadow_scene(objects: ObjectSettings, scene: Scene) -> ShadowScene:
    """Geometry and lighting of the shadow: the posed scene, lights and environment map.

    Raises:
        InputError: the environment map cannot be read.
    """
    light, environment = objects.light, None
    if light.env is not None:
        from nlens_video.scene.environment import load_environment

        exposure_ev = light.env_exposure_ev or 0.0
        environment = load_environment(light.env, light.env_rotation_deg, exposure_ev)
    given = light.shadow_strength
    known = [one.kind for part in scene.parts for _, one in part.lights]
    if light.sun is not None:  # it stands in for the file's
        known = [kind for kind in known if kind != "directional"]
    return ShadowScene(
        pose=scene.pose,
        light=SceneLight(len(known), environment, light.env_exposure_ev is not None, light.sun),
        pre_rendered=objects.layers is not None,
        strength=1.0 if given is None else given,
        strength_given=given is not None,
    )


Built = MutableMapping[tuple[str, str], Node]
"""Nodes by name and options, which graphs of one run share."""


class Graph(Struct, frozen=True, kw_only=True, dict=True):
    """The nodes of a run, in order.

    Attributes:
        pipeline: name of the pipeline file.
        summary: what it does.
        nodes: those that were built.
        left_out: name of each node that was not, and why.
        notes: fallbacks in use, and why.
    """

    pipeline: str
    summary: str
    nodes: tuple[Node, ...]
    left_out: tuple[tuple[str, str], ...]
    notes: tuple[str, ...] = ()

    @cached_property
    def _lanes(self) -> dict[str, tuple[Node, ...]]:
        return {lane: tuple(node for node in self.nodes if node.lane == lane) for lane in LANES}

    def has(self, name: str) -> bool:
        """Whether a node of that name was built."""
        return any(node.name == name for node in self.nodes)

    @property
    def stateful(self) -> tuple[Node, ...]:
        """Nodes whose result depends on all earlier frames."""
        return tuple(node for node in self.nodes if node.stateful)

    @property
    def find_lens(self) -> tuple[Node, ...]:
        """The nodes that find the lens, and the object's bounds before them."""
        return tuple(node for node in self.nodes if node.once or node.writes == "bounds")

    def lane(self, name: Lane) -> tuple[Node, ...]:
        """The nodes of one lane."""
        return self._lanes[name]


def build(
    pipeline: PipelineFile,
    effects: Sequence[Decision],
    context: NodeContext,
    *,
    fit_given: bool,
    built: Built | None = None,
) -> Graph:
    """Construct the nodes of the effects that are simulated.

    Args:
        pipeline: the file.
        effects: which effects are simulated.
        context: dependencies of the nodes.
        fit_given: whether the lens is known already; then nothing that finds it is built.
        built: nodes of other graphs of the run, shared where name and options are the same;
            extended by new ones.

    Raises:
        UsageError: an option that a node cannot take.
    """
    built = {} if built is None else built
    unwanted = {decision.effect: decision.reason for decision in effects if not decision.wanted}
    nodes: list[Node] = []
    left_out: list[tuple[str, str]] = []
    missing: dict[str, str] = {}
    notes: dict[str, None] = dict.fromkeys(pipeline.notes)
    for spec in pipeline.nodes:
        effect = spec.type.effect
        if effect is not None and effect in unwanted:
            left_out.append((spec.name, f"{effect}: {unwanted[effect]}"))
        elif fit_given and spec.type.once:
            left_out.append((spec.name, "the lens fit is given"))
        elif spec.fallback_for is not None and spec.fallback_for not in missing:
            left_out.append((spec.name, f"not needed: {spec.fallback_for} runs"))
        else:
            try:
                key = (spec.name, repr(sorted(spec.options.items())))
                if key not in built:
                    built[key] = spec.type(context, **spec.options)
                nodes.append(built[key])
            except Unavailable as reason:
                left_out.append((spec.name, str(reason)))
                missing[spec.name] = str(reason)
                continue
            if spec.fallback_for is not None:
                notes[missing[spec.fallback_for]] = None
    return Graph(
        pipeline=pipeline.name,
        summary=pipeline.summary,
        nodes=tuple(nodes),
        left_out=tuple(left_out),
        notes=tuple(notes),
    )
