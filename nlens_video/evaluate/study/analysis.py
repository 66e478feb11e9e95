"""`nlens-video study analyse`: failure rates and two-proportion z-tests of a study's answers."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict
from scipy.stats import binomtest, chi2_contingency

from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.stdio import print_out
from nlens_video.evaluate.report import NONE, grid

LEVEL = 0.95
_NEEDED = ("participant", "file", "method", "virtual", "chosen")


class Answer(Struct, frozen=True, kw_only=True):
    """Which objects of a picture a participant took for virtual; none for "No"."""

    participant: str
    file: str
    method: str
    virtual: str
    chosen: tuple[str, ...]

    @property
    def failed(self) -> bool:
        """Whether the virtual object was not found: good for the method."""
        return self.virtual not in self.chosen


class MethodResult(Struct, frozen=True, kw_only=True):
    """Failures of a method: trials in which the virtual object was not found.

    Attributes:
        method: its name.
        trials: pictures shown, over all participants.
        failures: how many of them.
        rate: their share [1].
        low: lower end of Wilson's 95 % interval of the rate [1].
        high: its upper end [1].
        z: of the two-proportion test against the reference; None for itself and where undefined.
        p: two-sided, None likewise.
    """

    method: str
    trials: int
    failures: int
    rate: float
    low: float
    high: float
    z: float | None
    p: float | None


def analyse_answers(paths: Sequence[Path], reference: str, *, as_json: bool, quiet: bool) -> None:
    """Print the failure rates of the methods, each tested against the reference.

    Raises:
        InputError: answers cannot be read.
        UsageError: no answer is about the reference.
    """
    answers = read_answers(paths)
    people = len({answer.participant for answer in answers})
    results = analyse(answers, reference)
    if as_json:
        methods = [asdict(one) for one in results]
        found = {"participants": people, "reference": reference, "methods": methods}
        print_out(json.dumps(found, indent=2) + "\n")
    elif not quiet:
        print_out(_markdown(people, results, reference))


def _markdown(people: int, results: Sequence[MethodResult], reference: str) -> str:
    rows = [
        [
            one.method, str(one.trials), f"{one.rate:.1%}", f"{one.low:.1%} to {one.high:.1%}",
            NONE if one.z is None else f"{one.z:.2f}", NONE if one.p is None else f"{one.p:.3g}",
        ]
        for one in results
    ]  # fmt: skip
    heading = ["", "trials", "failure rate", f"{LEVEL:.0%} interval", "z", "p"]
    return (
        f"# Answers of {people} participants\n\n{grid(heading, rows)}\n\n"
        "Failure rate: share of the trials in which the virtual object was not among those chosen; "
        "higher is better. Interval: Wilson's. z and p: two-proportion z-test, pooled, two-sided, "
        f"{reference} against each other method. It takes all trials for independent, as the paper "
        "does; those of one person are not quite, so p is on the small side.\n"
    )


def read_answers(paths: Sequence[Path]) -> list[Answer]:
    """Read files that the page saved, JSON or CSV, in any mixture.

    Raises:
        InputError: a file cannot be read, or a participant answered to a picture twice.
    """
    answers = [answer for path in paths for answer in _read(path)]
    seen: set[tuple[str, str]] = set()
    for answer in answers:
        key = (answer.participant, answer.file)
        if key in seen:
            raise InputError(
                f"participant {answer.participant} answers to {answer.file} twice; "
                "give each participant's answers once"
            )
        seen.add(key)
    return answers


def analyse(answers: Sequence[Answer], reference: str) -> list[MethodResult]:
    """Failure rate of each method, and the test of its difference from the reference's.

    Raises:
        UsageError: no answer is about the reference.
    """
    methods = list(dict.fromkeys(answer.method for answer in answers))
    if reference not in methods:
        raise UsageError(f"--reference {reference}: there are {', '.join(methods)}")
    failed = {
        method: [answer.failed for answer in answers if answer.method == method]
        for method in methods
    }
    counts = {method: (sum(found), len(found)) for method, found in failed.items()}
    results = []
    for method, (failures, trials) in counts.items():
        interval = binomtest(failures, trials).proportion_ci(LEVEL, method="wilson")
        z, p = math.nan, math.nan
        if method != reference:
            z, p = two_proportion_test(counts[reference], (failures, trials))
        results.append(
            MethodResult(
                method=method, trials=trials, failures=failures, rate=failures / trials,
                low=float(interval.low), high=float(interval.high),
                z=z if math.isfinite(z) else None, p=p if math.isfinite(p) else None,
            )
        )  # fmt: skip
    return results


def two_proportion_test(one: tuple[int, int], other: tuple[int, int]) -> tuple[float, float]:
    """Two-proportion z-test, pooled, two-sided, of two pairs of failures and trials.

    Its square is Pearson's chi-squared of the 2 x 2 table without continuity correction, which is
    how scipy has it.

    Returns:
        z, positive where `one` fails more often, and p; nan where all trials ended alike.
    """
    table = np.array([[failures, trials - failures] for failures, trials in (one, other)])
    if (table.sum(axis=0) == 0).any():
        return math.nan, math.nan
    tested = chi2_contingency(table, correction=False)
    sign = math.copysign(1.0, one[0] / one[1] - other[0] / other[1])
    return sign * math.sqrt(float(tested.statistic)), float(tested.pvalue)


def _read(path: Path) -> list[Answer]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix == ".json":
            rows = json.loads(text)["answers"]
        else:
            rows = list(csv.DictReader(text.splitlines()))
            rows = [{**row, "chosen": list(filter(None, row["chosen"].split(";")))} for row in rows]
        if not rows:
            raise ValueError("no answer in it")
        return [_answer(row) for row in rows]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, csv.Error) as error:
        raise InputError(
            f"{path}: cannot be read as answers ({error}); expected a file that the study's page "
            "saved, JSON or CSV"
        ) from error


def _answer(row: dict[str, str | list[str]]) -> Answer:
    if not isinstance(row["chosen"], list) or not all(isinstance(c, str) for c in row["chosen"]):
        raise ValueError("chosen is no list of answers")
    texts = {name: row[name] for name in _NEEDED if name != "chosen"}
    if not all(isinstance(text, str) and text for text in texts.values()):
        raise ValueError(f"an answer without {', '.join(texts)}")
    return Answer(**{k: str(v) for k, v in texts.items()}, chosen=tuple(row["chosen"]))
