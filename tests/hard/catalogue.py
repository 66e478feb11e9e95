"""The catalogue of hard cases: what a case is, and how the suite and the page see it.

A case is a function that runs something hard and returns its `Outcome`: figures with the limits
that they keep, and something to look at. `@case` makes a test of it, and enters it in `CASES`.
`docs/make_hard.py` writes the page from that very list, and the test fails where the page says
anything else than the case checks.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from PIL.Image import Image
from support.folders import ROOT

PAGE = ROOT / "docs" / "hard.md"
Rule = Literal["at most", "at least", "is"]


@dataclass(frozen=True, slots=True)
class Figure:
    """A number, or a word, and what it has to be."""

    what: str
    value: float | str
    rule: Rule
    limit: float | str

    @property
    def kept(self) -> bool:
        if isinstance(self.value, str) or isinstance(self.limit, str):
            return self.value == self.limit
        if math.isnan(self.value):
            return False
        if self.rule == "is":
            return self.value == self.limit
        return self.value <= self.limit if self.rule == "at most" else self.value >= self.limit

    @property
    def bound(self) -> str:
        return f"{'' if self.rule == 'is' else self.rule + ' '}{_words(self.limit)}"

    @property
    def row(self) -> str:
        """The line of the page's table, without the value that was measured."""
        return f"| {self.what} | {self.bound} |"

    def __str__(self) -> str:
        return f"{self.what}: {_words(self.value)}, must be {self.bound}"

    @property
    def measured(self) -> str:
        return _words(self.value)


def at_most(what: str, value: float, limit: float) -> Figure:
    return Figure(what, float(value), "at most", limit)


def at_least(what: str, value: float, limit: float) -> Figure:
    return Figure(what, float(value), "at least", limit)


def exactly(what: str, value: float | str, expected: float | str) -> Figure:
    return Figure(what, value if isinstance(value, str) else float(value), "is", expected)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a case gives: its figures, and how to draw it; nothing is drawn for the suite."""

    figures: tuple[Figure, ...]
    draw: Callable[[], Image]


@dataclass(frozen=True, slots=True)
class Case:
    """A named hard case."""

    theme: str
    name: str
    claim: str
    run: Callable[[], Outcome]

    @property
    def title(self) -> str:
        return self.name.replace("_", " ")

    @property
    def picture(self) -> str:
        return f"hard/{self.theme}_{self.name}.png"


CASES: list[Case] = []


def case(run: Callable[[], Outcome]) -> Callable[[], None]:
    """Enter `test_NAME`, or a recorded `NAME`, of `hard/THEME/`; its docstring is the claim."""
    entry = Case(
        theme=Path(run.__code__.co_filename).parent.name,
        name=run.__name__.removeprefix("test_"),
        claim=" ".join((run.__doc__ or "").split()),
        run=run,
    )
    CASES.append(entry)

    @functools.wraps(run)
    def test() -> None:
        outcome = run()
        wrong = [str(figure) for figure in outcome.figures if not figure.kept]
        assert not wrong, "; ".join(wrong)
        claimed, rows = on_the_page(entry)
        made = [figure.row for figure in outcome.figures]
        assert (claimed, rows) == (entry.claim, made), "the page says something else: make hard"

    return test


def on_the_page(entry: Case) -> tuple[str, list[str]]:
    """What `docs/hard.md` claims of a case, and the rows of its table without their values."""
    parts = _sections().get((entry.theme, entry.title))
    if parts is None:
        return "", []
    lines = [line for line in parts if line]
    rows = [line.split("|") for line in lines if line.startswith("| ")][2:]
    return lines[0], [f"|{cells[1]}|{cells[3]}|" for cells in rows]


@functools.cache
def _sections() -> dict[tuple[str, str], list[str]]:
    found: dict[tuple[str, str], list[str]] = {}
    theme, lines = "", []
    for line in PAGE.read_text().splitlines() if PAGE.exists() else []:
        if line.startswith("## "):
            theme, lines = line[3:], []
        elif line.startswith("### "):
            lines = found.setdefault((theme, line[4:]), [])
        else:
            lines.append(line)
    return found


def _words(value: float | str) -> str:
    if isinstance(value, str):
        return value
    whole = math.isfinite(value) and value == round(value)
    return f"{value:.0f}" if whole and abs(value) < 1e6 else f"{value:.3g}"
