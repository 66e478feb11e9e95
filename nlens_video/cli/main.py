"""The command line: parse, run, answer with a line and an exit code."""

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
    make_ready,
    redirect_library_stdout,
    redirect_to_devnull,
    standard_error,
)
from nlens_video.options import options, to_settings

if TYPE_CHECKING:
    from nlens_video.cli.console import Console

INTERRUPTED = 130
_SMALL = ("doctor", "completion", "study")  # load no library that aborts where memory is short


def main(argv: list[str] | None = None) -> int:
    """Run the program; returns its exit code (`interface`: 0, 2 to 6, 130)."""
    if COMPLETING in os.environ:
        complete()
    make_ready()
    words = list(sys.argv[1:] if argv is None else argv)
    if sys.__stderr__ is not None and not faulthandler.is_enabled():
        faulthandler.enable(sys.__stderr__)  # a crash in a library names the line that called it
    with _interruptible():
        code = _answered(words)
    _leave_a_stuck_reader(code)
    return code


def _answered(words: list[str]) -> int:
    try:
        return _run(words)
    except ReaderGone:
        redirect_to_devnull(sys.stdout)
        return 0
    except NlensError as error:
        _say(str(error), error, trace=_verbose(words))
        return error.exit_code
    except MemoryError as error:
        size = f" ({error})" if str(error) else ""
        text = f"memory does not suffice{size}; give a smaller plate or object"
        _say(text, error, trace=_verbose(words))
        return NlensError.exit_code
    except KeyboardInterrupt as interrupt:
        return _interrupted(interrupt)
    except Exception as error:
        if not signals.requested.is_set():
            raise
        return _interrupted(error)  # what a library's start makes of an interrupt


def _interrupted(error: BaseException) -> int:
    kept = getattr(error, "__notes__", None)
    _say("interrupted" if kept else "interrupted, no output written", error)
    # Under `python -m` CPython ends by the signal in place of the code where an interrupt has left
    # an `exec` of text, as it makes dataclasses, caught or not; another one makes it forget that
    # (`run_eval_code_obj` in its Python/pythonrun.c).
    exec("")
    return INTERRUPTED


def _verbose(words: list[str]) -> bool:
    return "-v" in words or "--verbose" in words


def _say(text: str, error: BaseException, *, trace: bool = False) -> None:
    """Print an error as one line, its notes at the end; before it the traceback, if asked for."""
    if trace:
        import traceback

        standard_error().write("".join(traceback.format_exception(error)))
    line = "; ".join([text, *getattr(error, "__notes__", [])])
    standard_error().write(f"nlens-video: {escape_controls(' '.join(line.split()))}\n")


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Other signals end a run as Ctrl-C does; a second one does not disturb the cleaning up."""
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


def _leave_a_stuck_reader(code: int) -> None:
    """End at once where a read (of a camera gone quiet) blocks: Python would wait for it."""
    scheduler = sys.modules.get("nlens_video.graph.scheduler")
    if scheduler is not None and scheduler.reader_blocked():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _run(argv: list[str]) -> int:
    words = options.parse(argv)
    drop_protocol(words)
    if words.command not in _SMALL:
        require_memory()
    refuse_overwriting(words)
    settle_existing(words, overwrite=getattr(words, "overwrite", False))
    if words.command in SIDE_COMMANDS:
        return SIDE_COMMANDS[words.command](words)
    from nlens_video.cli.console import Console

    voice = Console(
        quiet=words.quiet,
        verbose=words.verbose,
        as_json=words.json,
        progress=not getattr(words, "no_progress", True),
        stdout_taken=getattr(words, "output", None) == "-",
    )
    with redirect_library_stdout():
        return _at_work(words, voice)


def _at_work(words: argparse.Namespace, voice: Console) -> int:
    """The commands that make pictures, or what belongs to them."""
    if words.command == "place":
        from nlens_video.cli.placement_sheet import write_contact_sheet

        voice.choices(words.output, write_contact_sheet(to_settings.place_settings(words)))
        return 0
    if words.command == "merge":
        from nlens_video.cli.farm_commands import run_merge

        return run_merge(words, voice)
    if words.command == "farm" and words.jobs is not None:
        from nlens_video.cli.farm_commands import run_jobs

        return run_jobs(words, voice)
    return _composite(words, voice)


def _composite(words: argparse.Namespace, voice: Console) -> int:
    """The commands that take a plate and an object."""
    run = to_settings.settings(words)
    if getattr(words, "plan", False):
        from nlens_video.run.render import plan

        voice.plan(plan(run, all_reasons=words.verbose or words.json))
        return 0
    if words.command == "farm":
        from nlens_video.cli.farm_commands import run_farm

        return run_farm(words, run, voice)
    if words.command == "fit":
        from nlens_video.run.render import find_fit
        from nlens_video.run.sidecar_outputs import tell_missing

        found = find_fit(run)
        voice.fit(found)
        tell_missing(str(found.path), found.missing)
        return 0
    if words.resume:
        from nlens_video.cli.farm_commands import run_resumable

        return run_resumable(words, run, voice)
    if words.as_chunk:
        from nlens_video.cli.farm_commands import run_chunk

        return run_chunk(run, Path(words.output), voice)
    from nlens_video.run.render import render
    from nlens_video.run.sidecar_outputs import tell_missing

    with voice.progress_bar() as on_progress:
        outcome = render(run, on_progress)
    voice.outcome(outcome)
    tell_missing(outcome.output, outcome.missing)
    return 0


if __name__ == "__main__":
    sys.exit(main())
