"""The picture of `evaluate composite`: each method's PSNR, and its gain over naive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nlens_video.evaluate.metrics import LEVEL, Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
