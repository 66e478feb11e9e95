"""Reports of the evaluation commands: tables as Markdown, CSV and JSON, plots, their files."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np
from msgspec import Struct, field

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.video.atomic_files import check_target_folder, make_folder, replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")

NONE = "–"
_REDUCTIONS: Mapping[str, Callable[[list[float]], float]] = {
    "mean": lambda known: float(np.mean(known)),
    "median": lambda known: float(np.median(known)),
    "worst": lambda known: max(map(abs, known)),
    "p90": lambda known: float(np.percentile(known, 90)),
    "most": max,
    "least": min,
}


class Column(Struct, frozen=True):
    """One column of the summary, over all plates.

    Attributes:
        key: of the figure.
        heading: with the unit.
        digits: after the point.
        over: how the plates' figures become one: `worst` is the largest whatever its sign, `most`
            the largest, `least` the smallest, `p90` the 90th percentile.
    """

    key: str
    heading: str
    digits: int = 2
    over: Literal["mean", "worst", "most", "least", "median", "p90", "count"] = "mean"

    @property
    def name(self) -> str:
        """Key of the summary: `key`, or `key_worst` and the like."""
        return self.key if self.over in ("mean", "median") else f"{self.key}_{self.over}"

    def value(self, figures: Iterable[float]) -> float:
        """The plates' figures as one; nan where there is none."""
        known = [figure for figure in figures if math.isfinite(figure)]
        if self.over == "count":
            return float(len(known))
        return _REDUCTIONS[self.over](known) if known else math.nan


class Entry(Struct, frozen=True):
    """The figures of one row on one plate; nan is "not defined", such as where no fit was found."""

    row: str
    plate: str
    figures: dict[str, float]


class Table(Struct):
    """A table of one kind of measurement.

    Attributes:
        name: of its file.
        title: above it.
        columns: of the summary.
        detail: key of the figure that is also shown plate by plate, empty for none.
        notes: below it.
        entries: what was measured, in the rows' order.
        empty: Markdown in place of a table without entries.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    detail: str = ""
    notes: tuple[str, ...] = ()
    entries: list[Entry] = field(default_factory=list)
    empty: str = ""

    def add(self, row: str, plate: str, figures: dict[str, float]) -> None:
        """Append the figures of one row on one plate."""
        self.entries.append(Entry(row, plate, figures))

    def rows(self) -> list[str]:
        """Names of the rows, in the order of their first entry."""
        return list(dict.fromkeys(entry.row for entry in self.entries))

    def plates(self) -> list[str]:
        """Names of the plates, in the order of their first entry."""
        return list(dict.fromkeys(entry.plate for entry in self.entries))

    def by_plate(self, row: str, key: str) -> dict[str, float]:
        """A figure of a row by plate, where it is a finite number."""
        return {
            entry.plate: entry.figures[key]
            for entry in self.entries
            if entry.row == row and math.isfinite(entry.figures.get(key, math.nan))
        }

    def summary(self) -> list[dict[str, str | float | None]]:
        """A row each: its name and its figures by the columns' names."""
        return [
            {"name": row, **{c.name: rounded(self._value(row, c)) for c in self.columns}}
            for row in self.rows()
        ]

    def markdown(self) -> str:
        """Title, summary, the detail plate by plate, notes."""
        if not self.entries:
            return self.empty
        summary = [
            [row, *(cell(self._value(row, c), c.digits) for c in self.columns)]
            for row in self.rows()
        ]
        parts = [f"## {self.title}", grid(["", *(c.heading for c in self.columns)], summary)]
        for shown in [c for c in self.columns if c.key == self.detail][:1]:
            on = {(e.row, e.plate): e.figures.get(shown.key, math.nan) for e in self.entries}
            detail = [
                [row, *(cell(on.get((row, one), math.nan), shown.digits) for one in self.plates())]
                for row in self.rows()
            ]
            parts += [f"{shown.heading}, plate by plate:", grid(["", *self.plates()], detail)]
        return "\n\n".join([*parts, *self.notes]) + "\n"

    def csv(self) -> str:
        """A line for each row and plate, all its figures; empty where not defined."""
        keys = list(dict.fromkeys(key for entry in self.entries for key in entry.figures))
        return csv_lines(
            ["row", "plate", *keys],
            (
                [e.row, e.plate, *(e.figures.get(key, math.nan) for key in keys)]
                for e in self.entries
            ),
        )

    def json(self) -> dict[str, object]:
        """Summary and the figures of each plate."""
        return {
            "summary": self.summary(),
            "plates": [
                {"name": entry.row, "plate": entry.plate}
                | {key: rounded(value) for key, value in entry.figures.items()}
                for entry in self.entries
            ],
        }

    def _value(self, row: str, column: Column) -> float:
        return column.value(self.by_plate(row, column.key).values())


class Report(Struct, frozen=True, kw_only=True):
    """What an evaluation command prints, and what it writes into the folder of `--out`.

    Attributes:
        name: of the Markdown file, without its suffix.
        sections: of the Markdown, before the tables.
        remark: printed after the first section, not written.
        tables: one CSV file each.
        facts: JSON before the tables.
        plots: caption and drawing of each PNG by its file name.
        files: further texts by file name.
        csv_head: comment lines above each table's CSV.
    """

    name: str
    sections: Sequence[str]
    remark: str = ""
    tables: Sequence[Table]
    facts: Mapping[str, object] = field(default_factory=dict)
    plots: Mapping[str, tuple[str, Callable[[], Figure]]] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    csv_head: str = ""

    def publish(self, out: Path | None, *, as_json: bool, quiet: bool) -> None:
        """Print the report and write its files; a failure of one does not prevent the other.

        Args:
            out: folder that exists; None writes nothing.
            as_json: print JSON instead of Markdown.
            quiet: print nothing but JSON.

        Raises:
            OutputError: one of the two failed.
        """
        try:
            if as_json:
                figures = {**self.facts, **{table.name: table.json() for table in self.tables}}
                print_out(json.dumps(figures, indent=2) + "\n")
            elif not quiet:
                print_out(self._markdown(self.remark))
        finally:
            if out is not None:
                self._write(out)

    def _markdown(self, remark: str = "") -> str:
        first, *others = self.sections
        parts = [first, *[remark] * bool(remark), *others]
        return "\n".join([*parts, *(table.markdown() for table in self.tables)])

    def _write(self, out: Path) -> None:
        links = "".join(f"![{caption}]({name})\n" for name, (caption, _) in self.plots.items())
        texts = {f"{table.name}.csv": self.csv_head + table.csv() for table in self.tables}
        texts[f"{self.name}.md"] = self._markdown() + (links and f"\n{links}")
        for name, text in {**texts, **self.files}.items():
            with replacing(out / name) as partial:
                partial.write_text(text, encoding="utf-8")
        for name, (_, draw) in self.plots.items():
            with replacing(out / name) as partial:
                draw().savefig(partial, dpi=120, format="png", metadata={"Software": ""})


def rounded(value: float) -> float | None:
    """A figure for JSON, None where there is none."""
    return round(value, 4) if math.isfinite(value) else None


def cell(value: float, digits: int) -> str:
    """A figure as text, a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else NONE


def csv_lines(heading: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """CSV of four digits after the point; what is not a number is left empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heading)
    for row in rows:
        writer.writerow(
            ("" if math.isnan(c) else f"{c:.4f}") if isinstance(c, float) else c for c in row
        )
    return text.getvalue()


def grid(heading: list[str], rows: list[list[str]]) -> str:
    """A Markdown table, its columns aligned so that it reads in a terminal too."""
    widths = [max(map(len, column)) for column in zip(heading, *rows, strict=True)]
    lines = [
        "| " + " | ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) + " |"
        for row in [heading, *rows]
    ]
    rule = "| " + " | ".join(["-" * widths[0], *("-" * (w - 1) + ":" for w in widths[1:])]) + " |"
    return "\n".join([lines[0], rule, *lines[1:]])


def track(items: Sequence[T], what: str, *, quiet: bool) -> Iterable[T]:
    """The items, with a progress bar on standard error where that is a terminal."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    hidden = quiet or not console.is_terminal
    return track(items, what, console=console, transient=True, disable=hidden)


def prepare_folder(out: Path | None, *, plots: bool) -> None:
    """Make the folder of the results where it is missing; None makes none.

    Raises:
        UsageError: plots are to be drawn and matplotlib is not installed.
        OutputError: the folder cannot be made.
    """
    if out is None:
        return
    if plots and importlib.util.find_spec("matplotlib") is None:
        raise UsageError("--out needs matplotlib, which is not installed; pip install matplotlib")
    # without a home to write to it keeps its fonts in a temporary folder, and warns at length
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    check_target_folder(out)
    make_folder(out, "give another --out")
