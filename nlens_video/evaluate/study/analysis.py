"""What the answers of a study say: failure rates and two-proportion z-tests."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binomtest, chi2_contingency

from nlens_video.core.errors import InputError, UsageError

LEVEL = 0.95
_NEEDED = ("participant", "file", "method", "virtual", "chosen")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a participant answered to a picture.

    Attributes:
        participant: the code.
        file: of the picture.
        method: what put the virtual object in.
        virtual: the answer that names it.
        chosen: what was taken for virtual; empty for "No".
    """

    participant: str
    file: str
    method: str
    virtual: str
    chosen: tuple[str, ...]

    @property
    def failed(self) -> bool:
        """Whether the virtual object was not found: good for the method."""
        return self.virtual not in self.chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodResult:
    """What was answered to a method's pictures.

    Attributes:
        method: its name.
        trials: pictures shown, over all participants.
        failures: how often the virtual object was not found.
        low: lower end of Wilson's 95 % interval of the rate [1].
        high: its upper end [1].
        z: of the two-proportion test against the reference; nan for itself and where undefined.
        p: two-sided, nan likewise.
    """

    method: str
    trials: int
    failures: int
    low: float
    high: float
    z: float
    p: float

    @property
    def rate(self) -> float:
        """Share of trials in which the virtual object was not found [1]."""
        return self.failures / self.trials


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
    """Failure rate of each method and how surely it differs from the reference's.

    Args:
        answers: of all participants.
        reference: the method that the others are tested against.

    Raises:
        UsageError: no answer is about the reference.
    """
    methods = list(dict.fromkeys(answer.method for answer in answers))
    if reference not in methods:
        raise UsageError(f"--reference {reference}: there are {', '.join(methods)}")
    counts = {
        method: _count(answer for answer in answers if answer.method == method)
        for method in methods
    }
    results = []
    for method, (failures, trials) in counts.items():
        interval = binomtest(failures, trials).proportion_ci(LEVEL, method="wilson")
        z, p = (math.nan, math.nan)
        if method != reference:
            z, p = two_proportion_test(counts[reference], (failures, trials))
        results.append(
            MethodResult(
                method=method, failures=failures, trials=trials,
                low=float(interval.low), high=float(interval.high), z=z, p=p,
            )
        )  # fmt: skip
    return results


def two_proportion_test(one: tuple[int, int], other: tuple[int, int]) -> tuple[float, float]:
    """Two-proportion z-test, pooled, two-sided.

    Its square is Pearson's chi-squared of the 2 x 2 table without continuity correction, which is
    how scipy has it.

    Args:
        one: failures and trials.
        other: failures and trials.

    Returns:
        z, positive where `one` fails more often, and p; nan where all trials ended alike.
    """
    table = np.array([[failures, trials - failures] for failures, trials in (one, other)])
    if (table.sum(axis=0) == 0).any():
        return math.nan, math.nan
    tested = chi2_contingency(table, correction=False)
    sign = math.copysign(1.0, one[0] / one[1] - other[0] / other[1])
    return sign * math.sqrt(float(tested.statistic)), float(tested.pvalue)


def _count(answers: Iterable[Answer]) -> tuple[int, int]:
    failed = [answer.failed for answer in answers]
    return sum(failed), len(failed)


def _read(path: Path) -> list[Answer]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        rows = json.loads(text)["answers"] if path.suffix == ".json" else _table(text)
        if not rows:
            raise ValueError("no answer in it")
        return [_answer(row) for row in rows]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, csv.Error) as error:
        raise InputError(
            f"{path}: cannot be read as answers ({error}); expected a file that the study's page "
            "saved, JSON or CSV"
        ) from error


def _table(text: str) -> list[dict[str, str | list[str]]]:
    rows: list[dict[str, str | list[str]]] = []
    for row in csv.DictReader(text.splitlines()):
        rows.append({**row, "chosen": [name for name in row["chosen"].split(";") if name]})
    return rows


def _answer(row: dict[str, str | list[str]]) -> Answer:
    if not isinstance(row["chosen"], list) or not all(isinstance(c, str) for c in row["chosen"]):
        raise ValueError("chosen is no list of answers")
    texts = {name: row[name] for name in _NEEDED if name != "chosen"}
    if not all(isinstance(text, str) and text for text in texts.values()):
        raise ValueError(f"an answer without {', '.join(texts)}")
    return Answer(**{k: str(v) for k, v in texts.items()}, chosen=tuple(row["chosen"]))
