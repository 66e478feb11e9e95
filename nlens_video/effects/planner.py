"""Decides which effects are simulated, and why: by `--effects`, or by what the shot calls for."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Literal, cast, get_args

from msgspec import Struct, field
from msgspec.structs import replace

from nlens_video.core.errors import UsageError
from nlens_video.core.optics import Shutter
from nlens_video.effects import scene_calls
from nlens_video.effects.exposure import NEGLIGIBLE_LEVELS
from nlens_video.effects.finding import Finding
from nlens_video.effects.measurement import PLATE_EFFECTS, Measurement
from nlens_video.effects.scene_calls import EACH_FRAME
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX

DEFOCUS = "defocus"
SHADOW = "shadow"
SELF_SHADOW = "self-shadow"
MOTION_BLUR = "motion-blur"
EXPOSURE = "exposure"
REFLECTION = "reflection"
OCCLUSION = "occlusion"
EFFECTS = (
    DEFOCUS, SHADOW, SELF_SHADOW, REFLECTION, OCCLUSION, MOTION_BLUR, EXPOSURE, *PLATE_EFFECTS
)  # fmt: skip
Base = Literal["auto", "all", "none"]
GIVE = "give --holdout PATH or --occlusion auto"
_ON_GROUND = frozenset({SHADOW, REFLECTION})  # what motion blurs beside the object
LEFT_OUT = "left out by --effects"
_NOT_MEASURED = "not measured"
_NOT_LOOKED_FOR = f"what moves is looked for in files, not in streams or stills; {GIVE}"


class EffectRequest(Struct, frozen=True, kw_only=True):
    """The effects that a user asks for.

    Attributes:
        base: `auto` for what the shot calls for, `all` that the pipeline can simulate, or `none`.
        added: effects asked for by name.
        removed: effects left out by name.
    """

    base: Base
    added: frozenset[str] = frozenset()
    removed: frozenset[str] = frozenset()

    @classmethod
    def parse(cls, text: str) -> EffectRequest:
        """Parse the value of `--effects`.

        Args:
            text: `auto`, `all` or `none`, with `+NAME` or `NAME` to add and `-NAME` to leave out,
                separated by commas; signed names alone change `auto`, plain names alone are a list.

        Raises:
            UsageError: an unknown name, two bases, or an effect both added and left out.
        """
        words = [word.strip() for word in text.split(",")]
        bases = [word for word in words if word in get_args(Base)]
        names = [word for word in words if word not in get_args(Base)]
        for name in names:
            _check_name(name)
        if len(set(bases)) > 1:
            raise UsageError(f"--effects {text}: begin with one of {' and '.join(bases)}, not both")
        plain = {name for name in names if name[0] not in "+-"}
        signed = {name for name in names if name[0] in "+-"}
        if not bases and plain and signed:
            raise UsageError(
                f"--effects {text}: a list of names and changes by + or - do not go together; "
                f"write auto,{text} to change what the shot calls for"
            )
        added = frozenset(plain | {name[1:] for name in signed if name[0] == "+"})
        removed = frozenset(name[1:] for name in signed if name[0] == "-")
        if added & removed:
            raise UsageError(
                f"--effects {text}: {', '.join(sorted(added & removed))} is both added and left "
                "out; leave one of them away"
            )
        base = bases[0] if bases else "none" if plain else "auto"
        return cls(base=cast("Base", base), added=added, removed=removed)

    @property
    def possible(self) -> tuple[str, ...]:
        """The effects that it asks for or leaves to the shot."""
        if self.base == "none":
            return tuple(name for name in EFFECTS if name in self.added)
        return tuple(name for name in EFFECTS if name not in self.removed)

    def asks_for(self, effect: str) -> bool:
        """Whether an effect is wanted whatever the shot calls for."""
        return effect in self.added or (self.base == "all" and effect not in self.removed)


def _check_name(word: str) -> None:
    name = word[1:] if word[:1] in ("+", "-") else word
    if name in EFFECTS:
        return
    near = get_close_matches(name, [*get_args(Base), *EFFECTS], n=1)
    meant = f"did you mean {near[0]}? There are" if near else "there are"
    raise UsageError(
        f"--effects: {word!r} is not an effect; {meant}: auto, all, none, and names to list, to "
        f"add (+NAME) or to leave out (-NAME): {', '.join(EFFECTS)}"
    )


class Decision(Struct, frozen=True, kw_only=True):
    """Whether an effect is simulated, and why.

    Attributes:
        effect: its name.
        wanted: whether it is simulated.
        reason: why, for people.
        measured: its strength, None where that is decided on each frame [`unit`].
        threshold: least strength that calls for it [`unit`].
        unit: of both.
        cost_ms: expected cost of a frame, None where that is unknown [ms].
    """

    effect: str
    wanted: bool
    reason: str
    measured: float | None = None
    threshold: float | None = None
    unit: str = ""
    cost_ms: float | None = None


class ShotFacts(Struct, frozen=True, kw_only=True):
    """Facts about a shot that call for effects.

    Attributes:
        lamps: lights, of the file, the options or the environment map, that reach the ground.
        on_object: those that reach the object at any moment.
        sun: whether one of them is a sun that the user gives.
        sun_from_plate: whether the plate alone gives the light, and with it a sun.
        pre_rendered: whether the object is a pre-rendered layer.
        strength: of the shadow, 0 to 2 [1].
        strength_given: whether the user set it, and so asks for a shadow.
        moves: whether object or camera are animated.
        shutter: of the plate.
        measured: measurements on the plate's first pictures, by effect.
        reflectance: of the ground at normal incidence, 0 to 1 [1].
        occlusion: what was found of things in front of the object, None where none was looked for.
    """

    lamps: int = 0
    on_object: int = 0
    sun: bool = False
    sun_from_plate: bool = False
    pre_rendered: bool = False
    strength: float = 1.0
    strength_given: bool = False
    moves: bool = False
    shutter: Shutter = Shutter()
    measured: Mapping[str, Measurement] = field(default_factory=dict)
    reflectance: float = 0.0
    occlusion: Finding | None = None


def decide(requested: str, shot: ShotFacts | None = None) -> tuple[Decision, ...]:
    """Decide on every effect, as `--effects` requests, on a shot; default: nothing but its lens.

    Raises:
        UsageError: as `EffectRequest.parse`, or options that contradict each other.
    """
    asked = EffectRequest.parse(requested)
    shot = shot or ShotFacts()
    strength = f"--shadow-strength {shot.strength:g}"
    if SHADOW in asked.added and shot.strength <= 0.0:
        raise UsageError(f"--effects {requested} asks for a shadow, {strength} for none; drop one")
    if SHADOW in asked.removed and shot.strength_given and shot.strength > 0.0:
        raise UsageError(f"{strength} asks for a shadow, --effects {requested} for none; drop one")
    return tuple(_requested(decision, asked) for decision in _called_for(shot))


def restrict_to_pipeline(
    decisions: tuple[Decision, ...], there: frozenset[str], pipeline: str, requested: str
) -> tuple[Decision, ...]:
    """The decisions that a pipeline can carry out, with nodes for the effects in `there`.

    Raises:
        UsageError: `requested` names an effect that the pipeline has no node for.
    """
    unknown = (_NOT_MEASURED, _NOT_LOOKED_FOR)
    missing = {one.effect for one in decisions if one.wanted or one.reason in unknown} - there
    for one in decisions:
        if one.effect in missing & EffectRequest.parse(requested).added:
            raise UsageError(
                f"--effects {requested}: the pipeline {pipeline!r} has no node for {one.effect}; "
                "use --preset standard"
            )
    reason = f"the pipeline {pipeline} leaves it out"
    drawn = [one.effect for one in decisions if one.wanted and one.effect in there & _ON_GROUND]
    return tuple(
        Decision(effect=one.effect, wanted=False, reason=reason) if one.effect in missing
        else replace(one, reason=f"{one.reason}, on its {' and '.join(drawn)} too")
        if drawn and one.effect == MOTION_BLUR and one.reason.startswith(EACH_FRAME) else one
        for one in decisions
    )  # fmt: skip


def _requested(called_for: Decision, asked: EffectRequest) -> Decision:
    """A decision as `--effects` changes it."""
    effect = called_for.effect
    if effect in asked.removed or (asked.base == "none" and effect not in asked.added):
        return Decision(effect=effect, wanted=False, reason=LEFT_OUT)
    if asked.base == "none":
        return Decision(effect=effect, wanted=True, reason="asked for by --effects")
    if not asked.asks_for(effect) or called_for.wanted:
        return called_for
    reason = f"asked for by --effects; auto leaves it out: {called_for.reason}"
    return replace(called_for, wanted=True, reason=reason)


def _called_for(shot: ShotFacts) -> list[Decision]:
    """The decisions of `auto`."""
    by_scene = {
        DEFOCUS: (
            True,
            f"{EACH_FRAME}: called for where the object's CoC reaches {NEGLIGIBLE_COC_PX:g} px",
        ),
        SHADOW: scene_calls.shadow(shot),
        SELF_SHADOW: scene_calls.self_shadow(shot),
        REFLECTION: scene_calls.reflection(shot),
        OCCLUSION: (False, _NOT_LOOKED_FOR),
        MOTION_BLUR: scene_calls.motion_blur(shot),
    }
    decisions = [
        Decision(effect=effect, wanted=wanted, reason=reason)
        for effect, (wanted, reason) in by_scene.items()
    ]
    if (found := shot.occlusion) is not None:
        decisions[EFFECTS.index(OCCLUSION)] = Decision(
            effect=OCCLUSION, wanted=found.wanted, reason=found.reason, measured=found.certainty,
            threshold=found.threshold,
        )  # fmt: skip
    on_plate = (_measured(effect, shot.measured.get(effect)) for effect in PLATE_EFFECTS)
    return [*decisions, _exposure(shot), *on_plate]


def _measured(effect: str, found: Measurement | None) -> Decision:
    """An effect of the plate's camera."""
    if found is None:
        return Decision(effect=effect, wanted=False, reason=_NOT_MEASURED)
    bound = "reaches" if found.value >= found.threshold else "stays below"
    reason = found.evidence
    if found.model is not None and found.threshold > 0.0:
        reason += f": {found.value:.3g} {found.unit} {bound} {found.threshold:.3g}"
    return Decision(
        effect=effect, wanted=found.called_for, reason=reason, measured=found.value,
        threshold=found.threshold, unit=found.unit,
        cost_ms=found.cost_ms if found.called_for else None,
    )  # fmt: skip


def _exposure(shot: ShotFacts) -> Decision:
    if not shot.shutter.frame_s:
        return Decision(effect=EXPOSURE, wanted=False, reason="a still has no later frame")
    reason = (
        f"{EACH_FRAME}: called for where the plate's light differs from the first frame's by more "
        f"than {NEGLIGIBLE_LEVELS:g} of 255 levels, in full from {2.0 * NEGLIGIBLE_LEVELS:g}"
    )
    return Decision(
        effect=EXPOSURE,
        wanted=True,
        reason=reason,
        threshold=NEGLIGIBLE_LEVELS,
        unit="levels",
        cost_ms=0.5,
    )
