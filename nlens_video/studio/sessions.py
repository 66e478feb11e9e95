"""Sessions of the pipeline that draw one frame after the other, the object moved in between."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Literal

from msgspec.structs import replace

from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import LensOverrides
from nlens_video.core.settings import ObjectSettings, OutputSettings, Settings, SunSettings
from nlens_video.effects.planner import (
    OCCLUSION,
    REFLECTION,
    SHADOW,
    Decision,
    EffectRequest,
)
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.base.objects_on_ground import stage
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.builder import Built, build
from nlens_video.graph.camera_zoom import CameraZoom
from nlens_video.graph.executor import GraphExecutor
from nlens_video.graph.nodes.camera import overscan_px
from nlens_video.graph.nodes.plate_light import EstimateLight
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.graph.session import Session
from nlens_video.scene.scene import Scene
from nlens_video.studio.open_plate import Plate
from nlens_video.video.info import SourceFrame

Picturing = Literal["drag", "light", "rest", "sharp"]
"""How a frame is drawn: while the object or the sun is dragged, as it is rendered, or without a
lens."""
QUICK = ("drag", "light")
"""Pictures while something is dragged."""
_PIPELINES: Mapping[Picturing, str] = {
    "drag": "realtime",
    "light": str(files("nlens_video.studio").joinpath("light.toml")),
}
_AT_REST = {"reference": "standard", "paper": "standard"}
"""Presets that are too slow to look at while one works."""
_OF_THE_SCENE = (SHADOW, REFLECTION, OCCLUSION)
_LIGHT = (EstimateLight.name, repr([]))
_ANY_SUN = SunSettings(azimuth_deg=0.0, elevation_deg=45.0)


def previewed(settings: Settings, kind: Picturing) -> Settings:
    """The shot as it is previewed: nothing is written, and slow presets are replaced."""
    preset = _PIPELINES.get(kind) or _AT_REST.get(settings.preset, settings.preset)
    effects = settings.effects
    if preset != settings.preset:
        # effects that only another pipeline simulates would be refused
        asked = EffectRequest.parse(effects)
        simulated = load_pipeline(preset).effects
        names = [asked.base, *(f"+{one}" for one in sorted(asked.added & simulated))]
        effects = ",".join([*names, *(f"-{one}" for one in sorted(asked.removed))])
    return replace(
        settings, preset=preset, effects=effects, output=OutputSettings(spec="-"), report=None,
        aov=None, timings=None, save_fit=None, hold_budget=False,
    )  # fmt: skip


def without_lens(settings: Settings, decisions: Sequence[Decision]) -> Settings:
    """The shot with what the object does to the ground and what hides it, but no lens or camera.

    Args:
        settings: the shot.
        decisions: which effects it has.
    """
    kept = [one.effect for one in decisions if one.wanted and one.effect in _OF_THE_SCENE]
    return replace(
        settings, effects=",".join(kept) or "none",
        optics=LensOverrides(), shutter_deg=None, aperture=None,
    )  # fmt: skip


def without_sun(objects: ObjectSettings) -> ObjectSettings:
    """The same objects under any sun, or under none: what a session keeps when a sun is moved."""
    sun = objects.light.sun and _ANY_SUN
    return replace(objects, light=replace(objects.light, sun=sun))


def likeliest_sun(session: Session) -> SunSettings | None:
    """The sun that a session read off its plate, None where it looked for none."""
    nodes = (node for node in session.graph.nodes if isinstance(node, EstimateLight))
    return next((node.likeliest_sun for node in nodes), None)


def placed(
    base: Session, settings: Settings, scene: Scene, view: View, *, hold_light: bool
) -> Session:
    """A session with objects and sun at other places; `scene` holds the objects' files.

    With `hold_light` the light from around is that of the session.
    """
    view = replace(view, distortion=base.view.distortion)
    staged = stage(settings.scene, scene, view)
    scene, notes = staged.scene, staged.notes
    view = replace(staged.view, overscan_px=overscan_px(scene, staged.view, base.context.measured))
    shadow, given = base.context.shadow_scene, settings.scene.light.sun
    if shadow is not None:
        shadow = replace(shadow, pose=scene.pose, light=replace(shadow.light, sun=given))
    if base.context.renderer is not None:
        base.context.renderer.rearrange(scene, None if shadow is None else shadow.light)
    objects = base.context.objects
    objects = dataclasses.replace(objects, scene=scene, view=view)  # noqa: TID251 - derives from ABC
    context = replace(
        base.context,
        objects=objects,
        shadow_scene=shadow,
        ground_y=staged.objects.ground_y,
        unit_m=view.unit_m,
    )
    built: Built = {}
    if hold_light:
        for node in base.graph.nodes:
            if isinstance(node, EstimateLight):
                built[_LIGHT] = node.under_sun_of(context)
    warnings = tuple(note for note in base.opening_notes if note in scene.warnings)
    session = replace(base, opening_notes=(*notes, *warnings, *base.graph.notes))
    return rebuilt(session, settings.preset, context, view, built)


def rebuilt(
    session: Session, preset: str, context: NodeContext, view: View, built: Built
) -> Session:
    """A session with new nodes, which know nothing of other places."""
    pipeline = load_pipeline(preset)
    known = session.executor.track or session.executor.fit
    given = known if _fit_given(session) else None
    graph = build(pipeline, session.decisions, context, fit_given=given is not None, built=built)
    scene = context.objects.scene
    profiler = Profiler(session.executor.profiler.budget_ms)
    zoom = None
    if view.zoom_ends(scene):
        zoom = CameraZoom(lambda time_s: context.objects.camera(time_s).fx, 1 / 30)
    executor = GraphExecutor(graph, profiler, given, None, zoom)
    return replace(session, graph=graph, context=context, view=view, executor=executor)


def _fit_given(session: Session) -> bool:
    return any(reason == "the lens fit is given" for _, reason in session.graph.left_out)


def find_lens(executor: GraphExecutor, plate: Plate, frame: SourceFrame) -> LensFit | None:
    """The lens by the first frame; by the one that is shown where the object is out of view."""
    first, *following = plate.first()
    found = executor.find_lens(executor.begin_frame(first, tuple(one.picture for one in following)))
    if found is None and frame.index != first.index:
        found = executor.find_lens(executor.begin_frame(frame))
    return found


def camera_height(session: Session, time_s: float) -> float:
    """Height of the camera over the ground [scene unit]."""
    camera = session.context.objects.camera(time_s)
    return float(camera.world_from_camera[1, 3]) - session.context.ground_height
