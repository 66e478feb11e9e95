"""Which effects are simulated, and why."""

from __future__ import annotations

from dataclasses import dataclass

from nlens_video.errors import UsageError

DEFOCUS = "defocus"
SHADOW = "shadow"
EFFECTS = (DEFOCUS, SHADOW)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Whether an effect is simulated, and the reason in words."""

    effect: str
    wanted: bool
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Circumstances:
    """What a scene calls for.

    Attributes:
        lamps: lights of the file or the environment map that shine on the ground from above.
        surroundings: whether an environment map tells the light from around.
        pre_rendered: whether the object comes as layers that something else has rendered.
        strength: of the shadow, 0 to 1 [1].
    """

    lamps: int = 0
    surroundings: bool = False
    pre_rendered: bool = False
    strength: float = 1.0


def decide(requested: str, scene: Circumstances | None = None) -> tuple[Decision, ...]:
    """Resolve `--effects`.

    Args:
        requested: `auto`, `none`, or effect names separated by commas.
        scene: what the scene calls for; by default nothing but its lens.

    Raises:
        UsageError: a name that is no effect of this version.
    """
    if requested == "auto":
        reason = "decided on each frame: called for where the object's CoC reaches 0.5 px"
        defocus = Decision(effect=DEFOCUS, wanted=True, reason=reason)
        return (defocus, _shadow(scene or Circumstances()))
    names = [] if requested == "none" else [name.strip() for name in requested.split(",")]
    for name in names:
        if name not in EFFECTS:
            raise UsageError(
                f"--effects: {name!r} is not an effect of this version; there are: auto, none, "
                f"{', '.join(EFFECTS)}"
            )
    return tuple(
        Decision(
            effect=effect,
            wanted=effect in names,
            reason="asked for by --effects" if effect in names else "left out by --effects",
        )
        for effect in EFFECTS
    )


def within(
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
    kept = []
    for decision in decisions:
        if not decision.wanted or decision.effect in there:
            kept.append(decision)
            continue
        if requested != "auto":
            raise UsageError(
                f"--effects {requested}: the pipeline {pipeline!r} has no node for "
                f"{decision.effect}; use --preset standard"
            )
        reason = f"the pipeline {pipeline} leaves it out"
        kept.append(Decision(effect=decision.effect, wanted=False, reason=reason))
    return tuple(kept)


def _shadow(scene: Circumstances) -> Decision:
    wanted = False
    if scene.strength <= 0.0:
        reason = "--shadow-strength 0"
    elif scene.pre_rendered:
        reason = (
            "the light that the layers were rendered in is not known; "
            "--effects defocus,shadow casts one by the GLB's lights"
        )
    elif not (scene.lamps or scene.surroundings):
        reason = (
            "no light is known to fall on the ground, from the GLB or --env; "
            "--effects defocus,shadow darkens the contact only"
        )
    else:
        wanted = True
        count = f"{scene.lamps} light{'s' if scene.lamps > 1 else ''}"
        reason = (
            f"cast on the ground by {count}, where it touches by the light around too"
            if scene.lamps
            else "where it touches the ground, by the light around; no light casts another"
        )
    return Decision(effect=SHADOW, wanted=wanted, reason=reason)
