"""Entry point of the command `nlens-video` and of `python -m nlens_video`."""

# `signal` loads enumerations first, during which an interrupt would end in a traceback
import _signal  # type: ignore[import-not-found]  # type checkers have no stub of it
import os
import sys

_INTERRUPTED = 130


def main() -> int:
    """Run the program; an interrupt that comes while it is still loading ends it at once."""
    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, _end)
    from nlens_video.cli.loading import loading

    with loading():
        from nlens_video.cli.main import main as run  # here: loading takes a while
    return run()


def _end(number: int, frame: object) -> None:
    os._exit(_INTERRUPTED)  # nothing is open yet, and an exception would end in a traceback


if __name__ == "__main__":
    sys.exit(main())
