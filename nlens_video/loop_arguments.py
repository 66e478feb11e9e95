"""What a `Compositor` is told, checked where it is said rather than at a later frame."""

from __future__ import annotations

import math
from pathlib import Path
from typing import get_args

from nlens_video.errors import UsageError
from nlens_video.lens import LensFit
from nlens_video.settings import Fallback


def check_settings(*, fps: float, budget_ms: float, fallback: str, track_focus: str) -> None:
    """Refuse what makes no sense.

    Raises:
        UsageError: one of them does not.
    """
    for name, value in (("fps", fps), ("budget_ms", budget_ms)):
        if not 0.0 < value < math.inf:
            raise UsageError(f"{name} = {value} must be above 0, and finite")
    choices = {
        "fallback": (fallback, get_args(Fallback)),
        "track_focus": (track_focus, ("auto", "off")),
    }
    for name, (chosen, known) in choices.items():
        if chosen not in known:
            raise UsageError(f"{name} = {chosen!r} is not one of {', '.join(known)}")


def as_fit(fit: object) -> LensFit:
    """A lens fit as it is, or read from the path of a saved one.

    Raises:
        UsageError: it is neither.
        LensFitError: the file cannot be read.
    """
    if isinstance(fit, LensFit):
        return fit
    if isinstance(fit, str | Path):
        return LensFit.load(Path(fit))
    raise UsageError(f"fit takes a LensFit or the path of a saved one, not {type(fit).__name__}")


def as_moment(time: float | None) -> float | None:
    """A moment of the animation [s].

    Raises:
        UsageError: it is no finite number.
    """
    if time is None:
        return None
    try:
        moment = float(time)
    except (TypeError, ValueError):
        moment = math.nan
    if not math.isfinite(moment):
        raise UsageError(f"{time = } is no moment; give seconds, or leave it out")
    return moment
