"""The command line's words on frames that come at their own pace and must go out in time."""

from __future__ import annotations

import argparse

from nlens_video.options.parser import positive


def add_live(group: argparse._ArgumentGroup) -> None:
    """Add them to the options of a run."""
    group.add_argument(
        "--hold-budget", action="store_true", help="step quality down and up to keep the budget"
    )
    group.add_argument(
        "--late", choices=("keep", "drop"), default="keep",
        help="frames that come faster than they are made: let them wait, or leave the oldest out",
    )  # fmt: skip
    group.add_argument(
        "--reconnect", metavar="SEC", type=positive, default=0.0,
        help="try for so many seconds to open a lost device or URL again",
    )  # fmt: skip
