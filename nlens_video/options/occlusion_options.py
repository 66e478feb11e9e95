"""The command line's words about the plate's own things: what hides the object, what mirrors it."""

from __future__ import annotations

import argparse

from nlens_video.core.errors import UsageError
from nlens_video.core.settings import REFLECTANCE, RealSettings
from nlens_video.options.light_options import share


def add_real(parser: argparse.ArgumentParser) -> None:
    """The words of `real`."""
    real = parser.add_argument_group("the plate's own things")
    real.add_argument(
        "--holdout", metavar="PATH", help="matte of what is in front (white), or EXR with depth Z"
    )
    real.add_argument(
        "--occlusion", choices=("none", "auto"), default="none", help="auto: by the plate's blur"
    )
    real.add_argument(
        "--reflect",
        metavar="R",
        type=share,
        nargs="?",
        const=REFLECTANCE,
        help=f"the ground mirrors so much from above (default {REFLECTANCE:g}), more at a slant",
    )


def real(words: argparse.Namespace) -> RealSettings:
    """What the plate's own things do to the object.

    Raises:
        UsageError: two sources for what stands in front.
    """
    if words.holdout is not None and words.occlusion == "auto":
        raise UsageError("--holdout tells what is in front; leave --occlusion auto out")
    return RealSettings(holdout=words.holdout, occlusion=words.occlusion, reflectance=words.reflect)
