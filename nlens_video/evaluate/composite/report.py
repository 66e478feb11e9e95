"""What composites were measured to be as tables, files and a picture."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from nlens_video.evaluate.composite.methods import ABOUT, NAIVE
from nlens_video.evaluate.composite.paper_figures import paper_comparison
from nlens_video.evaluate.metrics import LEVEL, Interval, over_scenes
from nlens_video.evaluate.tables import Column, Table, grid
from nlens_video.video.atomic_files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_COMPARED = {"psnr_db": 2, "ssim": 3, "rmse_px": 2}


def composites_table() -> Table:
    """An empty table of composites."""
    return Table(
        name="composite",
        title="Composites against the truth",
        columns=(
            Column("psnr_db", "PSNR [dB]"),
            Column("ssim", "SSIM", 4),
            Column("band_psnr_db", "band, PSNR [dB]"),
            Column("band_ssim", "band, SSIM", 4),
            Column("object_rms_px", "object's CoC, rms [px]"),
            Column("time_s", "time [s]", 2, "median"),
            Column("psnr_db", "plates", 0, "count"),
        ),
        detail="psnr_db",
        notes=(
            "PSNR and SSIM of 8-bit code values, in the tightest box around the sharp object; "
            "band: over the pixels around its outline that the true lens mixes with the plate. "
            "Time is that of the graph on one still, networks loaded and the lens found where it "
            "is not told; the median over the plates, on a machine that may do other work. Means "
            "are over the plates on which a lens was found. The preset `reference` needs the GLB "
            "from several sides and is not among the rows.",
            ABOUT,
        ),
    )


def plates_coc_table() -> Table:
    """An empty table of estimates of the plate's CoC."""
    return Table(
        name="composite_plate_coc",
        title="CoC of the whole plate",
        columns=(Column("rmse_px", "RMSE [px]"),),
        detail="rmse_px",
        notes=("The quadratic is told the true depth and the true sharp picture.",),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Everything that is told.

    Attributes:
        machine: what it ran on, in words.
        passed: folders that were passed over.
        scenes: scene of each plate.
        composites: of `composites_table`.
        plates_coc: of `plates_coc_table`.
    """

    machine: Mapping[str, str]
    passed: tuple[str, ...]
    scenes: dict[str, str] = field(default_factory=dict)
    composites: Table = field(default_factory=composites_table)
    plates_coc: Table = field(default_factory=plates_coc_table)

    def intervals(self) -> dict[tuple[str, str], Interval]:
        """Each figure that is compared: its mean over scenes, by name of its row and key."""
        found = {}
        for table in (self.composites, self.plates_coc):
            for row in table.rows():
                for key in _COMPARED:
                    interval = over_scenes(self._by_scene(table, row, key))
                    if interval.scenes:
                        found[row, key] = interval
        return found

    def gains(self) -> dict[str, Interval]:
        """PSNR above the naive composite of the same plate, by name of the row [dB]."""
        naive = dict(self._by_plate(self.composites, NAIVE, "psnr_db"))
        return {
            row: over_scenes(
                (self.scenes[plate], figure - naive[plate])
                for plate, figure in self._by_plate(self.composites, row, "psnr_db")
            )
            for row in self.composites.rows()
        }

    def markdown(self) -> str:
        """All of it, readable in a terminal too."""
        heading = [f"# Composites of {len(self.scenes)} plates", ", ".join(self.scenes)]
        if self.passed:
            heading.append(f"Passed over, no stills: {', '.join(self.passed)}")
        heading.append("\n".join(f"- {name}: {value}" for name, value in self.machine.items()))
        parts = [
            "\n\n".join(heading) + "\n",
            paper_comparison(self.intervals()),
            self._over_scenes(),
            self.composites.markdown(),
            self.plates_coc.markdown(),
        ]
        return "\n".join(parts)

    def json(self) -> str:
        """The same figures for scripts."""
        figures = {
            "machine": dict(self.machine),
            "plates": list(self.scenes),
            "passed_over": list(self.passed),
            "gain_db": {row: _known(interval) for row, interval in self.gains().items()},
            **{table.name: table.json() for table in (self.composites, self.plates_coc)},
        }
        return json.dumps(figures, indent=2) + "\n"

    def write(self, out: Path) -> None:
        """Write `composite.md`, a CSV for each table and `composite.png` into a folder.

        Raises:
            OutputError: one of them cannot be written.
        """
        picture = "\n![PSNR of each method, and its gain over naive](composite.png)\n"
        texts = {
            "composite.md": self.markdown() + picture,
            **{f"{t.name}.csv": t.csv() for t in (self.composites, self.plates_coc)},
        }
        for name, text in texts.items():
            with replacing(out / name) as partial_path:
                partial_path.write_text(text, encoding="utf-8")
        with replacing(out / "composite.png") as partial_path:
            plot(self._bars(), partial_path)

    def _bars(self) -> list[Bar]:
        intervals, gains = self.intervals(), self.gains()
        naive = dict(self._by_plate(self.composites, NAIVE, "psnr_db"))
        bars = []
        for row in self.composites.rows():
            if (row, "psnr_db") in intervals:
                on = dict(self._by_plate(self.composites, row, "psnr_db"))
                bars.append(
                    Bar(
                        name=row,
                        psnr_db=intervals[row, "psnr_db"],
                        gain_db=gains[row],
                        plates_db=tuple(on.values()),
                        plate_gains_db=tuple(on[plate] - naive[plate] for plate in on),
                    )
                )
        return bars

    def _over_scenes(self) -> str:
        intervals, gains = self.intervals(), self.gains()
        rows = [
            [
                row,
                *(intervals[row, key].text(_COMPARED[key]) for key in ("psnr_db", "ssim")),
                gains[row].text(2),
            ]
            for row in self.composites.rows()
            if (row, "psnr_db") in intervals
        ]
        count = len(set(self.scenes.values()))
        return (
            f"## Over scenes\n\n{grid(['', 'PSNR [dB]', 'SSIM', 'gain over naive [dB]'], rows)}\n\n"
            f"Mean over {count} scenes, each the mean of its plates, ± half the {LEVEL:.0%} "
            "interval (Student's t): plates of one scene are no independent samples, and few "
            "scenes leave wide intervals. The gain is taken plate by plate.\n"
        )

    def _by_plate(self, table: Table, row: str, key: str) -> list[tuple[str, float]]:
        return [
            (entry.plate, entry.figures[key])
            for entry in table.entries
            if entry.row == row and math.isfinite(entry.figures.get(key, math.nan))
        ]

    def _by_scene(self, table: Table, row: str, key: str) -> list[tuple[str, float]]:
        return [(self.scenes[plate], f) for plate, f in self._by_plate(table, row, key)]


def _known(interval: Interval) -> dict[str, float | int | None]:
    half = round(interval.half, 4) if math.isfinite(interval.half) else None
    mean = round(interval.mean, 4) if math.isfinite(interval.mean) else None
    return {"mean": mean, "half_width": half, "scenes": interval.scenes}


_INK, _MEAN, _PLATES = "#222222", "#0072b2", "#9aa5ad"


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A method in the picture.

    Attributes:
        name: of its row.
        psnr_db: mean over scenes [dB].
        gain_db: over naive, mean over scenes [dB].
        plates_db: each plate's PSNR [dB].
        plate_gains_db: each plate's gain over naive [dB].
    """

    name: str
    psnr_db: Interval
    gain_db: Interval
    plates_db: tuple[float, ...]
    plate_gains_db: tuple[float, ...]


def plot(bars: Sequence[Bar], path: Path) -> None:
    """Draw both panels, a row for each method (PNG)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 1.6 + 0.45 * len(bars)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _panel(left, [(bar.psnr_db, bar.plates_db) for bar in bars], "PSNR in the object's box [dB]")
    _panel(right, [(bar.gain_db, bar.plate_gains_db) for bar in bars], "gain over naive [dB]")
    right.axvline(0, color=_INK, lw=1, ls="--")
    left.set_yticks(range(len(bars)), [bar.name for bar in bars])
    left.invert_yaxis()
    left.plot([], [], "o", color=_PLATES, ms=4, label="each plate")
    left.plot([], [], "D-", color=_MEAN, ms=7, label=f"mean over scenes, {LEVEL:.0%} interval")
    figure.legend(frameon=False, loc="outside lower center", ncols=2)
    figure.savefig(path, dpi=120, format="png", metadata={"Software": ""})


def _panel(axes: Axes, rows: Sequence[tuple[Interval, tuple[float, ...]]], label: str) -> None:
    for number, (interval, plates) in enumerate(rows):
        axes.plot(plates, [number] * len(plates), "o", color=_PLATES, ms=4)
        half = interval.half if math.isfinite(interval.half) else 0.0
        axes.errorbar(interval.mean, number, xerr=half, fmt="D", color=_MEAN, ms=7, lw=2, capsize=4)
    axes.set_xlabel(label)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e5e8ea", lw=0.7)
    axes.set_axisbelow(True)
