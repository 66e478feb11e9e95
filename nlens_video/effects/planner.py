"""Which effects are simulated, and why."""

from __future__ import annotations

from dataclasses import dataclass

from nlens_video.errors import UsageError

DEFOCUS = "defocus"
EFFECTS = (DEFOCUS,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Whether an effect is simulated, and the reason in words."""

    effect: str
    wanted: bool
    reason: str


def decide(requested: str) -> tuple[Decision, ...]:
    """Resolve `--effects`.

    Args:
        requested: `auto`, `none`, or effect names separated by commas.

    Raises:
        UsageError: a name that is no effect of this version.
    """
    if requested == "auto":
        reason = "decided on each frame: called for where the object's CoC reaches 0.5 px"
        return (Decision(effect=DEFOCUS, wanted=True, reason=reason),)
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
