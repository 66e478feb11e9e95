"""Decides which effects this run simulates, from the scene and the plate's first frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from nlens_video.core.layers import Picture
from nlens_video.core.optics import LensOverrides, Shutter
from nlens_video.core.settings import RealSettings
from nlens_video.effects.measurement import PLATE_EFFECTS, Measurement, measure_plate, overridden
from nlens_video.effects.planner import (
    MOTION_BLUR,
    Decision,
    ShotFacts,
    decide,
    requested_effects,
    restrict_to_pipeline,
)
from nlens_video.graph.base.context import ShadowScene
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.pipeline_file import PipelineFile
from nlens_video.scene.illumination import reaches
from nlens_video.scene.scene import Scene


@dataclass(frozen=True, slots=True)
class EffectPlan:
    """Decisions on effects, their measurements on the plate, and the shutter."""

    decisions: tuple[Decision, ...]
    measured: Mapping[str, Measurement]
    shutter: Shutter


@dataclass(frozen=True, slots=True)
class PlatePreview:
    """What can be seen of a shot before its first frame is composited.

    Attributes:
        pictures: reads the first ones, perhaps only one; called where an effect asks for them.
        first: number of the frame that the look at them is counted to [1].
    """

    pictures: Callable[[], Sequence[Picture]]
    first: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ShotContext:
    """What can be known of a shot before its first frame is composited.

    Attributes:
        scene: the object.
        ground: what it stands on and what lights it.
        ground_y: height of the ground, None for the object's lowest point [scene unit].
        shutter: of the plate, as far as it is given.
        plate: its first pictures.
        real: what the user says of the plate's own things.
        occlusion_source: description of the source of occlusion, empty if there is none.
        optics: what a person says about the lens.
    """

    scene: Scene
    ground: ShadowScene
    ground_y: float | None
    shutter: Shutter
    plate: PlatePreview
    real: RealSettings
    occlusion_source: str
    optics: LensOverrides = LensOverrides()


def decide_effects(
    requested: str, pipeline: PipelineFile, shot: ShotContext, profiler: Profiler
) -> EffectPlan:
    """Decide on every effect.

    Args:
        requested: as `EffectRequest.parse` reads it.
        pipeline: what can be simulated.
        shot: what is looked at.
        profiler: times the look at the plate.

    Raises:
        UsageError: an effect that does not exist, or that the pipeline has no node for.
    """
    there = frozenset(spec.type.effect for spec in pipeline.nodes if spec.type.effect)
    looked_for = there.intersection(requested_effects(requested), PLATE_EFFECTS)
    measured: dict[str, Measurement] = overridden(shot.optics)
    looked_for = looked_for.difference(measured)
    shutter, smears = shot.shutter, MOTION_BLUR in there.intersection(requested_effects(requested))
    reads_shutter = smears and shot.scene.moves and not shutter.given and shutter.frame_s > 0.0
    if looked_for or reads_shutter:
        with profiler.timed(shot.plate.first, "measure"):
            pictures = shot.plate.pictures()
            measured.update(measure_plate(looked_for, pictures))
            if reads_shutter:
                shutter = _read_shutter(shutter, pictures)
    wanted = decide(requested, _shot_facts(shot, shutter, measured))
    return EffectPlan(
        restrict_to_pipeline(wanted, there, pipeline.name, requested), measured, shutter
    )


def _read_shutter(assumed: Shutter, pictures: Sequence[Picture]) -> Shutter:
    """The shutter as measured from the plate's motion blur, if that shows."""
    from nlens_video.effects.camera.shutter_angle import shutter_angle

    angle = shutter_angle(pictures)
    if angle is None:
        return assumed
    return replace(assumed, angle_deg=angle, source="read off the plate's own smear")


def _shot_facts(
    shot: ShotContext, shutter: Shutter, measured: Mapping[str, Measurement]
) -> ShotFacts:
    """What the scene, as it is at first, calls for."""
    ground = shot.ground
    posed = ground.pose(0.0)
    height = float(posed.bounds()[0, 1]) if shot.ground_y is None else shot.ground_y
    light = ground.light.on_ground(posed.lights)
    return ShotFacts(
        lamps=sum(reaches(lamp, height) for lamp in light.lamps),
        surroundings=ground.light.known and light.ambient is not None,
        pre_rendered=ground.pre_rendered,
        strength=ground.strength,
        strength_given=ground.strength_given,
        moves=shot.scene.moves,
        shutter=shutter,
        measured=measured,
        reflectance=shot.real.reflectance or 0.0,
        holdout="" if shot.real.holdout is None else shot.occlusion_source,
        occlusion_by_coc=shot.real.occlusion == "auto",
    )
