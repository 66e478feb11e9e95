"""The commands that render no composite; each takes the parsed options, returns an exit code."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out, standard_error
from nlens_video.options import to_settings
from nlens_video.options.parser import parser_of
from nlens_video.options.table import COMMANDS

COMPLETING = "_ARGCOMPLETE"
"""Environment variable that the shell sets where it asks for completions."""


def _doctor(args: argparse.Namespace) -> int:
    from nlens_video.cli.doctor import examine

    return examine(as_json=args.json)


def _evaluate(args: argparse.Namespace) -> int:
    if args.what == "composite":
        from nlens_video.evaluate.composite.composite import evaluate_composite as evaluate
    elif args.what == "scene":
        from nlens_video.evaluate.composite.scene import evaluate_scene as evaluate
    elif args.what == "sequences":
        from nlens_video.evaluate.composite.sequences import evaluate_sequences as evaluate
    else:
        from nlens_video.evaluate.coc.protocol import evaluate_coc as evaluate
    evaluate(args.folder, args.out, as_json=args.json, quiet=args.quiet)
    return 0


def _check(args: argparse.Namespace) -> int:
    from nlens_video.check.command import check

    plate = to_settings.source_settings(args)
    return check(
        args.result, plate, search_range=args.range is None, objects=args.objects,
        report=args.report, as_json=args.json, quiet=args.quiet,
    )  # fmt: skip


def _bench(args: argparse.Namespace) -> int:
    from nlens_video.evaluate.bench.bench import bench

    bench(args.folder, args.out, quick=args.quick, as_json=args.json, quiet=args.quiet)
    return 0


def _study(args: argparse.Namespace) -> int:
    from nlens_video.evaluate.study.analysis import analyse_answers
    from nlens_video.evaluate.study.page import make_demo, make_study

    if args.what == "make" and args.demo == (args.folder is not None):
        raise UsageError("study make: give either a FOLDER of pictures or --demo, then OUT.html")
    if args.what == "make" and args.demo:
        make_demo(args.page)
    elif args.what == "make":
        make_study(args.folder, args.page, args.choices, args.things)
    else:
        analyse_answers(args.answers, args.reference, as_json=args.json, quiet=args.quiet)
    return 0


def _completion(args: argparse.Namespace) -> int:
    from argcomplete.shell_integration import shellcode

    print_out(shellcode(["nlens-video"], shell=args.shell))
    return 0


def _graph(args: argparse.Namespace) -> int:
    from nlens_video.graph.diagram import dot, mermaid
    from nlens_video.graph.pipeline_file import load_pipeline

    pipeline = load_pipeline(args.preset)
    print_out(dot(pipeline) if args.dot else mermaid(pipeline))
    for note in () if args.quiet else pipeline.notes:
        standard_error().write(f"{'note':7}{note}\n")
    return 0


SIDE_COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "doctor": _doctor,
    "evaluate": _evaluate,
    "check": _check,
    "bench": _bench,
    "study": _study,
    "graph": _graph,
    "completion": _completion,
}


def complete() -> None:
    """Print the completions of the word under the cursor for the shell, and end the process."""
    import argcomplete
    from argcomplete.completers import FilesCompleter

    line = os.environ.get("COMP_LINE", "")
    typed = line.split()
    named = len(typed) > 2 or (len(typed) == 2 and line.endswith(" "))
    command = typed[1] if named else ""
    if command not in COMMANDS:
        parser: argparse.ArgumentParser = parser_of("render")
        first = next(action for action in parser._actions if not action.option_strings)
        files = FilesCompleter()

        def plate_or_command(**about: str) -> Iterable[str]:
            return [*COMMANDS, *files(**about)]

        # argcomplete looks for this attribute, which argparse's actions do not declare
        first.completer = plate_or_command  # type: ignore[attr-defined]
    else:
        parser = argparse.ArgumentParser("nlens-video")
        below = parser.add_subparsers()
        below.add_parser(command, parents=[parser_of(command)], add_help=False)
    argcomplete.autocomplete(parser)
