"""Arguments of a `Compositor`: checked when it is made, by the rules of the command line's options.

Messages name Python's parameters where the command line's name options.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from numbers import Integral, Real
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from nlens_video.core.errors import NlensError, UsageError
from nlens_video.core.known_lens import UNKNOWN_LENS
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import NO_OVERRIDES, Aperture, LensOverrides, as_aperture
from nlens_video.core.settings import ObjectSettings
from nlens_video.effects.planner import EFFECTS, EffectRequest
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.pipeline_file import load_compositing_pipeline
from nlens_video.options import table
from nlens_video.options.option import Option
from nlens_video.options.readers import word
from nlens_video.options.to_settings import lens_overrides, object_settings
from nlens_video.stages.r_lens_track import FitTrack, read_fit

PARAMETERS = {
    option.flags[0].lstrip("-").replace("-", "_"): option for option in table.PARAMETERS.values()
}
"""Options that a `Compositor` takes, by the names that the command line gives them today."""
_OF_THE_OBJECT = ("scene", "playback", "placing", "light", "real")
"""Settings that `ObjectSettings` hold."""


def as_positive(name: str, value: object) -> float:
    """A number of any type, such as PyAV's `Fraction` or a scalar of NumPy.

    Raises:
        UsageError: it is none, or not finite, or not above 0.
    """
    number = float(value) if isinstance(value, Real) else math.nan
    if not 0.0 < number < math.inf:
        raise UsageError(f"{name}={value!r}: expected a finite number above 0")
    return number


def as_args(given: Mapping[str, object]) -> argparse.Namespace:
    """Keyword arguments as the command line parses them.

    Args:
        given: by the name of the parameter; None for the option's default.

    Raises:
        UsageError: a value that the option does not take.
    """
    track_focus = given.get("track_focus")
    if track_focus not in (None, "auto", "off"):  # a number of frames needs the file
        raise UsageError(f"track_focus={track_focus!r}: expected one of auto, off")
    args = argparse.Namespace(**{one.attribute: one.initial for one in PARAMETERS.values()})
    for name, value in given.items():
        if value is not None:
            setattr(args, PARAMETERS[name].attribute, _read(name, PARAMETERS[name], value))
    return args


def as_objects(glb: str | Path | ObjectSettings, args: argparse.Namespace) -> ObjectSettings:
    """The object's settings.

    Args:
        glb: its file, or all of its settings.
        args: of `as_args`.

    Raises:
        UsageError: options that contradict each other, or that stand beside `ObjectSettings`.
    """
    if not isinstance(glb, ObjectSettings):
        args.glb = as_path(glb)
        return _under_a_horizon(object_settings(args))
    given = [
        name
        for name, option in PARAMETERS.items()
        if option.feeds.split(".")[0] in _OF_THE_OBJECT
        and getattr(args, option.attribute) != option.initial
    ]
    if given:
        raise UsageError(f"{', '.join(given)}: stand in the ObjectSettings; leave them out")
    return glb


def as_path(glb: object) -> Path:
    """The object's file.

    Raises:
        UsageError: no path.
    """
    if isinstance(glb, str | Path):
        return Path(glb)
    raise _wrong_type("glb", "the path of a file, or ObjectSettings", glb)


def _under_a_horizon(objects: ObjectSettings) -> ObjectSettings:
    """Settings for frames whose camera is not solved: a place is on the ground of a level one."""
    if objects.camera_from is not None:
        return objects
    if objects.on_ground is not None:
        return replace(objects, placing=objects.on_ground.under(), on_ground=None)
    if objects.placing is None and objects.fov_deg is not None:
        raise UsageError("--fov is of a placed object; give --at X,Y too")
    return objects


def as_lens(
    args: argparse.Namespace, *, fps: float, fit: LensFit | str | Path | None,
    aperture: Aperture | str | None, optics: LensOverrides | None,
) -> LensRequest:  # fmt: skip
    """How the lens is found and simulated.

    Args:
        args: of `as_args`.
        fps: frames per second [1/s].
        fit: the lens, when it is known beforehand.
        aperture: its shape.
        optics: in place of `vignetting` and `distortion`.

    Raises:
        UsageError: a preset or effects that do not exist, an argument of another type, or an option
            given twice.
        LensFitError: the saved fit cannot be read.
    """
    load_compositing_pipeline(args.preset)
    EffectRequest.parse(args.effects)
    aperture = "auto" if aperture is None else aperture
    if not isinstance(aperture, Aperture | str):
        raise _wrong_type("aperture", "an Aperture, or text such as 7:15 or heart.png", aperture)
    given, optics = lens_overrides(args), NO_OVERRIDES if optics is None else optics
    if not isinstance(optics, LensOverrides):
        raise _wrong_type("optics", "LensOverrides", optics)
    if NO_OVERRIDES not in (given, optics):
        raise UsageError("optics holds vignetting and distortion; leave those out")
    return LensRequest(
        preset=args.preset, effects=args.effects, fit=None if fit is None else as_fit(fit),
        fallback=args.fallback, device=args.device, frame_s=1.0 / fps,
        shutter_deg=args.shutter, aperture=as_aperture(aperture, args.cat_eye),
        optics=given if optics == NO_OVERRIDES else optics,
        known=replace(args.lens or UNKNOWN_LENS, prefer=args.prefer), fit_region=args.fit_region,
        live=args.track_focus == "auto",
    )  # fmt: skip


def as_fit(fit: object) -> LensFit | FitTrack:
    """A lens fit as it is, or read from the path of a saved one, with its track where it has one.

    Raises:
        UsageError: it is neither.
        LensFitError: the file cannot be read.
    """
    if isinstance(fit, LensFit):
        return fit
    if isinstance(fit, str | Path):
        return read_fit(Path(fit))
    raise _wrong_type("fit", "a LensFit or the path of a saved one", fit)


def _wrong_type(name: str, expected: str, value: object) -> UsageError:
    return UsageError(f"{name} takes {expected}, not {type(value).__name__}")


def as_moment(time: float | None, number: int | None) -> tuple[float | None, int | None]:
    """The time of a frame in the animation [s], and its position in the plate [1], where given.

    Raises:
        UsageError: the time is not a finite number, or the position no whole one from 0 on.
    """
    time_s = index = None
    if time is not None:
        try:
            time_s = float(time)
        except (TypeError, ValueError):
            time_s = math.nan
        if not math.isfinite(time_s):
            raise UsageError(f"{time = } is not a time; give seconds, or leave it out")
    if number is not None:
        index = int(number) if isinstance(number, Integral) else -1
        if index < 0:
            raise UsageError(f"{number = } is not a position; give 0, 1, 2, ..., or leave it out")
    return time_s, index


def _read(name: str, option: Option, value: object) -> object:
    """A value as the option's reader makes it from text."""
    if not option.takes_value:
        if not isinstance(value, bool | np.bool_):
            raise UsageError(f"{name}={value!r}: expected True or False")
        return bool(value)
    if option.nargs == "?" and value is True:
        return option.const
    if isinstance(value, bytes):  # a sequence of numbers, too
        raise _wrong_type(name, "text or numbers", value)
    text = str(value)
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str):
        text = ",".join(str(one) for one in value)
    if option.choices is not None and text not in option.choices:
        raise UsageError(f"{name}={value!r}: expected one of {', '.join(option.choices)}")
    try:
        return (option.type or word)(text)
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"{name}={value!r}: {error}") from None


_BY_FLAG = {flag: name for name, option in PARAMETERS.items() for flag in option.flags}
_NUMBER = r"-?\d[\d.]*"
_PLACEHOLDER = re.compile(r"[A-Z][A-Z0-9,]*(\.[a-z]+)?")
_FLAG = re.compile(r"--(?P<name>[a-z][a-z-]*)(?P<gap>[ =](?P<value>[^\s;:()]*[^\s;:(),.]))?")
_VALUES = frozenset(
    [*EFFECTS, "auto", "all", "none", "off", "round", "draft", "realtime", "standard"]
    + ["reference", "paper"]
    + [choice for option in PARAMETERS.values() for choice in option.choices or ()]
)


@contextmanager
def naming_parameters() -> Iterator[None]:
    """Errors from the body name Python's parameters, not the command line's options."""
    try:
        yield
    except NlensError as error:
        error.args = (in_python(str(error)),)
        raise


def in_python(message: str) -> str:
    """A message with the command line's options as Python's parameters.

    >>> in_python("--at 0.4,0.2 lies above the horizon (--horizon 0.5); see --plan")
    'at=(0.4, 0.2) lies above the horizon (horizon=0.5); see --plan'
    """
    return _FLAG.sub(_parameter, message)


def _parameter(found: re.Match[str]) -> str:
    name = _BY_FLAG.get(f"--{found['name']}")
    if name is None:
        return found[0]
    value = found["value"]
    if value is None:
        return name
    if re.fullmatch(_NUMBER, value):
        return f"{name}={value}"
    if re.fullmatch(rf"{_NUMBER}(,{_NUMBER})+", value):
        return f"{name}=({value.replace(',', ', ')})"
    if all(one.lstrip("+-") in _VALUES for one in value.split(",")):
        return f'{name}="{value}"'
    if _PLACEHOLDER.fullmatch(value):
        return name
    return f"{name}{found['gap']}"
