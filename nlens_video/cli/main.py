"""The command line: parse, check files, run; errors become one line and an exit code."""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from nlens_video.cli.commands import COMPLETING, SIDE_COMMANDS, complete
from nlens_video.cli.existing_outputs import settle_existing
from nlens_video.cli.memory import require_memory
from nlens_video.cli.path_guard import drop_protocol, refuse_overwriting
from nlens_video.core import signals
from nlens_video.core.errors import NlensError, ReaderGone
from nlens_video.core.stdio import (
    escape_controls,
    prepare_streams,
    redirect_library_stdout,
    redirect_to_devnull,
    standard_error,
)
from nlens_video.options import parser, to_settings

if TYPE_CHECKING:
    from nlens_video.cli.console import Console

INTERRUPTED = 130
_LIGHT = ("doctor", "completion", "study")  # load no library that aborts without memory


def main(argv: list[str] | None = None) -> int:
    """Run the program; returns its exit code (`interface`: 0, 2 to 6, 130)."""
    if COMPLETING in os.environ:
        complete()
    prepare_streams()
    argv = list(sys.argv[1:] if argv is None else argv)
    if sys.__stderr__ is not None and not faulthandler.is_enabled():
        faulthandler.enable(sys.__stderr__)  # a crash in a library names the line that called it
    with _interruptible():
        code = _exit_code(argv)
    _exit_if_reader_blocks(code)
    return code


def _exit_code(argv: list[str]) -> int:
    try:
        return _run(argv)
    except ReaderGone:
        redirect_to_devnull(sys.stdout)
        return 0
    except NlensError as error:
        _say(str(error), error, trace=_verbose(argv))
        return error.exit_code
    except MemoryError as error:
        size = f" ({error})" if str(error) else ""
        text = f"out of memory{size}; give a smaller plate or object"
        _say(text, error, trace=_verbose(argv))
        return NlensError.exit_code
    except KeyboardInterrupt as interrupt:
        return _interrupted(interrupt)
    except Exception as error:
        if not signals.requested.is_set():
            raise
        return _interrupted(error)  # a library turned the interrupt into another exception


def _interrupted(error: BaseException) -> int:
    kept = getattr(error, "__notes__", None)
    _say("interrupted" if kept else "interrupted, no output written", error)
    # Under `python -m` CPython ends by the signal in place of the code where an interrupt has left
    # an `exec` of text, as it makes dataclasses, caught or not; another one makes it forget that
    # (`run_eval_code_obj` in its Python/pythonrun.c).
    exec("")
    return INTERRUPTED


def _verbose(argv: list[str]) -> bool:
    return "-v" in argv or "--verbose" in argv


def _say(text: str, error: BaseException, *, trace: bool = False) -> None:
    """Print an error as one line, its notes at the end; before it the traceback, if asked for."""
    if trace:
        import traceback

        standard_error().write("".join(traceback.format_exception(error)))
    line = "; ".join([text, *getattr(error, "__notes__", [])])
    standard_error().write(f"nlens-video: {escape_controls(' '.join(line.split()))}\n")


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """SIGTERM and the like end a run as Ctrl-C does; a second one does not disturb the clean-up."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals.requested.clear()
    before = {
        number: signal.signal(number, signals.handler)
        for number in signals.ENDING
        if not signals.stays_ignored(number)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if signals.requested.is_set() else handler)


def _exit_if_reader_blocks(code: int) -> None:
    """Exit at once where a read blocks (a camera that sends nothing): Python would wait for it."""
    scheduler = sys.modules.get("nlens_video.graph.scheduler")
    if scheduler is not None and scheduler.reader_blocked():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _run(argv: list[str]) -> int:
    args = parser.parse(argv)
    drop_protocol(args)
    if args.command not in _LIGHT:
        require_memory()
    refuse_overwriting(args)
    settle_existing(args, overwrite=getattr(args, "overwrite", False))
    if args.command in SIDE_COMMANDS:
        return SIDE_COMMANDS[args.command](args)
    from nlens_video.cli.console import Console

    console = Console(
        quiet=args.quiet,
        verbose=args.verbose,
        as_json=args.json,
        progress=not getattr(args, "no_progress", True),
        stdout_taken=getattr(args, "output", None) == "-",
    )
    with redirect_library_stdout():
        return _dispatch(args, console)


def _dispatch(args: argparse.Namespace, console: Console) -> int:
    """The commands whose results the console shows."""
    if args.command == "place":
        from nlens_video.cli.placement_sheet import write_contact_sheet

        console.choices(args.output, write_contact_sheet(to_settings.place_settings(args)))
        return 0
    if args.command == "merge":
        from nlens_video.cli.farm_commands import run_merge

        return run_merge(args, console)
    if args.command == "farm" and args.jobs is not None:
        from nlens_video.cli.farm_commands import run_jobs

        return run_jobs(args, console)
    return _composite(args, console)


def _composite(args: argparse.Namespace, console: Console) -> int:
    """The commands that composite, or find the lens: `render`, `farm`, `fit`."""
    settings = to_settings.settings(args)
    if getattr(args, "plan", False):
        from nlens_video.run.render import plan

        console.plan(plan(settings, all_reasons=args.verbose or args.json))
        return 0
    if args.command == "farm":
        from nlens_video.cli.farm_commands import run_farm

        return run_farm(args, settings, console)
    if args.command == "fit":
        from nlens_video.run.observers import check_sidecars
        from nlens_video.run.render import find_fit

        found = find_fit(settings)
        console.fit(found)
        check_sidecars(str(found.path), found.missing)
        return 0
    if args.resume:
        from nlens_video.cli.farm_commands import run_resumable

        return run_resumable(args, settings, console)
    if args.as_chunk:
        from nlens_video.cli.farm_commands import run_chunk

        return run_chunk(settings, Path(args.output), console)
    from nlens_video.run.observers import check_sidecars
    from nlens_video.run.render import render

    with console.progress_bar() as on_progress:
        outcome = render(settings, on_progress)
    console.outcome(outcome)
    check_sidecars(outcome.output, outcome.missing)
    return 0


if __name__ == "__main__":
    sys.exit(main())
