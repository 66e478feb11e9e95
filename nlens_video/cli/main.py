"""The command line: parse, check files, run a command; errors become one line and an exit code."""

from __future__ import annotations

import faulthandler
import os
import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from nlens_video.cli.completion import complete, print_completion
from nlens_video.cli.doctor import examine, require_memory
from nlens_video.cli.library_defaults import set_library_defaults
from nlens_video.cli.loading import loading
from nlens_video.cli.output_files import check_outputs, drop_protocol
from nlens_video.core import errors, signals
from nlens_video.core.errors import MissingCameraError, NlensError, ReaderGone, UsageError
from nlens_video.core.stdio import (
    drop_unwritten,
    escape_controls,
    prepare_streams,
    print_out,
    redirect_library_stdout,
    redirect_to_devnull,
    standard_error,
)
from nlens_video.options import shot_writer, to_settings
from nlens_video.options.parser import parse

if TYPE_CHECKING:
    from nlens_video.cli.console import Console
    from nlens_video.core.settings import Settings

INTERRUPTED = 130
_LIGHT = ("doctor", "completion", "study")  # load no library that aborts without memory
_COMPLETING = "_ARGCOMPLETE"  # environment variable: the shell asks for completions


def main(argv: list[str] | None = None) -> int:
    """Run the program; returns its exit code: 0, 1, 130, or that of an error (`core.errors`)."""
    if _COMPLETING in os.environ:
        complete()
    prepare_streams()
    words = list(sys.argv[1:] if argv is None else argv)
    if sys.__stderr__ is not None and not faulthandler.is_enabled():
        faulthandler.enable(sys.__stderr__)  # a crash in a library names the line that called it
    with signals.interruptible(ends=argv is None):
        code = _exit_code(words)
    _exit_if_reader_blocks(code)
    return code


def _exit_code(argv: list[str]) -> int:
    try:
        return _run(argv)
    except ReaderGone:
        redirect_to_devnull(sys.stdout)
        return 0
    except NlensError as error:
        drop_unwritten(sys.stdout)
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
        if isinstance(error, FileNotFoundError) and _current_folder_is_gone():
            _say("the current folder was deleted; change to one that exists", error)
            return UsageError.exit_code
        if isinstance(error, PermissionError) and error.filename is not None:
            _say(f"{error.filename}: permission denied; give a file that this user may read", error)
            return errors.InputError.exit_code
        if not signals.requested.is_set():
            raise
        return _interrupted(error)  # a library turned the interrupt into another exception


def _current_folder_is_gone() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


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


def _exit_if_reader_blocks(code: int) -> None:
    """Exit at once where a read blocks (a camera that sends nothing): Python would wait for it."""
    scheduler = sys.modules.get("nlens_video.graph.scheduler")
    if scheduler is not None and scheduler.reader_blocked():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _run(argv: list[str]) -> int:
    args = parse(argv)
    drop_protocol(args)
    set_library_defaults()
    if args.command not in _LIGHT:
        require_memory()
    check_outputs(args, overwrite=getattr(args, "overwrite", False))
    if getattr(args, "save_shot", None) is not None:
        shot_writer.save(args.save_shot, args.given)
    if args.command in _COMMANDS:
        return _COMMANDS[args.command](args)
    with loading():
        from nlens_video.cli.console import Console
    console = Console(
        quiet=args.quiet,
        verbose=args.verbose,
        as_json=args.json,
        progress=not getattr(args, "no_progress", True),
        stdout_taken=getattr(args, "output", None) == "-",
        progress_lines=getattr(args, "progress_lines", False),
    )
    with redirect_library_stdout():
        return _dispatch(args, console)


def _dispatch(args: Namespace, console: Console) -> int:
    """Run a command whose results the console shows."""
    if args.command == "place":
        from nlens_video.cli.placement_sheet import run_place

        return run_place(args, console)
    if args.command == "solve":
        from nlens_video.cli.solve_command import run_solve

        return run_solve(args, console)
    if args.command in ("merge", "farm"):
        from nlens_video.cli import farm_commands

        if args.command == "merge":
            return farm_commands.run_merge(args, console)
        if args.jobs is not None:
            return farm_commands.run_jobs(args, console)
    return _composite(args, console)


def _composite(args: Namespace, console: Console) -> int:
    """The commands that composite, or find the lens: `render`, `farm`, `fit`."""
    with loading():
        from nlens_video.video.input.open import can_be_read_again
    settings = to_settings.settings(args)
    is_file = can_be_read_again(settings.source.spec)
    if isinstance(settings.track_focus, int) and not is_file:
        raise UsageError(f"--track-focus {settings.track_focus} needs a file, not a stream")
    again = args.command != "farm" and is_file
    if settings.scale.given and not again:
        raise UsageError("--marker and --person-height need a file to solve, not a stream")
    if args.command == "farm" or (args.command == "render" and (args.resume or args.as_chunk)):
        from nlens_video.cli.farm_commands import check_in_chunks

        check_in_chunks(args, settings)
    try:
        if not (settings.needs_camera and again):
            return _with_camera(args, settings, console)
    except MissingCameraError:
        if not again:
            raise
    from nlens_video.cli.solve_command import solved_camera

    with solved_camera(settings, console) as solved:
        return _with_camera(args, solved, console)


def _with_camera(args: Namespace, settings: Settings, console: Console) -> int:
    if getattr(args, "plan", False):
        from nlens_video.run.render import plan

        chunks = getattr(args, "as_chunk", False)
        console.plan(plan(settings, all_reasons=args.verbose or args.json, as_chunks=chunks))
        return 0
    if args.command == "farm" or (args.command == "render" and (args.resume or args.as_chunk)):
        from nlens_video.cli.farm_commands import run_in_chunks

        return run_in_chunks(args, settings, console)
    with loading():
        from nlens_video.run.first_look import begun_look
    if args.command == "fit":
        from nlens_video.run.find_fit import find_fit
        from nlens_video.run.observers import check_sidecars

        found = find_fit(settings)
        console.fit(found)
        check_sidecars(str(found.path), found.missing)
        return 0
    with begun_look(settings) as look:  # while the rest of the program is imported
        with loading():
            from nlens_video.run.observers import check_sidecars, note_on_complete_result
            from nlens_video.run.render import render
        with console.progress_bar() as on_progress:
            outcome = render(settings, on_progress, look=look)
        with note_on_complete_result(outcome.output):
            console.outcome(outcome)
    check_sidecars(outcome.output, outcome.missing)
    return 0


def _doctor(args: Namespace) -> int:
    return examine(as_json=args.json)


def _evaluate(args: Namespace) -> int:
    from nlens_video.cli.evaluate_command import run_evaluate

    return run_evaluate(args)


def _check(args: Namespace) -> int:
    from nlens_video.check.command import check

    plate = to_settings.source_settings(args)
    return check(
        args.result, plate, search_range=args.range is None, objects=args.objects,
        camera_from=args.camera_from, report=args.report, as_json=args.json, quiet=args.quiet,
    )  # fmt: skip


def _bench(args: Namespace) -> int:
    from nlens_video.evaluate.bench.bench import bench

    bench(args.folder, args.out, quick=args.quick, as_json=args.json, quiet=args.quiet)
    return 0


def _study(args: Namespace) -> int:
    from nlens_video.evaluate.study.analysis import analyse_answers
    from nlens_video.evaluate.study.page import make_demo, make_study

    if args.what == "make" and args.demo == (args.folder is not None):
        raise UsageError("study make: give either a FOLDER of pictures or --demo, then OUT.html")
    said = {"as_json": args.json, "quiet": args.quiet}
    if args.what == "make" and args.demo:
        make_demo(args.page, **said)
    elif args.what == "make":
        make_study(args.folder, args.page, args.choices, args.things, **said)
    else:
        analyse_answers(args.answers, args.reference, **said)
    return 0


def _studio(args: Namespace) -> int:
    from nlens_video.cli.studio_command import run_studio

    return run_studio(args)


def _graph(args: Namespace) -> int:
    from nlens_video.graph.diagram import dot, mermaid
    from nlens_video.graph.pipeline_file import load_pipeline

    pipeline = load_pipeline(args.preset)
    print_out(dot(pipeline) if args.dot else mermaid(pipeline))
    for note in () if args.quiet else pipeline.notes:
        standard_error().write(f"{'note':7}{note}\n")
    return 0


_COMMANDS: dict[str, Callable[[Namespace], int]] = {
    "doctor": _doctor,
    "evaluate": _evaluate,
    "check": _check,
    "bench": _bench,
    "study": _study,
    "graph": _graph,
    "completion": print_completion,
    "studio": _studio,
}
