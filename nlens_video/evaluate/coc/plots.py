"""Plots of an evaluation: is the expected error true, and where does the estimate err."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.evaluate.metrics import BinnedErrors, binned_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from nlens_video.evaluate.coc.protocol import PlateErrors

_SIGMA_EDGES = np.geomspace(0.1, 100.0, 25)
_COC_STEP_PX = 2.0
_FEWEST = 100  # samples below which a bin's mean is noise and is not drawn
_INK, _OURS, _PLATES = "#222222", "#0072b2", "#9aa5ad"


def plot_reliability(errors: Sequence[PlateErrors], path: Path) -> None:
    """Mean |error| against the predicted sigma, a line for each plate and one for all (PNG)."""
    figure, axes = _figure()
    for plate in errors:
        _line(axes, binned_errors(plate.error_px, plate.sigma_px, _SIGMA_EDGES))
    error, sigma = _pooled(errors, "sigma_px")
    pooled = _counted(binned_errors(error, sigma, _SIGMA_EDGES))
    axes.plot(pooled.at_px, pooled.mean_abs_px, color=_OURS, lw=2.5, label="all plates")
    area = 20 + 900 * pooled.count / pooled.count.sum()
    axes.scatter(pooled.at_px, pooled.mean_abs_px, area, _OURS, label="area: share of the pixels")
    axes.plot([], [], color=_PLATES, lw=1, label="each plate")
    seen = [float(v) for v in (*pooled.at_px, *pooled.mean_abs_px) if v > 0] or [1.0]
    low, high = 0.6 * min(seen), 1.7 * max(seen)
    axes.plot([low, high], [low, high], "--", color=_INK, lw=1, label="sigma tells the truth")
    axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
    axes.set(xlabel="expected error (sigma) [px]", ylabel="mean |error| of the CoC [px]")
    axes.set_title("Reliability of the expected error", loc="left")
    _plain_ticks(axes)
    axes.legend(frameon=False, loc="upper left")
    _save(figure, path)


def plot_error_by_coc(errors: Sequence[PlateErrors], path: Path) -> None:
    """Bias and quartiles of the error against the true CoC (PNG)."""
    figure, axes = _figure()
    error, truth = _pooled(errors, "true_coc_px")
    edges = np.arange(0.0, float(truth.max()) + _COC_STEP_PX, _COC_STEP_PX)
    edges = np.append(edges, edges[-1] + _COC_STEP_PX)
    for plate in errors:
        binned = _counted(binned_errors(plate.error_px, plate.true_coc_px, edges))
        axes.plot(binned.at_px, binned.bias_px, color=_PLATES, lw=1, alpha=0.8)
    pooled = _counted(binned_errors(error, truth, edges))
    axes.fill_between(
        pooled.at_px, pooled.quartiles_px[:, 0], pooled.quartiles_px[:, 2],
        color=_OURS, alpha=0.2, lw=0, label="quartiles",
    )  # fmt: skip
    axes.plot(pooled.at_px, pooled.quartiles_px[:, 1], ":", color=_OURS, lw=1.5, label="median")
    axes.plot(pooled.at_px, pooled.bias_px, "o-", color=_OURS, lw=2.5, ms=5, label="bias, all")
    axes.plot([], [], color=_PLATES, lw=1, label="bias, each plate")
    axes.axhline(0, color=_INK, lw=1, ls="--")
    axes.set(xlabel="true CoC diameter [px]", ylabel="estimate − truth [px]")
    axes.set_title("Error of the CoC by the true CoC", loc="left")
    axes.legend(frameon=False)
    _save(figure, path)


def _figure() -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e5e8ea", lw=0.7)
    axes.set_axisbelow(True)
    return figure, axes


def _line(axes: Axes, binned: BinnedErrors) -> None:
    kept = _counted(binned)
    axes.plot(kept.at_px, kept.mean_abs_px, color=_PLATES, lw=1, alpha=0.8)


def _counted(binned: BinnedErrors) -> BinnedErrors:
    """Bins with enough samples; all where none has."""
    use = binned.count >= min(_FEWEST, int(binned.count.max(initial=0)))
    return BinnedErrors(
        at_px=binned.at_px[use],
        mean_abs_px=binned.mean_abs_px[use],
        quartiles_px=binned.quartiles_px[use],
        bias_px=binned.bias_px[use],
        count=binned.count[use],
    )


def _pooled(errors: Sequence[PlateErrors], by: str) -> tuple[Float32, Float32]:
    return (
        np.concatenate([plate.error_px for plate in errors]),
        np.concatenate([getattr(plate, by) for plate in errors]),
    )


def _plain_ticks(axes: Axes) -> None:
    """Numbers such as 0.5 and 20 on log axes, not powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=120, format="png", metadata={"Software": ""})
