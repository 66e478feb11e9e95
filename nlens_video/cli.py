"""The command line: parse, run, answer with a line and an exit code."""

from __future__ import annotations

import os
import sys

from nlens_video.arguments import parse, settings
from nlens_video.errors import NlensError, ReaderGone

INTERRUPTED = 130


def main(argv: list[str] | None = None) -> int:
    """Run the program; returns its exit code (`interface`: 0, 2 to 6, 130)."""
    words = list(sys.argv[1:] if argv is None else argv)
    verbose = "-v" in words or "--verbose" in words
    try:
        return _run(words)
    except ReaderGone:
        # Python would complain once more when it flushes standard output at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except NlensError as error:
        if verbose:
            raise_traceback(error)
        print(f"nlens-video: {_one_line(error)}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("nlens-video: interrupted, no output written", file=sys.stderr)
        return INTERRUPTED


def raise_traceback(error: NlensError) -> None:
    """Print the traceback that `-v` asks for."""
    import traceback

    traceback.print_exception(error)


def _one_line(error: NlensError) -> str:
    return " ".join(str(error).split())


def _run(argv: list[str]) -> int:
    words = parse(argv)
    if words.command == "doctor":
        from nlens_video.doctor import examine

        return examine(as_json=words.json)
    from nlens_video.show import Voice

    voice = Voice(
        quiet=words.quiet,
        as_json=words.json,
        progress=not words.no_progress,
        stdout_taken=getattr(words, "output", None) == "-",
    )
    run = settings(words)
    if getattr(words, "plan", False):
        from nlens_video.run import plan

        voice.plan(plan(run))
        return 0
    if words.command == "fit":
        from nlens_video.run import find_fit

        voice.fit(find_fit(run))
        return 0
    from nlens_video.run import render

    with voice.progress_bar() as on_progress:
        outcome = render(run, on_progress)
    voice.outcome(outcome)
    return 0


if __name__ == "__main__":
    sys.exit(main())
