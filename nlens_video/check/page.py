"""The page of a check: findings in a table, and the series that they were read from."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nlens_video.check.findings import KINDS, Verdict
from nlens_video.check.regions import Track
from nlens_video.core.errors import OutputError
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
from nlens_video.video.atomic_files import replacing

_WIDTH, _HEIGHT = 900.0, 220.0
_MOST_POINTS = 1500  # a line of more is no clearer


def write_page(folder: Path, verdict: Verdict, objects: list[Track]) -> Path:
    """Write `index.html`, with everything in it.

    Raises:
        OutputError: the folder or the file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error}); give a writable folder") from error
    target = folder / "index.html"
    with replacing(target) as partial:
        partial.write_text(page(verdict, objects), encoding="utf-8", errors="replace")
    return target


def page(verdict: Verdict, objects: list[Track]) -> str:
    """The page as text; everything that came from outside is escaped."""
    title = f"{file_name(verdict.result)} against {file_name(verdict.plate)}"
    word = "Nothing was found." if verdict.fine else f"{count(len(verdict.findings), 'finding')}."
    rows = [
        (words, "; ".join(one.text for one in verdict.of(kind)) or "fine")
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
