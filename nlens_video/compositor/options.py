"""What a `Compositor` is told, checked where it is said rather than at a later frame."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from nlens_video.core.aperture import Aperture, as_aperture
from nlens_video.core.errors import UsageError
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.lens_models import NO_OVERRIDES, LensOverrides
from nlens_video.core.settings import ObjectSettings
from nlens_video.effects.planner import requested_effects
from nlens_video.graph.lens_request import LensRequest
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.options.lens_options import optics as optics_of
from nlens_video.options.object_options import object_settings
from nlens_video.options.options import parser_of
from nlens_video.options.parser import word

_OF_THE_LENS = frozenset(
    "preset effects fallback device cat_eye vignetting distortion shutter track_focus".split()
)
"""Options that may stand beside `ObjectSettings`."""


def check_settings(*, fps: float, budget_ms: float, track_focus: str) -> None:
    """Refuse what makes no sense.

    Raises:
        UsageError: one of them does not.
    """
    for name, value in (("fps", fps), ("budget_ms", budget_ms)):
        if not isinstance(value, int | float) or not 0.0 < value < math.inf:
            raise UsageError(f"{name}={value!r}: expected a finite number above 0")
    if track_focus not in ("auto", "off"):
        raise UsageError(f"track_focus={track_focus!r}: expected one of auto, off")


def as_words(options: Mapping[str, object]) -> argparse.Namespace:
    """Keyword arguments as the command line's words, read by its own rules.

    Args:
        options: by the name of the option with `_` for `-`; None where nothing is said.

    Raises:
        UsageError: a value that the option does not take.
    """
    actions = {action.dest: action for action in parser_of("render")._actions}
    words = argparse.Namespace(**{name: one.default for name, one in actions.items()})
    for name, value in options.items():
        if value is not None:
            setattr(words, name, _read(name, actions[name], value))
    return words


def as_objects(glb: str | Path | ObjectSettings, words: argparse.Namespace) -> ObjectSettings:
    """The object that the words are about.

    Raises:
        UsageError: `ObjectSettings` with options that are a part of it, or words that contradict.
    """
    if not isinstance(glb, ObjectSettings):
        words.glb = Path(glb)
        return object_settings(words)
    given = [
        action.dest
        for action in parser_of("render")._actions
        if getattr(words, action.dest) != action.default and action.dest not in _OF_THE_LENS
    ]
    if given:
        raise UsageError(f"{', '.join(given)}: stand in the ObjectSettings; leave them out")
    return glb


def as_lens(
    words: argparse.Namespace, *, fps: float, fit: LensFit | str | Path | None,
    aperture: Aperture | str, optics: LensOverrides, shutter_deg: float | None,
) -> LensRequest:  # fmt: skip
    """The lens that the words are about; what can be wrong speaks up here, not at a frame.

    Args:
        words: of `as_words`.
        fps: frames per second [1/s].
        fit: the lens, when it is known beforehand.
        aperture: its shape.
        optics: in place of `vignetting` and `distortion`.
        shutter_deg: in place of `shutter` [deg].

    Raises:
        UsageError: a preset or effects that do not exist, or an option given twice.
        LensFitError: the saved fit cannot be read.
    """
    load_pipeline(words.preset)
    requested_effects(words.effects)
    said = optics_of(words)
    if words.shutter is not None and shutter_deg is not None:
        raise UsageError("shutter and shutter_deg are the same; leave one of them out")
    if NO_OVERRIDES not in (said, optics):
        raise UsageError("optics holds vignetting and distortion; leave those out")
    return LensRequest(
        preset=words.preset, effects=words.effects, fit=None if fit is None else as_fit(fit),
        fallback=words.fallback, device=words.device, frame_s=1.0 / fps,
        shutter_deg=words.shutter if shutter_deg is None else shutter_deg,
        aperture=as_aperture(aperture, words.cat_eye),
        optics=said if optics == NO_OVERRIDES else optics, live=words.track_focus == "auto",
    )  # fmt: skip


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


def _read(name: str, action: argparse.Action, value: object) -> object:
    """A value as the option's own reader makes it from text."""
    if action.nargs == 0:
        return bool(value)
    if action.nargs == "?" and value is True:
        return action.const
    text = str(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        text = ",".join(str(one) for one in value)
    if action.choices is not None and text not in action.choices:
        raise UsageError(f"{name}={value!r}: expected one of {', '.join(action.choices)}")
    reader = action.type if callable(action.type) else word
    try:
        return reader(text)
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"{name}={value!r}: {error}") from None
