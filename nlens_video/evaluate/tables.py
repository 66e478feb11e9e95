"""Figures in rows and columns: Markdown for people, CSV and JSON for scripts."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

NONE = "–"


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the summary, over all plates.

    Attributes:
        key: of the figure.
        heading: with the unit.
        digits: after the point.
        over: how the plates' figures become one: `worst` is the largest whatever its sign, `most`
            the largest.
    """

    key: str
    heading: str
    digits: int = 2
    over: Literal["mean", "worst", "most", "median", "count"] = "mean"

    def value(self, figures: Sequence[float]) -> float:
        """The plates' figures as one; nan where there is none."""
        known = [abs(f) if self.over == "worst" else f for f in figures if math.isfinite(f)]
        if self.over == "count":
            return float(len(known))
        if not known:
            return math.nan
        if self.over in ("worst", "most"):
            return max(known)
        return float(np.median(known) if self.over == "median" else np.mean(known))


@dataclass(frozen=True, slots=True)
class Entry:
    """The figures of one row on one plate; nan is "not defined", such as where no fit was found."""

    row: str
    plate: str
    figures: dict[str, float]


@dataclass(slots=True)
class Table:
    """A table of one kind of measurement.

    Attributes:
        name: of its file.
        title: above it.
        columns: of the summary.
        detail: key of the figure that is also shown plate by plate.
        notes: below it.
        entries: what was measured, in the rows' order.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    detail: str
    notes: tuple[str, ...] = ()
    entries: list[Entry] = field(default_factory=list)

    def rows(self) -> list[str]:
        """Names of the rows, in the order of their first entry."""
        return list(dict.fromkeys(entry.row for entry in self.entries))

    def plates(self) -> list[str]:
        """Names of the plates, in the order of their first entry."""
        return list(dict.fromkeys(entry.plate for entry in self.entries))

    def summary(self) -> list[dict[str, str | float | None]]:
        """A row each: its name and, by `key` or `key_worst` and the like, its figures."""
        return [
            {"name": row, **{_name(c): _known(self._value(row, c)) for c in self.columns}}
            for row in self.rows()
        ]

    def markdown(self) -> str:
        """Title, summary, the detail plate by plate, notes."""
        summary = [
            [row, *(cell(self._value(row, c), c.digits) for c in self.columns)]
            for row in self.rows()
        ]
        shown = next(c for c in self.columns if c.key == self.detail)
        detail = [
            [row, *(cell(self._on(row, plate), shown.digits) for plate in self.plates())]
            for row in self.rows()
        ]
        parts = [
            f"## {self.title}",
            grid(["", *(c.heading for c in self.columns)], summary),
            f"{shown.heading}, plate by plate:",
            grid(["", *self.plates()], detail),
            *self.notes,
        ]
        return "\n\n".join(parts) + "\n"

    def csv(self) -> str:
        """A line for each row and plate, all its figures; empty where not defined."""
        keys = list(dict.fromkeys(key for entry in self.entries for key in entry.figures))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["row", "plate", *keys])
        for entry in self.entries:
            figures = [entry.figures.get(key, math.nan) for key in keys]
            cells = ["" if math.isnan(value) else f"{value:.4f}" for value in figures]
            writer.writerow([entry.row, entry.plate, *cells])
        return text.getvalue()

    def json(self) -> dict[str, object]:
        """Summary and the figures of each plate."""
        return {
            "summary": self.summary(),
            "plates": [
                {"name": entry.row, "plate": entry.plate}
                | {key: _known(value) for key, value in entry.figures.items()}
                for entry in self.entries
            ],
        }

    def _value(self, row: str, column: Column) -> float:
        figures = [e.figures.get(column.key, math.nan) for e in self.entries if e.row == row]
        return column.value(figures)

    def _on(self, row: str, plate: str) -> float:
        for entry in self.entries:
            if (entry.row, entry.plate) == (row, plate):
                return entry.figures.get(self.detail, math.nan)
        return math.nan


def _name(column: Column) -> str:
    return column.key if column.over in ("mean", "median") else f"{column.key}_{column.over}"


def _known(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def cell(value: float, digits: int) -> str:
    """A figure as text, a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else NONE


def grid(heading: list[str], rows: list[list[str]]) -> str:
    """A Markdown table, its columns aligned so that it reads in a terminal too."""
    widths = [max(len(row[at]) for row in [heading, *rows]) for at in range(len(heading))]
    lines = [
        "| " + " | ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) + " |"
        for row in [heading, *rows]
    ]
    rule = "| " + " | ".join(["-" * widths[0], *("-" * (w - 1) + ":" for w in widths[1:])]) + " |"
    return "\n".join([lines[0], rule, *lines[1:]])
