"""Results of `bench`: tables, files, and a plot of accuracy over time with its Pareto front."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nlens_video.core.version import VERSION
from nlens_video.evaluate.bench.measure import Effort
from nlens_video.evaluate.bench.methods import Rung
from nlens_video.evaluate.tables import Column, Table
from nlens_video.render.select import renderer_choice
from nlens_video.video.atomic_files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_COLUMNS = (
    Column("psnr_db", "PSNR [dB]"),
    Column("ssim", "SSIM", 4),
    Column("median_ms", "median [ms]", 1),
    Column("p95_ms", "p95, worst [ms]", 1, over="worst"),
    Column("peak_mib", "peak memory [MiB]", 0, over="worst"),
    Column("startup_s", "start-up [s]", 1),
)


def scenes_table(abouts: Mapping[str, str], effort: Effort) -> Table:
    """An empty table of the scenes that `bench` makes itself.

    Args:
        abouts: what each scene is, by name.
        effort: how much is measured.
    """
    listed = "; ".join(f"{name}: {about}" for name, about in abouts.items())
    return Table(
        name="bench",
        title=f"Against the lens, {effort.views} views of it",
        columns=_COLUMNS,
        detail="psnr_db",
        notes=(
            f"Scenes of {effort.size[0]}x{effort.size[1]} pixels: {listed}. The true CoC is given.",
            _notes(),
        ),
    )


def plates_table() -> Table:
    """An empty table of plates that were rendered with and without their object."""
    return Table(
        name="bench_plates",
        title="Against plates rendered with their object",
        columns=_COLUMNS,
        detail="psnr_db",
        notes=("The object's layers and its true CoC are given.", _notes()),
    )


def _notes() -> str:
    return (
        "PSNR and SSIM of 8-bit code values in the tightest box around the sharp object. Times are "
        "those of the reblur alone, after warm-up: the mean of the medians on each scene, and the "
        "95th percentile on the slowest. Memory and start-up are those of a process that runs this "
        "rung and nothing else; start-up ends with its first frame. naive: no blur; one Gaussian: "
        "sigma a quarter of the object's mean CoC; layered Gaussian: of each pixel's own CoC, "
        "gathered, as Blind Augmentation (Prakash et al. 2025) does."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Everything that is told.

    Attributes:
        machine: what it ran on, in words.
        tables: scenes, and plates where there were any.
        rungs: what the tables' rows are.
    """

    machine: Mapping[str, str]
    tables: Sequence[Table]
    rungs: Sequence[Rung]

    def markdown(self) -> str:
        """Machine and tables, readable in a terminal too."""
        lines = [f"- {name}: {value}" for name, value in self.machine.items()]
        heading = "# What accuracy costs in time\n\n" + "\n".join(lines) + "\n"
        return "\n".join([heading, *(table.markdown() for table in self.tables)])

    def json(self) -> str:
        """The same figures for scripts."""
        figures = {"machine": dict(self.machine)} | {t.name: t.json() for t in self.tables}
        return json.dumps(figures, indent=2) + "\n"

    def write(self, out: Path) -> None:
        """Write `bench.md`, a CSV for each table and `bench.png` into a folder that exists.

        Raises:
            OutputError: one of them cannot be written.
        """
        machine = "".join(f"# {name}: {value}\n" for name, value in self.machine.items())
        texts = {f"{table.name}.csv": machine + table.csv() for table in self.tables}
        texts["bench.md"] = self.markdown() + "\n![accuracy over time](bench.png)\n"
        for name, text in texts.items():
            with replacing(out / name) as partial_path:
                partial_path.write_text(text, encoding="utf-8")
        panels = [(table.title, self._points(table)) for table in self.tables]
        with replacing(out / "bench.png") as partial_path:
            plot(panels, partial_path)

    def _points(self, table: Table) -> list[Point]:
        ours = {rung.name: rung.rival is None for rung in self.rungs}
        points = []
        for row in table.summary():
            name, ms, psnr_db = str(row["name"]), row["median_ms"], row["psnr_db"]
            if isinstance(ms, float) and isinstance(psnr_db, float):  # an exact result has no dB
                points.append(Point(name, ms, psnr_db, ours[name]))
        return points


def machine() -> dict[str, str]:
    """Processor, cores, load, renderer and versions in words; nothing that names the machine."""
    return {
        "processor": _processor(),
        "cores": str(_cores()),
        "load at the start": _load(),
        "renderer": renderer_choice(),
        "system": f"{platform.system()} {platform.machine()}",
        "version": f"nlens-video {VERSION}, Python {platform.python_version()}",
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _load() -> str:
    """Processes that wanted to run in the last minute, on average."""
    if not hasattr(os, "getloadavg"):
        return "unknown"
    return f"{os.getloadavg()[0]:.1f}"


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
