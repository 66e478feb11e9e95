"""The commands that render no composite; each takes the parsed options, returns an exit code."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out, standard_error
from nlens_video.options import to_settings
from nlens_video.options.options import parser_of
from nlens_video.options.table import COMMANDS

COMPLETING = "_ARGCOMPLETE"
"""Environment variable that the shell sets where it asks for completions."""


def _doctor(words: argparse.Namespace) -> int:
    from nlens_video.cli.doctor import examine

    return examine(as_json=words.json)


def _evaluate(words: argparse.Namespace) -> int:
    if words.what == "composite":
        from nlens_video.evaluate.composite.composite import evaluate_composite as evaluate
    elif words.what == "scene":
        from nlens_video.evaluate.composite.scene import evaluate_scene as evaluate
    elif words.what == "sequences":
        from nlens_video.evaluate.composite.sequences import evaluate_sequences as evaluate
    else:
        from nlens_video.evaluate.coc.coc import evaluate_coc as evaluate
    return evaluate(words.folder, words.out, as_json=words.json, quiet=words.quiet)


def _check(words: argparse.Namespace) -> int:
    from nlens_video.check.command import check

    plate = to_settings.source_settings(words)
    return check(
        words.result, plate, find_range=words.range is None, objects=words.objects,
        report=words.report, as_json=words.json, quiet=words.quiet,
    )  # fmt: skip


def _bench(words: argparse.Namespace) -> int:
    from nlens_video.evaluate.bench.bench import bench

    return bench(words.folder, words.out, quick=words.quick, as_json=words.json, quiet=words.quiet)


def _study(words: argparse.Namespace) -> int:
    from nlens_video.evaluate.study.command import analyse_answers, make_demo, make_study

    if words.what == "make" and words.demo == (words.folder is not None):
        raise UsageError("study make: give either a FOLDER of pictures or --demo, then OUT.html")
    if words.what == "make" and words.demo:
        return make_demo(words.page)
    if words.what == "make":
        return make_study(words.folder, words.page, words.choices, words.things)
    return analyse_answers(words.answers, words.reference, as_json=words.json, quiet=words.quiet)


def _completion(words: argparse.Namespace) -> int:
    from argcomplete.shell_integration import shellcode

    print_out(shellcode(["nlens-video"], shell=words.shell))
    return 0


def _graph(words: argparse.Namespace) -> int:
    from nlens_video.graph.diagram import dot, mermaid
    from nlens_video.graph.pipeline_file import load_pipeline

    pipeline = load_pipeline(words.preset)
    print_out(dot(pipeline) if words.dot else mermaid(pipeline))
    for note in () if words.quiet else pipeline.notes:
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
    words = line.split()
    named = len(words) > 2 or (len(words) == 2 and line.endswith(" "))
    command = words[1] if named else ""
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
