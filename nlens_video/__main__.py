"""Entry point of the command `nlens-video` and of `python -m nlens_video`."""

import os
import signal
import sys
from types import FrameType

_INTERRUPTED = 130


def main() -> int:
    """Run the program; an interrupt that comes while it is still loading ends it at once."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    from nlens_video.cli import main as run  # here: loading takes a while

    return run()


def _end(number: int, frame: FrameType | None) -> None:
    os._exit(_INTERRUPTED)  # nothing is open yet, and an exception would end in a traceback


if __name__ == "__main__":
    sys.exit(main())
