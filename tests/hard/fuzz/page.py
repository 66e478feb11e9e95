"""Figures of the long run, put between marks in a page whose words stay."""

from __future__ import annotations

import re
from pathlib import Path

from hard.faults.kills import Tally
from hard.fuzz.campaign import Count


def fuzz_part(counts: dict[str, Count]) -> str:
    """A row for each kind of file, and one for all."""
    head = "| kind of file | inputs | read | refused in one line | other errors | crashes | hangs |"
    rows = [_row(name, count) for name, count in counts.items()]
    every = Count()
    for count in counts.values():
        every.tried += count.tried
        every.read += count.read
        every.refused += count.refused
        every.wrong |= {(len(every.wrong), at): said for at, said in count.wrong.items()}
        every.crashes |= {(len(every.crashes), at): said for at, said in count.crashes.items()}
        every.hangs |= {(len(every.hangs), at): said for at, said in count.hangs.items()}
    return "\n".join([head, "| --- |" + " ---: |" * 6, *rows, _row("**all**", every)])


def _row(name: str, count: Count) -> str:
    wrong, crashes, hangs = len(count.wrong), len(count.crashes), len(count.hangs)
    numbers = (count.tried, count.read, count.refused, wrong, crashes, hangs)
    cells = (f"{number:,}".replace(",", " ") for number in numbers)
    return f"| {' | '.join([name, *cells])} |"


def kills_part(tallies: tuple[Tally, Tally]) -> str:
    """What killed runs have left."""
    keeping, resuming = tallies
    rows = [
        ("runs killed", keeping.kills, resuming.kills),
        ("of them before anything was kept", keeping.early, resuming.early),
        ("of them after the result was complete", keeping.after, resuming.after),
        ("incomplete results", keeping.broken, resuming.broken),
        ("leftover files without a recognisable name", len(keeping.strange), len(resuming.strange)),
        ("temporary files of half a second or more that play", keeping.played, "–"),
        ("of them that do not", keeping.unplayable, "–"),
        ("chunks lost", "–", resuming.lost),
        ("results finished from the chunks of killed runs", "–", resuming.resumed),
    ]
    head = ["| | `--keep-partial` | `--resume` |", "| --- | ---: | ---: |"]
    return "\n".join([*head, *(f"| {what} | {one} | {other} |" for what, one, other in rows)])


def write_page(page: Path, parts: dict[str, str]) -> None:
    """Put each part between its marks, `<!-- NAME -->` and `<!-- end -->`."""
    text = page.read_text()
    for name, part in parts.items():
        marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        text, found = marks.subn(lambda match, part=part: f"{match[1]}{part}\n{match[2]}", text)
        if not found:
            raise ValueError(f"{page}: has no place for {name}")
    page.write_text(text)
