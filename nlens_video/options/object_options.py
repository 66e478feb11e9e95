"""The command line's words about the object: which animation plays, and where it stands."""

from __future__ import annotations

import argparse

from nlens_video.core.errors import UsageError
from nlens_video.core.placement import LEVEL, Placement
from nlens_video.core.playback import ALL, Playback
from nlens_video.core.settings import ObjectSettings
from nlens_video.options.light_options import light
from nlens_video.options.occlusion_options import real
from nlens_video.options.parser import number, positive


def add_playback(parser: argparse.ArgumentParser) -> None:
    """The words of `playback`."""
    played = parser.add_argument_group("its animation (a moving camera keeps the plate's time)")
    played.add_argument(
        "--animation", metavar="NAME", default=ALL, help="which one plays: name, number, or all"
    )
    played.add_argument("--loop", action="store_true", help="start again, not rest at the end")
    played.add_argument(
        "--animation-speed", metavar="S", type=positive, default=1.0, help="times its own speed (1)"
    )
    played.add_argument(
        "--animation-offset",
        metavar="SEC",
        type=number,
        default=0.0,
        help="start so many seconds into it",
    )


def add_placing(parser: argparse.ArgumentParser) -> None:
    """The words of `placing`."""
    placed = parser.add_argument_group(
        "its place if the GLB has no camera (fractions of the frame)"
    )
    placed.add_argument(
        "--at",
        metavar="X,Y",
        type=_point,
        help="where it touches the ground, from 0,0 (upper left) to 1,1",
    )
    placed.add_argument(
        "--size", metavar="S", type=number, help="its height, 1 is all of the frame's"
    )
    placed.add_argument(
        "--yaw",
        metavar="D",
        type=number,
        help="turn about the vertical in degrees (default 0: its front faces the viewer)",
    )
    placed.add_argument(
        "--fov",
        metavar="DEG",
        type=_angle,
        help="the plate's field of view across the frame, 1 to 170",
    )
    placed.add_argument(
        "--horizon",
        metavar="H",
        type=number,
        help="row of the plate's horizon (default 0.5: a level camera)",
    )


def object_settings(words: argparse.Namespace) -> ObjectSettings:
    """The object of `render` and `fit`."""
    return ObjectSettings(
        glb=words.glb,
        camera=words.camera,
        layers=words.layers,
        ground_y=words.ground_y,
        playback=playback(words),
        placing=_own_place(words),
        footprint=words.footprint,
        light=light(words),
        real=real(words),
        scene=words.scene,
        fov_deg=words.fov,
    )


def playback(words: argparse.Namespace) -> Playback:
    """Which animation plays, and when."""
    return Playback(
        animation=words.animation,
        loop=words.loop,
        speed=words.animation_speed,
        offset_s=words.animation_offset,
    )


def placing(
    words: argparse.Namespace, at: tuple[float, float], size: float, horizon: float
) -> Placement:
    """Where the object stands, and what stands in for words that were not given."""
    return Placement(
        at=at if words.at is None else words.at,
        size=size if words.size is None else words.size,
        yaw_deg=0.0 if words.yaw is None else words.yaw,
        horizon=horizon if words.horizon is None else words.horizon,
    )


def _own_place(words: argparse.Namespace) -> Placement | None:
    given = (words.at, words.size, words.yaw, words.horizon)
    if given == (None,) * 4:
        if words.fov is not None:
            raise UsageError("--fov is of a placed object; give --at X,Y and --size S too")
        return None
    if words.at is None or words.size is None:
        raise UsageError(
            "to place the object give both --at X,Y and --size S, fractions of the frame"
        )
    if words.camera is not None:
        raise UsageError("--camera and --at place the object twice; leave one of them out")
    return placing(words, words.at, words.size, LEVEL)


def _angle(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 1.0 <= value <= 170.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not an angle from 1 to 170 degrees")
    return value


def _point(text: str) -> tuple[float, float]:
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y, such as 0.5,0.8") from None
    return x, y
