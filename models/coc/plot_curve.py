"""Draw the training curve: python -m models.coc.plot_curve curve.csv curve.png."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt

PANELS = {
    "negative log-likelihood of log(1 + CoC)": ("train_nll", "held_out_nll"),
    "RMSE [px]": (
        "held_out_rmse_px",
        "held_out_confident_rmse_px",
        "plates_rmse_px",
        "plates_confident_rmse_px",
    ),
}


def main(source: Path, target: Path) -> None:
    """Write the plot of a run's `curve.csv`."""
    with source.open(newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    figure, axes = plt.subplots(1, len(PANELS), figsize=(9, 3.4), layout="constrained")
    for axis, (title, keys) in zip(axes, PANELS.items(), strict=True):
        for key in keys:
            if key in rows[0]:
                axis.plot([row["minutes"] for row in rows], [row[key] for row in rows], label=key)
        axis.set(title=title, xlabel="training time [min]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
