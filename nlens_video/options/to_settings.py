"""Parsed options as `Settings`: each option of the table goes to the field that it feeds."""

from __future__ import annotations

import argparse
from typing import Any

from msgspec.structs import replace

from nlens_video.core.errors import UsageError
from nlens_video.core.objects import NO_KEYS, PlaceKeys, Playback
from nlens_video.core.optics import LensOverrides, parse_aperture
from nlens_video.core.placement import GroundPlacing, Placement
from nlens_video.core.scale import ScaleSettings
from nlens_video.core.settings import (
    LightSettings,
    ObjectSettings,
    OutputSettings,
    RealSettings,
    Settings,
    SourceSettings,
)
from nlens_video.options.table import ROWS

_FEEDS = {option.feeds: option.attribute for option in ROWS if option.feeds}
_START = Placement(at=(0.5, 0.8), size=0.35, horizon=None)
"""The placement that `place` varies where no option gives one."""


def settings(args: argparse.Namespace) -> Settings:
    """Settings of `render`, `farm` and `fit`.

    Raises:
        UsageError: options that contradict each other, or values that make no sense.
    """
    defaults = {"effects": "defocus"} if args.command == "fit" else {}
    if _is_gltf(args.input) and not _is_gltf(args.glb):
        raise UsageError(f"the plate comes first, then the object: IN is {args.input}, and the GLB "
                         f"is {args.glb}; swap them")  # fmt: skip
    return Settings(
        source=source_settings(args),
        scene=object_settings(args),
        output=None if args.command == "fit" else output_settings(args),
        aperture=parse_aperture(args.aperture, cat_eye=args.cat_eye),
        optics=lens_overrides(args),
        scale=_scale_beside(args),
        **{**defaults, **_given(args, "run")},
    )


def _is_gltf(name: object) -> bool:
    return str(name).lower().endswith((".glb", ".gltf"))


def source_settings(args: argparse.Namespace) -> SourceSettings:
    """The plate of any command that reads one."""
    return SourceSettings(**_given(args, "source"))


def output_settings(args: argparse.Namespace) -> OutputSettings:
    """The result of `render`, `farm` and `merge`."""
    return OutputSettings(**_given(args, "output"))


def lens_overrides(args: argparse.Namespace) -> LensOverrides:
    """Known vignetting and distortion."""
    return LensOverrides(**_given(args, "optics"))


def object_settings(args: argparse.Namespace) -> ObjectSettings:
    """The object of `render`, `farm` and `fit`.

    Raises:
        UsageError: options that contradict each other.
    """
    light, real = _given(args, "light"), _given(args, "real")
    for field, name in (("env_rotation_deg", "rotation"), ("env_exposure_ev", "exposure")):
        if field in light and "env" not in light:
            raise UsageError(f"--env-{name} needs a map; give --env-map MAP.hdr too")
    if "holdout" in real and real["occlusion"] == "auto":
        raise UsageError("--holdout gives the foreground; leave --occlusion auto out")
    keys = _place_keys(args)
    placing, on_ground = _placings(args, keys)
    scene = _given(args, "scene")
    return ObjectSettings(
        **{**scene, "others": tuple(scene.get("others", ()))},
        keys=keys,
        playback=Playback(**_given(args, "playback")),
        placing=placing,
        on_ground=on_ground,
        light=LightSettings(**light),
        real=RealSettings(**real),
    )


def scale_settings(args: argparse.Namespace) -> ScaleSettings:
    """What tells the plate's scale.

    Raises:
        UsageError: two things tell it, or one only in part.
    """
    return ScaleSettings(**_given(args, "scale"))


def _scale_beside(args: argparse.Namespace) -> ScaleSettings:
    """The scale of a run, whose camera may come from a file."""
    scale = scale_settings(args)
    if args.height is not None and not scale.given and args.camera_from is None:
        raise UsageError(
            f"--height {args.height:g}m: the plate's scale is not known; give --marker SIDE or "
            "--person-height too, or --size in its place"
        )
    if scale.given and args.camera_from is not None:
        raise UsageError(
            "--camera-from gives the scale; give --marker or --person-height to nlens-video solve"
        )
    return scale


def place_settings(args: argparse.Namespace) -> tuple[ObjectSettings, Placement]:
    """The object of `place`, and the placement that is varied; no horizon if none is given."""
    playback = Playback(**_given(args, "playback"))
    objects = ObjectSettings(**_given(args, "scene"), playback=playback)
    placing = _given(args, "placing")
    _check_roll(placing)
    return objects, replace(_START, **placing)


def _given(args: argparse.Namespace, owner: str) -> dict[str, Any]:
    """The fields of one settings class that options give; None leaves the class' default."""
    values = {
        feeds.removeprefix(f"{owner}."): getattr(args, attribute, None)
        for feeds, attribute in _FEEDS.items()
        if feeds.startswith(f"{owner}.")
    }
    return {field: value for field, value in values.items() if value is not None}


def _place_keys(args: argparse.Namespace) -> PlaceKeys:
    """The keys of the first object.

    Raises:
        UsageError: they contradict each other, or what is given for all of the shot.
    """
    given = getattr(args, "keys", None)
    if not given:
        if getattr(args, "interpolation", "smooth") != "smooth":
            raise UsageError("--interpolation is that between keys; give --key too")
        if getattr(args, "at_frame", 0) and args.at is None:
            raise UsageError("--at-frame is the frame of --at; give --at X,Y too, or leave it out")
        return NO_KEYS
    keys = PlaceKeys(keys=tuple(given), interpolation=args.interpolation)
    keys.check_beside(
        [name for name in ("at", "size", "height", "yaw") if getattr(args, name) is not None]
    )
    if args.at_frame and keys.of("at"):
        raise UsageError("--at-frame is the moment of --at, which keys give; leave it out")
    return keys


def _placings(
    args: argparse.Namespace, keys: PlaceKeys
) -> tuple[Placement | None, GroundPlacing | None]:
    """Where the object stands, at its first key: under a given horizon, or on a solved ground."""
    place, ground = _given(args, "placing"), _given(args, "ground")
    for key in keys.of("at")[:1]:
        place["at"] = key.at
    for key in keys.of("yaw")[:1]:
        place["yaw_deg"] = key.yaw_deg
    for key in keys.of("size")[:1]:
        place |= {} if key.size is None else {"size": key.size}
        ground |= {} if key.height_m is None else {"height_m": key.height_m}
    file = getattr(args, "camera_from", None)
    if file is not None and args.fov is not None:
        raise UsageError("--camera-from gives the field of view; leave --fov out")
    if not place and not ground:
        return None, None
    if args.camera is not None:
        raise UsageError("--camera and --at place the object twice; leave one of them out")
    _check_roll(place)
    horizon, roll_deg = place.pop("horizon", None), place.pop("roll_deg", 0.0)
    wish = GroundPlacing(**place, **ground)
    if horizon is None:
        return None, wish
    if file is not None:
        raise UsageError("--camera-from gives the horizon; leave --horizon out")
    return wish.under(horizon, roll_deg), None


def _check_roll(place: dict[str, Any]) -> None:
    if "roll_deg" in place and "horizon" not in place:
        raise UsageError("--roll is that of a given horizon; give --horizon H too")
