"""The command line's words about effects of the camera."""

from __future__ import annotations

import argparse


def add_effects(parser: argparse.ArgumentParser) -> None:
    """Which effects are simulated, and what nobody can see on the plate."""
    camera = parser.add_argument_group("effects of the camera")
    camera.add_argument(
        "--effects", default="auto", metavar="E", help="auto, none, or names, which --plan lists"
    )
    camera.add_argument(
        "--shutter", metavar="D", type=_angle, help="open D of a frame's 360 degrees (default: 180)"
    )


def _angle(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 360.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not an angle from 0 to 360 degrees")
    return value
