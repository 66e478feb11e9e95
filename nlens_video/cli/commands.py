"""The commands that make no composite: each takes its words and gives an exit code."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.options import to_settings


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
    from nlens_video.cli.completion import script

    print_out(script(words.shell))
    return 0


SIDE_COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "doctor": _doctor,
    "evaluate": _evaluate,
    "check": _check,
    "bench": _bench,
    "study": _study,
    "completion": _completion,
}
