"""Plots of the evaluation of cameras: errors of the plates, and by what the cameras state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import halfnorm

from nlens_video.evaluate.camera.angles import AngleError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = {
    "pitch": ("pitch [deg]", 10.0),
    "roll": ("roll [deg]", 5.0),
    "fov_share": ("field of view [%]", 50.0),
}
_INK, _ALL, _SURE = "#222222", "#9aa5ad", "#0072b2"
_LARGEST = 4.0  # of errors by stated ones that are drawn [1]


def error_curves(plates: Sequence[Mapping[str, AngleError]]) -> Figure:
    """Share of plates whose error is at most so large: all, and those called measured.

    Args:
        plates: errors by quantity, at least one that is not empty; empty: was not solved.
    """
    figure, panels = _panels()
    for axes, (name, (label, most)) in zip(panels, _SHOWN.items(), strict=True):
        for only, colour, caption in ((False, _ALL, "all"), (True, _SURE, "called measured")):
            errors = _errors(plates, name, only_measured=only)
            if errors:
                share = np.arange(1, len(errors) + 1) / len(plates)
                sizes = np.sort([abs(one.error) for one in errors])
                axes.step(
                    [0.0, *sizes, most], [0.0, *share, share[-1]], where="post", color=colour, lw=2,
                    label=caption,
                )  # fmt: skip
        axes.set(xlim=(0, most), ylim=(0, 1.02), xlabel=f"error of {label}")
    panels[0].set_ylabel("share of plates")
    panels[0].legend(frameon=False, loc="lower right")
    return figure


def stated_curves(plates: Sequence[Mapping[str, AngleError]]) -> Figure:
    """Share of plates by error in units of the stated one, with what a normal error would give.

    Args:
        plates: errors by quantity, at least one.
    """
    figure, panels = _panels()
    at = np.linspace(0.0, _LARGEST, 200)
    for axes, (name, (label, _)) in zip(panels, _SHOWN.items(), strict=True):
        axes.plot(at, halfnorm.cdf(at), "--", color=_INK, lw=1, label="normal errors")
        for only, colour, caption in ((False, _ALL, "all"), (True, _SURE, "called measured")):
            errors = [e for e in _errors(plates, name, only_measured=only) if e.stated > 0.0]
            if errors:
                ratios = np.sort([abs(one.error) / one.stated for one in errors])
                share = np.arange(1, len(errors) + 1) / len(errors)
                axes.step(
                    [0.0, *ratios, max(_LARGEST, ratios[-1])], [0.0, *share, 1.0], where="post",
                    color=colour, lw=2, label=caption,
                )  # fmt: skip
        axes.axvline(1.0, color=_INK, lw=0.7)
        axes.set(xlim=(0, _LARGEST), ylim=(0, 1.02), xlabel=f"error by stated error, {label}")
    panels[0].set_ylabel("share of plates")
    panels[0].legend(frameon=False, loc="lower right")
    return figure


def _errors(
    plates: Sequence[Mapping[str, AngleError]], name: str, *, only_measured: bool
) -> list[AngleError]:
    errors = [plate[name] for plate in plates if name in plate]
    return [one for one in errors if one.measured or not only_measured]


def _panels() -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4), layout="constrained")
    panels = [figure.add_subplot(1, len(_SHOWN), n + 1) for n in range(len(_SHOWN))]
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e5e8ea", lw=0.7)
        axes.set_axisbelow(True)
    return figure, panels
