"""`nlens-video study`: make the page, analyse the answers."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.evaluate.study.analysis import LEVEL, Answer, MethodResult, analyse, read_answers
from nlens_video.evaluate.study.page import study_page
from nlens_video.evaluate.study.stimuli import load_stimuli
from nlens_video.evaluate.tables import NONE, grid
from nlens_video.video.atomic_files import check_folder, replacing


def make_study(folder: Path, out: Path, choices: str | None, things: str) -> int:
    """Write the study's page.

    Args:
        folder: pictures and their list (see `stimuli`).
        out: the page.
        choices: answers beside "No", separated by commas; None for all that are right once.
        things: what is looked for, in the plural.

    Returns:
        The exit code, 0.

    Raises:
        InputError: the pictures or their list cannot be used.
        UsageError: choices among which a right answer is missing.
        OutputError: the page cannot be written.
    """
    stimuli = load_stimuli(folder)
    right = list(dict.fromkeys(one.virtual for one in stimuli))
    offered = right if choices is None else [name.strip() for name in choices.split(",")]
    lacking = [name for name in right if name not in offered]
    if lacking or not all(offered) or len(set(offered)) < len(offered):
        raise UsageError(
            f"--choices {choices}: expected names, each once, with {', '.join(right)} among them"
        )
    if any(";" in name for name in offered):
        raise UsageError("an answer with ; in it cannot be told from two; name it otherwise")
    page = study_page(folder, stimuli, offered, things)
    with replacing(out) as partial:
        partial.write_text(page, encoding="utf-8")
    return 0


def make_demo(out: Path) -> int:
    """Make pictures of rendered balls on a table, and the page that asks about them.

    Args:
        out: the page.

    Returns:
        The exit code, 0.

    Raises:
        NlensError: the renderer cannot run.
        OutputError: the page cannot be written.
    """
    from nlens_video.evaluate.study.demo import CHOICES, write_demo

    check_folder(out)
    with tempfile.TemporaryDirectory() as folder:
        write_demo(Path(folder))
        return make_study(Path(folder), out, CHOICES, "billiard balls")


def analyse_answers(paths: Sequence[Path], reference: str, *, as_json: bool, quiet: bool) -> int:
    """Print what the answers say.

    Args:
        paths: files that the page saved.
        reference: the method that the others are tested against.
        as_json: print JSON instead of a table.
        quiet: print nothing but JSON.

    Returns:
        The exit code, 0.

    Raises:
        InputError: answers cannot be read.
        UsageError: no answer is about the reference.
    """
    answers = read_answers(paths)
    results = analyse(answers, reference)
    if as_json:
        print_out(_json(answers, results, reference))
    elif not quiet:
        print_out(_markdown(answers, results, reference))
    return 0


def _people(answers: Sequence[Answer]) -> int:
    return len({answer.participant for answer in answers})


def _markdown(answers: Sequence[Answer], results: Sequence[MethodResult], reference: str) -> str:
    rows = [
        [
            one.method, str(one.trials), f"{one.rate:.1%}", f"{one.low:.1%} to {one.high:.1%}",
            f"{one.z:.2f}" if math.isfinite(one.z) else NONE,
            f"{one.p:.3g}" if math.isfinite(one.p) else NONE,
        ]
        for one in results
    ]  # fmt: skip
    heading = ["", "trials", "failure rate", f"{LEVEL:.0%} interval", "z", "p"]
    return (
        f"# Answers of {_people(answers)} participants\n\n{grid(heading, rows)}\n\n"
        "Failure rate: share of the trials in which the virtual object was not among those chosen; "
        "higher is better. Interval: Wilson's. z and p: two-proportion z-test, pooled, two-sided, "
        f"{reference} against each other method. It takes all trials for independent, as the paper "
        "does; those of one person are not quite, so p is on the small side.\n"
    )


def _json(answers: Sequence[Answer], results: Sequence[MethodResult], reference: str) -> str:
    def known(value: float) -> float | None:
        return value if math.isfinite(value) else None

    methods = [
        {
            "method": one.method, "trials": one.trials, "failures": one.failures,
            "rate": one.rate, "low": one.low, "high": one.high,
            "z": known(one.z), "p": known(one.p),
        }
        for one in results
    ]  # fmt: skip
    found = {"participants": _people(answers), "reference": reference, "methods": methods}
    return json.dumps(found, indent=2) + "\n"
