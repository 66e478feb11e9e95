"""Parsed options as `Settings`: each option of the table goes to the field that it feeds."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from nlens_video.core.aperture import parse_aperture
from nlens_video.core.errors import UsageError
from nlens_video.core.lens_models import LensOverrides
from nlens_video.core.placement import LEVEL, Placement
from nlens_video.core.playback import Playback
from nlens_video.core.settings import (
    LightSettings,
    ObjectSettings,
    OutputSettings,
    PlaceSettings,
    RealSettings,
    Settings,
    SourceSettings,
)
from nlens_video.options.table import ROWS

_FEEDS = {option.feeds: option.attribute for option in ROWS if option.feeds}
_START = Placement(at=(0.5, 0.8), size=0.35, horizon=0.4)
"""What `place` shows where nothing is said."""


def settings(words: argparse.Namespace) -> Settings:
    """Settings of `render`, `farm` and `fit`.

    Raises:
        UsageError: options that contradict each other, or values that make no sense.
    """
    defaults = {"effects": "defocus"} if words.command == "fit" else {}
    return Settings(
        source=source_settings(words),
        scene=object_settings(words),
        output=None if words.command == "fit" else output_settings(words),
        aperture=parse_aperture(words.aperture, cat_eye=words.cat_eye),
        optics=lens_overrides(words),
        **{**defaults, **_given(words, "run")},
    )


def source_settings(words: argparse.Namespace) -> SourceSettings:
    """The plate of any command that reads one."""
    return SourceSettings(**_given(words, "source"))


def output_settings(words: argparse.Namespace) -> OutputSettings:
    """The result of `render`, `farm` and `merge`."""
    return OutputSettings(**_given(words, "output"))


def lens_overrides(words: argparse.Namespace) -> LensOverrides:
    """What is known of the lens beside its focus."""
    return LensOverrides(**_given(words, "optics"))


def object_settings(words: argparse.Namespace) -> ObjectSettings:
    """The object of `render`, `farm` and `fit`.

    Raises:
        UsageError: options that contradict each other.
    """
    light, real = _given(words, "light"), _given(words, "real")
    for field, name in (("env_rotation_deg", "rotation"), ("env_exposure_ev", "exposure")):
        if field in light and "env" not in light:
            raise UsageError(f"--env-{name} needs a map; give --env-map MAP.hdr too")
    if "holdout" in real and real["occlusion"] == "auto":
        raise UsageError("--holdout tells what is in front; leave --occlusion auto out")
    return ObjectSettings(
        **_given(words, "scene"),
        playback=Playback(**_given(words, "playback")),
        placing=_placement(words),
        light=LightSettings(**light),
        real=RealSettings(**real),
    )


def place_settings(words: argparse.Namespace) -> PlaceSettings:
    """Settings of `place`."""
    return PlaceSettings(
        source=source_settings(words),
        scene=ObjectSettings(
            **_given(words, "scene"), playback=Playback(**_given(words, "playback"))
        ),
        start=replace(_START, **_given(words, "placing")),
        output=words.output,
    )


def _given(words: argparse.Namespace, owner: str) -> dict[str, Any]:
    """The fields of one settings class that options give; None leaves the class' default."""
    values = {
        feeds.removeprefix(f"{owner}."): getattr(words, attribute, None)
        for feeds, attribute in _FEEDS.items()
        if feeds.startswith(f"{owner}.")
    }
    return {field: value for field, value in values.items() if value is not None}


def _placement(words: argparse.Namespace) -> Placement | None:
    place = _given(words, "placing")
    if not place:
        if words.fov is not None:
            raise UsageError("--fov is of a placed object; give --at X,Y and --size S too")
        return None
    if "at" not in place or "size" not in place:
        raise UsageError(
            "to place the object give both --at X,Y and --size S, fractions of the frame"
        )
    if words.camera is not None:
        raise UsageError("--camera and --at place the object twice; leave one of them out")
    return Placement(**{"horizon": LEVEL, **place})
