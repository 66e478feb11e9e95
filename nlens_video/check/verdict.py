"""Verdict of a check: its findings, as JSON, as lines of text and as a page with charts."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict

from nlens_video.check.regions import Track
from nlens_video.core.layers import Float64
from nlens_video.report.html import (
    count,
    document,
    figure,
    file_name,
    missing,
    scrolled,
    section,
    table,
)
from nlens_video.report.svg import Axes, path
from nlens_video.video.atomic_files import make_folder, replacing

_LISTED = 8  # findings of each kind in the printed table; JSON and page have all
_WIDTH, _HEIGHT = 900.0, 220.0
_MOST_POINTS = 1500  # a line of more is no clearer

Kind = Literal["frames", "time", "freeze", "plate", "pop", "flicker", "drift", "sound"]
KINDS: dict[Kind, str] = {
    "frames": "dropped, added or repeated frames",
    "time": "times of the frames",
    "freeze": "object standing still for a moment",
    "plate": "plate pixels away from the object",
    "pop": "jumps of a single frame",
    "flicker": "flicker and jitter of the object",
    "drift": "object against the plate's ground",
    "sound": "audio against the pictures",
}


class Finding(Struct, frozen=True, kw_only=True):
    """A fault of the result.

    Attributes:
        kind: what is measured.
        frame: index of the first frame of the result that shows it, None for the whole.
        last: index of the last one.
        value: the measure, in the unit of the text.
        text: the finding in words.
    """

    kind: Kind
    frame: int | None
    last: int | None
    value: float
    text: str


def at(kind: Kind, frames: tuple[int, int] | None, value: float, text: str) -> Finding:
    """A finding on some frames, with which its text begins."""
    if frames is None:
        return Finding(kind=kind, frame=None, last=None, value=value, text=text)
    first, last = frames
    where = f"frame {first}" if first == last else f"frames {first} to {last}"
    return Finding(kind=kind, frame=first, last=last, value=value, text=f"{where}: {text}")


class Verdict(Struct, frozen=True, kw_only=True):
    """A result compared with its plate.

    Attributes:
        result: the result's name.
        plate: the plate's name.
        frames: of the result and of the plate [1].
        object_frames: frames of the result that show an object [1].
        measures: the figures behind the findings; name to value, the unit in the name.
        findings: faults, empty where there is none.
        notes: assumptions, and what could not be judged.
        unknown: kinds that could not be judged; a note says why.
    """

    result: str
    plate: str
    frames: tuple[int, int]
    object_frames: int
    measures: dict[str, float]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    unknown: tuple[Kind, ...] = ()

    @property
    def fine(self) -> bool:
        """Whether nothing was found."""
        return not self.findings

    def of(self, kind: Kind) -> list[Finding]:
        """Findings of a kind."""
        return [one for one in self.findings if one.kind == kind]

    def as_json(self) -> dict[str, Any]:
        """As `--json` prints it."""
        return {
            "fine": self.fine,
            **asdict(self),
            "findings": [asdict(one) for one in self.findings],
        }

    def as_text(self) -> list[str]:
        """A line for each kind, followed by its findings."""
        made, given = self.frames
        lines = [
            f"{self.result} against {self.plate}: {made} frames of {given}, "
            f"{self.object_frames} with an object"
        ]
        for kind, words in KINDS.items():
            found = self.of(kind)
            state = str(len(found)) if found else "?" if kind in self.unknown else "ok"
            lines.append(f"{state:<4}{words}")
            lines += [f"      {one.text}" for one in found[:_LISTED]]
            if len(found) > _LISTED:
                lines.append(f"      and {len(found) - _LISTED} more; --json names all")
        lines += [f"note: {note}" for note in self.notes]
        return lines


def runs(indices: Iterable[int]) -> list[tuple[int, int]]:
    """First and last of each run of consecutive numbers, which must rise."""
    stretches: list[tuple[int, int]] = []
    for index in indices:
        if stretches and index == stretches[-1][1] + 1:
            stretches[-1] = (stretches[-1][0], index)
        else:
            stretches.append((index, index))
    return stretches


def write_page(folder: Path, verdict: Verdict, objects: list[Track]) -> Path:
    """Write `index.html`.

    Raises:
        OutputError: the folder or the file cannot be written.
    """
    make_folder(folder)
    target = folder / "index.html"
    with replacing(target) as partial:
        partial.write_text(page(verdict, objects), encoding="utf-8", errors="replace")
    return target


def page(verdict: Verdict, objects: list[Track]) -> str:
    """The page as text; everything that came from outside is escaped."""
    title = f"{file_name(verdict.result)} against {file_name(verdict.plate)}"
    word = "Nothing was found." if verdict.fine else f"{count(len(verdict.findings), 'finding')}."
    rows = [
        (
            words,
            "; ".join(one.text for one in verdict.of(kind))
            or ("not known" if kind in verdict.unknown else "fine"),
        )
        for kind, words in KINDS.items()
    ]
    charts = "".join(_charts(number, track) for number, track in enumerate(objects))
    notes = "".join(missing(note) for note in verdict.notes)
    return document(
        "check",
        title,
        f"{word} {verdict.frames[0]} frames of {verdict.frames[1]}, "
        f"{verdict.object_frames} with an object.",
        section(
            "found", "Findings", table("Findings by kind", ("what", "found"), rows, stacked=True)
        )
        + (section("series", "Over the clip", charts) if charts else "")
        + notes,
    )


def _charts(number: int, track: Track) -> str:
    frames = np.array(track.frames, np.float64)
    if len(frames) < 2:
        return ""
    return "".join(
        _chart(f"Object {number + 1}: {name}", frames, np.array(values), unit)
        for name, values, unit in (
            ("sharpness", np.exp(np.array(track.sharpness)), "detail (levels)"),
            ("coverage", np.array(track.area), "blocks of 8 px"),
            ("change from frame to frame", np.array(track.motion)[1:], "levels"),
        )
    )


def _chart(title: str, frames: Float64, values: Float64, unit: str) -> str:
    frames = frames[-len(values) :]
    known = np.isfinite(values)
    frames, values = frames[known], values[known]
    if len(frames) < 2:
        return ""
    every = -(-len(frames) // _MOST_POINTS)
    top = max(1.1 * float(values.max()), 1e-3)
    axes = Axes(width=_WIDTH, height=_HEIGHT, x=(float(frames[0]), float(frames[-1])), y=(0.0, top))
    body = axes.frame("frame", unit) + path(axes.points(frames[::every], values[::every]), "fit")
    words = f"{float(values.min()):.3g} to {float(values.max()):.3g} {unit}."
    return figure(scrolled(axes.drawing(title, words, body), title), "", title)
