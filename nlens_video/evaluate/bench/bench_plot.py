"""The picture of `bench`: accuracy over time, the Pareto front, the paper's budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BUDGET_MS = 180.0
"""What the paper takes for a frame."""

_INK, _OURS, _RIVALS = "#222222", "#0072b2", "#9aa5ad"
_LEAST_MS = 0.1  # what takes less is drawn there: a copy has no place on a log axis


@dataclass(frozen=True, slots=True)
class Point:
    """A rung in the picture.

    Attributes:
        name: beside the point.
        ms: a frame [ms].
        psnr_db: accuracy [dB].
        ours: whether it is one of ours.
    """

    name: str
    ms: float
    psnr_db: float
    ours: bool


def pareto(points: Sequence[Point]) -> list[Point]:
    """Those than which none is both quicker and more accurate, from the quickest on."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p.ms, -p.psnr_db)):
        if not front or point.psnr_db > front[-1].psnr_db:
            front.append(point)
    return front


def plot(panels: Sequence[tuple[str, Sequence[Point]]], path: Path) -> None:
    """Draw a panel for each title and its points, side by side (PNG)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8 * len(panels), 5.5), layout="constrained")
    for number, (title, points) in enumerate(panels):
        _panel(figure.add_subplot(1, len(panels), number + 1), title, points)
    figure.savefig(path, dpi=120, format="png", metadata={"Software": ""})


def _panel(axes: Axes, title: str, points: Sequence[Point]) -> None:
    drawn = [Point(p.name, max(p.ms, _LEAST_MS), p.psnr_db, p.ours) for p in points]
    front = pareto(drawn)
    axes.step(
        [p.ms for p in front], [p.psnr_db for p in front], where="post", color=_OURS, lw=1.5,
        alpha=0.5, label="Pareto front",
    )  # fmt: skip
    for point in drawn:
        colour = _OURS if point.ours else _RIVALS
        axes.plot(point.ms, point.psnr_db, "o", color=colour, ms=8, zorder=3)
    _label(axes, drawn)
    axes.axvline(BUDGET_MS, color=_INK, lw=1, ls="--")
    axes.text(
        BUDGET_MS, 0.02, f" {BUDGET_MS:g} ms", transform=axes.get_xaxis_transform(), color=_INK
    )
    axes.plot([], [], "o", color=_OURS, label="nlens-video")
    axes.plot([], [], "o", color=_RIVALS, label="others' methods")
    slowest = max([BUDGET_MS, *(p.ms for p in drawn)])
    axes.set(xscale="log", xlim=(0.6 * _LEAST_MS, 6 * slowest))
    axes.set(xlabel="reblur of a frame, median [ms]", ylabel="PSNR against the lens [dB]")
    axes.set_title(title, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e5e8ea", lw=0.7)
    axes.set_axisbelow(True)
    _plain_ticks(axes)
    axes.legend(frameon=False, loc="upper left")


def _label(axes: Axes, points: Sequence[Point]) -> None:
    """Names beside the points; of two that lie close, the upper goes up and the lower down."""
    reach = max(p.psnr_db for p in points) - min(p.psnr_db for p in points) + 1e-6
    for point in points:
        shift = 0.0
        for other in points:
            near = other is not point and 0.25 < other.ms / point.ms < 4.0
            if near and abs(other.psnr_db - point.psnr_db) < 0.05 * reach:
                shift += 5.0 if (point.psnr_db, point.name) > (other.psnr_db, other.name) else -5.0
        axes.annotate(
            point.name, (point.ms, point.psnr_db), (8.0, shift - 4.0),
            textcoords="offset points", fontsize=9, color=_INK,
        )  # fmt: skip


def _plain_ticks(axes: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
