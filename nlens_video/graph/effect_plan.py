"""The lens as a run asks for it, and the effects that it simulates on a shot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.known_lens import UNKNOWN_LENS, KnownLens
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import ROUND, Aperture, LensOverrides, Shutter, assumed_shutter
from nlens_video.core.placement import Region
from nlens_video.core.settings import Device, Fallback, ObjectSettings
from nlens_video.effects.camera.aperture_shape import ApertureReading
from nlens_video.effects.finding import Finding
from nlens_video.effects.measurement import (
    PLATE_EFFECTS,
    Measurement,
    overridden,
)
from nlens_video.effects.planner import (
    DEFOCUS,
    LEFT_OUT,
    MOTION_BLUR,
    OCCLUSION,
    REFLECTION,
    SHADOW,
    Decision,
    EffectRequest,
    ShotFacts,
    decide,
    restrict_to_pipeline,
)
from nlens_video.graph.base.context import ShadowScene
from nlens_video.graph.base.followed_lens import DISTORTION, known_distortion, note_if_straight
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.pipeline_file import PipelineFile
from nlens_video.scene.illumination import on_ball, reaches
from nlens_video.scene.plate_environment import Seat
from nlens_video.scene.scene import Scene
from nlens_video.stages.r_lens_track import FitTrack

_ROUND_ONLY = "aperture: the pipeline {!r} blurs by round discs alone; use --preset standard"


class LensRequest(Struct, frozen=True, kw_only=True):
    """How the lens is found and simulated.

    Attributes:
        preset: shipped pipeline's name or path of a pipeline file.
        effects: `auto`, `none`, or names separated by commas.
        fit: the lens, when it is known beforehand; or how it changes along a file.
        fallback: what stands in for a fit that fails.
        device: where networks and kernels run.
        aperture: shape of its aperture, None for the one that the plate shows.
        shutter_deg: how long the shutter is open, 360 for all of a frame, None if not known [deg].
        frame_s: from one frame to the next, 0 for a still [s].
        exposure_s: how long the shutter is open as the recording states it, if it does [s].
        optics: known vignetting and distortion.
        known: what is known of the lens beforehand.
        tagged: what the recording states of it.
        fit_region: part of the frame whose ground tells the lens, None for all of it.
        live: whether a lens that changes is followed as frames come.
        search_s: how long frames may tell no lens, before that ends the run [s].
        hold_budget: whether quality adapts to keep the frame budget.
    """

    preset: str = "standard"
    effects: str = "auto"
    fit: LensFit | FitTrack | None = None
    fallback: Fallback = "none"
    device: Device = "auto"
    aperture: Aperture | None = None
    shutter_deg: float | None = None
    frame_s: float = 0.0
    exposure_s: float | None = None
    optics: LensOverrides = LensOverrides()
    known: KnownLens = UNKNOWN_LENS
    tagged: KnownLens = UNKNOWN_LENS
    fit_region: Region | None = None
    live: bool = False
    search_s: float = 0.0
    hold_budget: bool = False

    @property
    def shutter(self) -> Shutter:
        """The plate's shutter."""
        if self.shutter_deg is not None:
            return Shutter(
                angle_deg=self.shutter_deg, frame_s=self.frame_s, source="given", given=True
            )
        if self.exposure_s is not None and 0.0 < self.exposure_s <= self.frame_s:
            angle = 360.0 * self.exposure_s / self.frame_s
            return Shutter(angle_deg=angle, frame_s=self.frame_s, source="from metadata")
        return assumed_shutter(self.frame_s)


class EffectPlan(Struct, frozen=True):
    """Decisions on effects, what was measured on the plate, notes for the user."""

    decisions: tuple[Decision, ...]
    measured: Mapping[str, Measurement]
    shutter: Shutter
    aperture: Aperture
    notes: tuple[str, ...]


def plan_effects(
    lens: LensRequest,
    pipeline: PipelineFile,
    objects: ObjectSettings,
    scene: Scene,
    ground: ShadowScene,
    occlusion: Callable[[], Finding | None],
    plate: PlatePreview,
    profiler: Profiler,
    view: View,
) -> EffectPlan:
    """Decide on every effect, from the scene and the plate's first frames.

    Args:
        lens: the request; its `effects` as `EffectRequest.parse` reads them.
        pipeline: what can be simulated.
        objects: ground, occlusion and reflection as the user gives them.
        scene: the object.
        ground: geometry and light of its shadow.
        occlusion: what was found of things in front of it; asked once the plate is measured.
        plate: the shot's first pictures.
        profiler: times the measuring.
        view: the frame; its solved camera may tell the distortion.

    Raises:
        UsageError: an effect that does not exist, or that the pipeline has no node for.
    """
    solved = view.solved
    simulated = pipeline.effects
    possible = simulated.intersection(EffectRequest.parse(lens.effects).possible)
    measured: dict[str, Measurement] = overridden(lens.optics)
    known = known_distortion(lens.optics, solved)
    if known is not None and DISTORTION in possible:
        measured[DISTORTION] = known
    unknown = possible.intersection(PLATE_EFFECTS).difference(measured)
    shutter = lens.shutter
    reads_shutter = (
        MOTION_BLUR in possible and scene.moves and not shutter.given and shutter.frame_s > 0.0
    )
    aperture = lens.aperture or ROUND
    aperture_notes: tuple[str, ...] = ()
    reads_aperture = lens.aperture is None and DEFOCUS in possible
    if unknown or reads_shutter or reads_aperture:
        with profiler.timed(plate.first, "measure"):
            measured.update(plate.measured(unknown))
            if reads_shutter:
                shutter = _read_shutter(shutter, plate.shutter_deg())
            if reads_aperture:
                aperture, aperture_notes = _read_aperture(plate.aperture(view.pixel_aspect))
    if not aperture.round and any(spec.type.round_only for spec in pipeline.nodes):
        aperture_notes = (_ROUND_ONLY.format(pipeline.name),)
    facts = _shot_facts(objects, scene, ground, occlusion(), shutter, measured)
    wanted = decide(lens.effects, facts)
    decisions = restrict_to_pipeline(wanted, simulated, pipeline.name, lens.effects)
    ignored = {one.effect: _why_ignored(one, pipeline, lens.effects) for one in wanted}
    notes = tuple(
        f"{option}: {ignored[effect]}"
        for effect, option in _given_options(objects, lens)
        if ignored[effect]
    )
    if solved is not None and DISTORTION not in simulated:
        notes += note_if_straight(solved, pipeline.name)
    return EffectPlan(decisions, measured, shutter, aperture, (*aperture_notes, *notes))


def _why_ignored(decision: Decision, pipeline: PipelineFile, asked: str) -> str:
    """Why an effect is not simulated whatever option is given for it; empty where it may be."""
    if decision.reason == LEFT_OUT:
        return f"--effects {asked} leaves {decision.effect} out; add it there"
    if decision.wanted and decision.effect not in pipeline.effects:
        return (
            f"the pipeline {pipeline.name!r} has no node for {decision.effect}; "
            "use --preset standard"
        )
    return ""


def _given_options(objects: ObjectSettings, lens: LensRequest) -> Iterator[tuple[str, str]]:
    """Effects that an option of their own asks for or shapes, and that option."""
    real, optics = objects.real, lens.optics
    if objects.light.shadow_strength:
        yield SHADOW, f"--shadow-strength {objects.light.shadow_strength:g}"
    if real.reflectance:
        yield REFLECTION, f"--ground-reflectance {real.reflectance:g}"
    if real.holdout is not None or real.occlusion == "auto":
        yield OCCLUSION, "--occlusion auto" if real.holdout is None else f"--holdout {real.holdout}"
    if optics.vignetting_stops:
        yield "vignetting", f"--vignetting {optics.vignetting_stops:g}"
    if optics.distortion is not None and any(optics.distortion):
        yield DISTORTION, "--distortion {:g},{:g}".format(*optics.distortion)
    if lens.shutter_deg:
        yield MOTION_BLUR, f"--shutter-angle {lens.shutter_deg:g}"
    if lens.aperture is not None and not lens.aperture.round:
        yield DEFOCUS, "--aperture" if lens.aperture.blades or lens.aperture.image else "--cat-eye"


def _read_shutter(assumed: Shutter, angle: float | None) -> Shutter:
    """The shutter as measured from the plate's motion blur [deg], if that shows."""
    if angle is None:
        return assumed
    return replace(assumed, angle_deg=angle, source="measured from the plate's motion blur")


def _read_aperture(found: ApertureReading | None) -> tuple[Aperture, tuple[str, ...]]:
    """The aperture as the plate's highlights show it, and what is said of it."""
    if found is None or found.aperture.round:
        return ROUND, ()
    return found.aperture, (f"aperture: {found}; --aperture round for a disc",)


def _shot_facts(
    objects: ObjectSettings,
    scene: Scene,
    ground: ShadowScene,
    occlusion: Finding | None,
    shutter: Shutter,
    measured: Mapping[str, Measurement],
) -> ShotFacts:
    """The scene at time 0, as effects depend on it, and its lights at any time."""
    posed = ground.pose(0.0)
    height = float(posed.bounds()[0, 1]) if objects.ground_y is None else objects.ground_y
    light = ground.light.on_ground(posed.lights)
    sun = ground.light.sun is not None and ground.light.sun.shines
    return ShotFacts(
        lamps=sum(reaches(lamp, height) for lamp in light.lamps) + sun,
        on_object=_lamps_on_object(ground) + sun,
        sun=sun,
        sun_from_plate=ground.light.taken_from_plate,
        pre_rendered=ground.pre_rendered,
        strength=ground.strength,
        strength_given=ground.strength_given,
        moves=scene.moves,
        shutter=shutter,
        measured=measured,
        reflectance=objects.real.reflectance or 0.0,
        occlusion=occlusion,
    )


def _lamps_on_object(ground: ShadowScene) -> int:
    """Most lights, of the file and the environment map, that reach the object at a moment."""
    if not ground.light.count and ground.light.environment is None:
        return 0
    most = 0
    for time_s in ground.moments:
        posed = ground.pose(time_s)
        seat = Seat.of(posed.bounds(), 0.0)
        lamps = ground.light.on_object(posed.lights).lamps
        most = max(most, sum(on_ball(lamp, seat.middle, seat.radius) > 0.0 for lamp in lamps))
        if all(lamp.posed.light.kind == "directional" for lamp in lamps):
            break  # which reach it anywhere: other moments need not be posed
    return most
