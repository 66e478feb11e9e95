"""Figures of the shipped repair network on held-out objects, through the program's own code.

python -m models.reblur.evaluate --validation /tmp/reblur_val --out models/reblur/figures.csv
"""

from __future__ import annotations

import argparse
import csv
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from models.reblur.data import Reservoir, split_maps
from models.reblur.lens import Float32
from models.reblur.shapes import CATEGORIES
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxRepairNetwork
from nlens_video.stages.l_depth_order import Candidates

PLATE = 0.18
RIM_PX = 12  # of the crop, where the network sees less than it would


@dataclass(frozen=True, slots=True)
class Row:
    """Means over a category; PSNR of code values (gamma 2.2, flat above white) over a grey plate.

    Attributes:
        category: of `shapes.CATEGORIES`.
        objects: how many.
        scatter_db: PSNR of the scatter [dB].
        ordered_db: of the ordered layers, without the network [dB].
        network_db: of what the program gives [dB].
        worst_gain_db: least gain over the scatter of one object [dB].
        better: share of the objects that gain.
    """

    category: str
    objects: int
    scatter_db: float
    ordered_db: float
    network_db: float
    worst_gain_db: float
    better: float


def psnr(found: Float32, truth: Float32) -> float:
    """PSNR of two layers (h, w, 4) over the plate [dB]."""
    seen = []
    for rgba in (found, truth):
        light = rgba[..., :3] + (1.0 - rgba[..., 3:]) * PLATE
        seen.append(np.clip(light, 0.0, 1.0)[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX] ** (1 / 2.2))
    return float(-10 * math.log10(max(float(np.mean((seen[0] - seen[1]) ** 2)), 1e-9)))


def evaluate(data: Reservoir, network: OnnxRepairNetwork) -> list[Row]:
    """A row for each category."""
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in CATEGORIES}
    for index in range(data.drawn):
        maps = split_maps(data.maps[index])
        names = ("scattered", "near", "back", "covariance", "geometry")
        made = Candidates(**{name: maps[name] for name in names})
        where, truth = maps["where"][..., 0], maps["truth"]
        trusted = np.zeros((*where.shape, 2), np.float32)
        trusted[..., 0] = 1.0
        results = (
            made.scattered,
            made.resolve(trusted, where),
            made.resolve(network(made.geometry), where),
        )
        scattered, ordered, mended = (psnr(result, truth) for result in results)
        found[CATEGORIES[index % len(CATEGORIES)]].append((scattered, ordered, mended))
    rows = []
    for name, values in found.items():
        table = np.array(values)
        gain = table[:, 2] - table[:, 0]
        means = (round(float(mean), 2) for mean in table.mean(axis=0))
        worst, better = round(float(gain.min()), 2), round(float((gain > 0).mean()), 3)
        rows.append(Row(name, len(values), *means, worst, better))
    return rows


def main() -> None:
    """Print the figures and write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--validation", type=Path, required=True, help="held-out reservoir")
    parser.add_argument("--out", type=Path, help="CSV file")
    options = parser.parse_args()
    network = OnnxRepairNetwork(find_model("reblur").path)
    rows = [asdict(row) for row in evaluate(Reservoir(options.validation), network)]
    for row in rows:
        print(row)
    if options.out:
        with options.out.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
