"""Which effects are simulated, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from nlens_video.core.errors import UsageError
from nlens_video.core.optics import Shutter
from nlens_video.effects.measurement import PLATE_EFFECTS, Measurement
from nlens_video.effects.request import EffectRequest

DEFOCUS = "defocus"
SHADOW = "shadow"
MOTION_BLUR = "motion-blur"
EXPOSURE = "exposure"
REFLECTION = "reflection"
OCCLUSION = "occlusion"
_LEFT_OUT = "left out by --effects"
EFFECTS = (DEFOCUS, SHADOW, REFLECTION, OCCLUSION, MOTION_BLUR, EXPOSURE, *PLATE_EFFECTS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Whether an effect is simulated, and the reason in words.

    Attributes:
        effect: its name.
        wanted: whether it is simulated.
        reason: why.
        measured: how strong it is, None where that is told on each frame [`unit`].
        threshold: from where on it is called for [`unit`].
        unit: of both.
        cost_ms: what a frame is expected to cost, None where nobody knows yet [ms].
    """

    effect: str
    wanted: bool
    reason: str
    measured: float | None = None
    threshold: float | None = None
    unit: str = ""
    cost_ms: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ShotFacts:
    """What a scene calls for.

    Attributes:
        lamps: lights of the file or the environment map that shine on the ground from above.
        surroundings: whether an environment map tells the light from around.
        pre_rendered: whether the object comes as layers that something else has rendered.
        strength: of the shadow, 0 to 2 [1].
        strength_given: whether the user has said it, and so asks for a shadow.
        moves: whether object or camera are animated.
        shutter: of the plate.
        measured: what the plate's first pictures say, by effect.
        reflectance: of the ground seen from straight above, 0 to 1 [1].
        holdout: what tells what really stands in front, in words; empty where nothing does.
        occlusion_by_coc: whether the plate's own blur is to tell it.
    """

    lamps: int = 0
    surroundings: bool = False
    pre_rendered: bool = False
    strength: float = 1.0
    strength_given: bool = False
    moves: bool = False
    shutter: Shutter = Shutter()
    measured: Mapping[str, Measurement] = field(default_factory=dict)
    reflectance: float = 0.0
    holdout: str = ""
    occlusion_by_coc: bool = False


def request(requested: str) -> EffectRequest:
    """Read what `--effects` says.

    Raises:
        UsageError: an unknown name, or a request that contradicts itself.
    """
    return EffectRequest.parse(requested, EFFECTS)


def requested_effects(requested: str) -> tuple[str, ...]:
    """The effects that `--effects` leaves open or asks for.

    Raises:
        UsageError: as `request`.
    """
    return request(requested).possible(EFFECTS)


def decide(requested: str, scene: ShotFacts | None = None) -> tuple[Decision, ...]:
    """Resolve `--effects`.

    Args:
        requested: as `EffectRequest.parse` reads it.
        scene: what the scene calls for; by default nothing but its lens.

    Raises:
        UsageError: as `request`, or a shadow is asked for by one option and refused by another.
    """
    asked = request(requested)
    scene = scene or ShotFacts()
    _check_shadow(requested, asked, scene)
    if asked.base == "none":
        return tuple(
            Decision(
                effect=effect,
                wanted=effect in asked.added,
                reason="asked for by --effects" if effect in asked.added else _LEFT_OUT,
            )
            for effect in EFFECTS
        )
    return tuple(_amended(decision, asked) for decision in _called_for(scene))


def restrict_to_pipeline(
    decisions: tuple[Decision, ...], there: frozenset[str], pipeline: str, requested: str
) -> tuple[Decision, ...]:
    """The decisions that a pipeline can carry out.

    Args:
        decisions: what the scene calls for.
        there: effects that the pipeline has nodes for.
        pipeline: its name.
        requested: what `--effects` said.

    Raises:
        UsageError: an effect is asked for by name that the pipeline has no node for.
    """
    named = request(requested).added
    kept = []
    for decision in decisions:
        if not decision.wanted or decision.effect in there:
            kept.append(decision)
            continue
        if decision.effect in named:
            raise UsageError(
                f"--effects {requested}: the pipeline {pipeline!r} has no node for "
                f"{decision.effect}; use --preset standard"
            )
        reason = f"the pipeline {pipeline} leaves it out"
        kept.append(Decision(effect=decision.effect, wanted=False, reason=reason))
    return tuple(kept)


def _called_for(scene: ShotFacts) -> tuple[Decision, ...]:
    """What the shot calls for, an effect each."""
    reason = "decided on each frame: called for where the object's CoC reaches 0.5 px"
    defocus = Decision(effect=DEFOCUS, wanted=True, reason=reason)
    on_plate = (_measured(effect, scene.measured.get(effect)) for effect in PLATE_EFFECTS)
    on_ground = (_shadow(scene), _reflection(scene), _occlusion(scene))
    return (defocus, *on_ground, _motion_blur(scene), _exposure(scene), *on_plate)


def _amended(called_for: Decision, asked: EffectRequest) -> Decision:
    """What the shot calls for, as `--effects` changes it."""
    effect = called_for.effect
    if effect in asked.removed:
        return Decision(effect=effect, wanted=False, reason=_LEFT_OUT)
    if not asked.asks_for(effect) or called_for.wanted:
        return called_for
    reason = f"asked for by --effects; auto leaves it out: {called_for.reason}"
    return replace(called_for, wanted=True, reason=reason)


def _check_shadow(requested: str, asked: EffectRequest, scene: ShotFacts) -> None:
    strength = f"--shadow-strength {scene.strength:g}"
    if SHADOW in asked.added and scene.strength <= 0.0:
        raise UsageError(f"--effects {requested} asks for a shadow, {strength} for none; drop one")
    if SHADOW in asked.removed and scene.strength_given and scene.strength > 0.0:
        raise UsageError(f"{strength} asks for a shadow, --effects {requested} for none; drop one")


def _measured(effect: str, found: Measurement | None) -> Decision:
    """An effect of the plate's own camera."""
    if found is None:
        return Decision(effect=effect, wanted=False, reason="the plate was not looked at")
    bound = "reaches" if found.value >= found.threshold else "stays below"
    reason = found.evidence
    if found.model is not None and found.threshold > 0.0:
        reason += f": {found.value:.3g} {found.unit} {bound} {found.threshold:.3g}"
    return Decision(
        effect=effect,
        wanted=found.called_for,
        reason=reason,
        measured=found.value,
        threshold=found.threshold,
        unit=found.unit,
        cost_ms=found.cost_ms if found.called_for else None,
    )


def _motion_blur(scene: ShotFacts) -> Decision:
    shutter = scene.shutter
    wanted = False
    if scene.pre_rendered:
        reason = "pre-rendered layers bring their motion blur with them"
    elif not scene.moves:
        reason = "neither object nor camera moves"
    elif not shutter.frame_s:
        reason = "a still has no frame time"
    elif not shutter.open_s:
        reason = "--shutter 0"
    else:
        wanted = True
        reason = (
            "decided on each frame: called for where the object moves by 1 px while the shutter "
            f"is open ({shutter.angle_deg:.4g} degrees, {shutter.source}), on its shadow and "
            "mirror image where they do"
        )
    return Decision(effect=MOTION_BLUR, wanted=wanted, reason=reason)


def _exposure(scene: ShotFacts) -> Decision:
    if not scene.shutter.frame_s:
        reason = "a still has no later frame"
        return Decision(effect=EXPOSURE, wanted=False, reason=reason)
    reason = (
        "decided on each frame: called for where the plate's light differs from the first "
        "frame's by 2 of 255 levels"
    )
    return Decision(
        effect=EXPOSURE, wanted=True, reason=reason, threshold=2.0, unit="levels", cost_ms=0.5
    )


def _shadow(scene: ShotFacts) -> Decision:
    asked_for = scene.strength_given and scene.strength > 0.0
    lit = scene.lamps or scene.surroundings
    wanted = bool(asked_for or (lit and not scene.pre_rendered))
    if scene.strength <= 0.0:
        wanted, reason = False, "--shadow-strength 0"
    elif not lit:
        unlit = "no light is known to fall on the ground, from the GLB or --env"
        reason = (
            f"asked for by --shadow-strength {scene.strength:g}; darkens the contact only: {unlit}"
            if wanted
            else f"{unlit}; --effects auto,+shadow darkens the contact only"
        )
    elif scene.pre_rendered and not wanted:
        reason = (
            "the light that the layers were rendered in is not known; "
            "--effects auto,+shadow casts one by the GLB's lights"
        )
    elif scene.lamps:
        count = f"{scene.lamps} light{'s' if scene.lamps > 1 else ''}"
        reason = f"cast on the ground by {count}, where it touches by the light around too"
    else:
        reason = "where it touches the ground, by the light around; no light casts another"
    return Decision(effect=SHADOW, wanted=wanted, reason=reason)


def _reflection(scene: ShotFacts) -> Decision:
    if scene.reflectance <= 0.0:
        wanted, reason = False, "nothing says that the ground is glossy; --reflect makes it so"
    elif scene.pre_rendered:
        wanted, reason = False, "layers show the object from above only; the GLB is not drawn"
    else:
        wanted = True
        reason = (
            f"--reflect: the ground mirrors {scene.reflectance:g} of the light seen from straight "
            "above, more towards grazing (Schlick)"
        )
    return Decision(effect=REFLECTION, wanted=wanted, reason=reason)


def _occlusion(scene: ShotFacts) -> Decision:
    if scene.holdout:
        wanted, reason = True, f"--holdout {scene.holdout}"
    elif scene.occlusion_by_coc:
        wanted, reason = (
            True,
            "--occlusion auto: where the plate's CoC is certainly of nearer things",
        )
    else:
        wanted = False
        reason = "nothing tells what stands in front; give --holdout PATH or --occlusion auto"
    return Decision(effect=OCCLUSION, wanted=wanted, reason=reason)
