"""The command line's words about light and shadow."""

from __future__ import annotations

import argparse
import math

from nlens_video.core.errors import UsageError
from nlens_video.core.settings import LightSettings
from nlens_video.options.parser import path


def add_light(parser: argparse.ArgumentParser) -> None:
    """The words of `light`."""
    lit = parser.add_argument_group("its light, beside the lights of its file")
    lit.add_argument(
        "--env",
        metavar="MAP.hdr",
        type=path,
        help="light from around: an equirectangular map, .hdr or .exr",
    )
    lit.add_argument(
        "--env-rotation",
        metavar="D",
        type=_finite,
        help="turn the map about the vertical, in degrees",
    )
    lit.add_argument(
        "--env-exposure", metavar="EV", type=_finite, help="brighten the map by so many stops"
    )
    lit.add_argument(
        "--shadow-strength",
        metavar="S",
        type=_strength,
        help="0 none, 1 as the light has it, up to 2; a shadow even without lights",
    )


def light(words: argparse.Namespace) -> LightSettings:
    """What lights the object.

    Raises:
        UsageError: a map is turned or exposed, and there is none.
    """
    for word in ("env_rotation", "env_exposure"):
        if words.env is None and getattr(words, word) is not None:
            raise UsageError(f"--{word.replace('_', '-')} needs a map; give --env MAP.hdr too")
    return LightSettings(
        env=words.env,
        env_rotation_deg=words.env_rotation or 0.0,
        env_exposure_ev=words.env_exposure or 0.0,
        shadow_strength=words.shadow_strength,
    )


def _finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    if not abs(value) <= 1e4:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of usual size")
    return value


def share(text: str) -> float:
    """A number from 0 to 1, from a word."""
    return _up_to(1.0, text)


def _strength(text: str) -> float:
    return _up_to(2.0, text)


def _up_to(most: float, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= most:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to {most:g}")
    return value
