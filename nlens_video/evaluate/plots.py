"""Plots of the evaluation reports: accuracy over time, gains, reliability, error by CoC."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32
from nlens_video.evaluate.metrics import LEVEL, Interval, binned_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

BUDGET_MS = 180.0
"""What the paper takes for a frame."""

_INK, _OURS, _OTHERS = "#222222", "#0072b2", "#9aa5ad"
_LEAST_MS = 0.1  # what takes less is drawn there: a copy has no place on a log axis
_SIGMA_EDGES = np.geomspace(0.1, 100.0, 25)
_COC_STEP_PX = 2.0
_FEWEST = 100  # samples below which a bin's mean is noise and is not drawn


class Point(Struct, frozen=True):
    """A reblur method: its time [ms] and PSNR [dB], and whether it is one of ours."""

    name: str
    ms: float
    psnr_db: float
    ours: bool


class Bar(Struct, frozen=True, kw_only=True):
    """A compositing method: PSNR and gain over naive, over scenes and of each plate [dB]."""

    name: str
    psnr_db: Interval
    gain_db: Interval
    plates_db: Sequence[float]
    plate_gains_db: Sequence[float]


class PlateErrors(Struct, frozen=True, kw_only=True):
    """Estimate - truth, its expected error and the true diameter on one plate, all (N,) [px]."""

    error_px: Float32
    sigma_px: Float32
    true_coc_px: Float32


def pareto(points: Sequence[Point]) -> list[Point]:
    """Those than which none is both quicker and more accurate, from the quickest on."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p.ms, -p.psnr_db)):
        if not front or point.psnr_db > front[-1].psnr_db:
            front.append(point)
    return front


def accuracy_over_time(panels: Sequence[tuple[str, Sequence[Point]]]) -> Figure:
    """A panel for each title and its points, side by side, with the Pareto front."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8 * len(panels), 5.5), layout="constrained")
    for number, (title, points) in enumerate(panels):
        _accuracy_panel(figure.add_subplot(1, len(panels), number + 1), title, points)
    return figure


def _accuracy_panel(axes: Axes, title: str, points: Sequence[Point]) -> None:
    drawn = [Point(p.name, max(p.ms, _LEAST_MS), p.psnr_db, p.ours) for p in points]
    front = pareto(drawn)
    axes.step(
        [p.ms for p in front], [p.psnr_db for p in front], where="post", color=_OURS, lw=1.5,
        alpha=0.5, label="Pareto front",
    )  # fmt: skip
    for point in drawn:
        colour = _OURS if point.ours else _OTHERS
        axes.plot(point.ms, point.psnr_db, "o", color=colour, ms=8, zorder=3)
    _label(axes, drawn)
    axes.axvline(BUDGET_MS, color=_INK, lw=1, ls="--")
    axes.text(
        BUDGET_MS, 0.02, f" {BUDGET_MS:g} ms", transform=axes.get_xaxis_transform(), color=_INK
    )
    axes.plot([], [], "o", color=_OURS, label="nlens-video")
    axes.plot([], [], "o", color=_OTHERS, label="others' methods")
    slowest = max([BUDGET_MS, *(p.ms for p in drawn)])
    axes.set(xscale="log", xlim=(0.6 * _LEAST_MS, 6 * slowest))
    axes.set(xlabel="reblur of a frame, median [ms]", ylabel="PSNR against the lens [dB]")
    axes.set_title(title, loc="left")
    _plain(axes)
    _plain_ticks(axes.xaxis)
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


def accuracy_bars(bars: Sequence[Bar]) -> Figure:
    """PSNR and gain over naive in two panels, a row for each method."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 1.6 + 0.45 * len(bars)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _bars(left, [(bar.psnr_db, bar.plates_db) for bar in bars], "PSNR in the object's box [dB]")
    _bars(right, [(bar.gain_db, bar.plate_gains_db) for bar in bars], "gain over naive [dB]")
    right.axvline(0, color=_INK, lw=1, ls="--")
    left.set_yticks(range(len(bars)), [bar.name for bar in bars])
    left.invert_yaxis()
    left.plot([], [], "o", color=_OTHERS, ms=4, label="each plate")
    left.plot([], [], "D-", color=_OURS, ms=7, label=f"mean over scenes, {LEVEL:.0%} interval")
    figure.legend(frameon=False, loc="outside lower center", ncols=2)
    return figure


def _bars(axes: Axes, rows: Sequence[tuple[Interval, Sequence[float]]], label: str) -> None:
    for number, (interval, plates) in enumerate(rows):
        axes.plot(plates, [number] * len(plates), "o", color=_OTHERS, ms=4)
        half = interval.half if math.isfinite(interval.half) else 0.0
        axes.errorbar(interval.mean, number, xerr=half, fmt="D", color=_OURS, ms=7, lw=2, capsize=4)
    axes.set_xlabel(label)
    _plain(axes)


def reliability(errors: Sequence[PlateErrors]) -> Figure:
    """Mean |error| against the predicted sigma, a line for each plate and one for all."""
    figure, axes = _single()
    for plate in errors:
        kept = binned_errors(plate.error_px, plate.sigma_px, _SIGMA_EDGES, _FEWEST)
        axes.plot(kept.at_px, kept.mean_abs_px, color=_OTHERS, lw=1, alpha=0.8)
    sigma = np.concatenate([plate.sigma_px for plate in errors])
    error = np.concatenate([plate.error_px for plate in errors])
    pooled = binned_errors(error, sigma, _SIGMA_EDGES, _FEWEST)
    axes.plot(pooled.at_px, pooled.mean_abs_px, color=_OURS, lw=2.5, label="all plates")
    area = 20 + 900 * pooled.count / pooled.count.sum()
    axes.scatter(pooled.at_px, pooled.mean_abs_px, area, _OURS, label="area: share of the pixels")
    axes.plot([], [], color=_OTHERS, lw=1, label="each plate")
    seen = [float(v) for v in (*pooled.at_px, *pooled.mean_abs_px) if v > 0] or [1.0]
    low, high = 0.6 * min(seen), 1.7 * max(seen)
    axes.plot([low, high], [low, high], "--", color=_INK, lw=1, label="sigma tells the truth")
    axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
    axes.set(xlabel="expected error (sigma) [px]", ylabel="mean |error| of the CoC [px]")
    axes.set_title("Reliability of the expected error", loc="left")
    for axis in (axes.xaxis, axes.yaxis):
        _plain_ticks(axis, (1.0, 2.0, 5.0))
    axes.legend(frameon=False, loc="upper left")
    return figure


def error_by_coc(errors: Sequence[PlateErrors]) -> Figure:
    """Bias and quartiles of the error against the true CoC."""
    figure, axes = _single()
    truth = np.concatenate([plate.true_coc_px for plate in errors])
    edges = np.arange(0.0, float(truth.max()) + _COC_STEP_PX, _COC_STEP_PX)
    edges = np.append(edges, edges[-1] + _COC_STEP_PX)
    for plate in errors:
        binned = binned_errors(plate.error_px, plate.true_coc_px, edges, _FEWEST)
        axes.plot(binned.at_px, binned.bias_px, color=_OTHERS, lw=1, alpha=0.8)
    error = np.concatenate([plate.error_px for plate in errors])
    pooled = binned_errors(error, truth, edges, _FEWEST)
    axes.fill_between(
        pooled.at_px, pooled.quartiles_px[:, 0], pooled.quartiles_px[:, 2],
        color=_OURS, alpha=0.2, lw=0, label="quartiles",
    )  # fmt: skip
    axes.plot(pooled.at_px, pooled.quartiles_px[:, 1], ":", color=_OURS, lw=1.5, label="median")
    axes.plot(pooled.at_px, pooled.bias_px, "o-", color=_OURS, lw=2.5, ms=5, label="bias, all")
    axes.plot([], [], color=_OTHERS, lw=1, label="bias, each plate")
    axes.axhline(0, color=_INK, lw=1, ls="--")
    axes.set(xlabel="true CoC diameter [px]", ylabel="estimate − truth [px]")
    axes.set_title("Error of the CoC by the true CoC", loc="left")
    axes.legend(frameon=False)
    return figure


def _single() -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.add_subplot()
    _plain(axes)
    return figure, axes


def _plain(axes: Axes) -> None:
    """A light grid behind the data, no frame above and to the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e5e8ea", lw=0.7)
    axes.set_axisbelow(True)


def _plain_ticks(axis: Axis, subs: Sequence[float] = (1.0,)) -> None:
    """Numbers such as 0.5 and 20 on a log axis, not powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
