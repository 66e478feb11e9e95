"""The command line's words about effects of the camera."""

from __future__ import annotations

import argparse

from nlens_video.core.lens_models import LensOverrides
from nlens_video.core.settings import TrackFocus


def add_effects(parser: argparse.ArgumentParser) -> None:
    """Which effects are simulated, and what nobody can see on the plate."""
    camera = parser.add_argument_group("effects of the camera")
    camera.add_argument(
        "--effects", default="auto", metavar="E",
        help="auto, all, none, names, or auto,+shadow,-grain; --plan says why each is on or off",
    )  # fmt: skip
    camera.add_argument(
        "--shutter",
        metavar="D",
        type=_angle,
        help="how long the shutter is open, 360 is all of a frame (default: read, else 180)",
    )
    camera.add_argument(
        "--vignetting", metavar="STOPS", type=_stops, help="light lost at the corners, 0 for none"
    )
    camera.add_argument(
        "--distortion",
        metavar="K1[,K2]",
        type=_coefficients,
        help="radial coefficients as OpenCV defines them, 0 for none",
    )


def optics(words: argparse.Namespace) -> LensOverrides:
    """What is known of the lens beside its focus."""
    return LensOverrides(
        vignetting_stops=getattr(words, "vignetting", None),
        distortion=getattr(words, "distortion", None),
    )


def _stops(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 8.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a loss of light from 0 to 8 stops")
    return value


def _coefficients(text: str) -> tuple[float, float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(abs(number) <= 10.0 for number in numbers):
        raise argparse.ArgumentTypeError(f"{text!r} is not K1 or K1,K2, such as -0.12,0.01")
    return numbers[0], numbers[1] if len(numbers) == 2 else 0.0


def add_tracking(parser: argparse.ArgumentParser) -> None:
    """Whether a lens that changes is followed."""
    parser.add_argument(
        "--track-focus", metavar="T", type=_tracking, default="auto",
        help="follow a lens that changes: auto, off, or every N frames (files)",
    )  # fmt: skip


def _tracking(text: str) -> TrackFocus:
    if text == "auto":
        return "auto"
    if text == "off":
        return "off"
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not auto, off or a number of frames")
    return int(text)


def _angle(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 360.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not an angle from 0 to 360 degrees")
    return value
