"""Train the repair network on drawn objects, on one CPU thread.

    python -m models.reblur.train --data /tmp/reblur_data --validation /tmp/reblur_val \
        --out /tmp/reblur_run --minutes 25

The loss is the mean logarithm of each object's square error, so that a step is worth the decibels
it brings, whatever the contrast of the object. The learning rate follows a cosine over the training
time. An interrupted run resumes from its checkpoint; `--begin-from` starts from shipped weights.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from models.reblur.data import Reservoir, split_maps
from models.reblur.network import RepairNet, error, resolve
from models.reblur.shapes import CATEGORIES
from models.training import Schedule, TrainingRun, arguments, train

RIM_PX = 12  # not counted: the network would see beyond the crop there
FLOOR = 2e-6  # square error that counts as none: 57 dB
CHECK_EVERY_S = 240.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(Schedule):
    """Schedule and batches of a run.

    Attributes:
        batch: objects of a batch.
    """

    minutes: float = 25.0
    rate: float = 2e-3
    warm_up_steps: int = 200
    batch: int = 6


def to_tensors(maps: dict[str, np.ndarray]) -> dict[str, Tensor]:
    """Maps (N, H, W, c) as tensors (N, c, H, W)."""
    return {
        name: torch.from_numpy(np.ascontiguousarray(part)).permute(0, 3, 1, 2)
        for name, part in maps.items()
    }


def draw_batch(rng: np.random.Generator, data: Reservoir, count: int) -> dict[str, Tensor]:
    """Random objects, turned and mirrored."""
    picked = []
    for index in rng.integers(0, data.drawn, count):
        turned = np.rot90(data.maps[index], int(rng.integers(4)))
        picked.append(turned[:, :: int(rng.integers(2)) * 2 - 1])
    return to_tensors(split_maps(np.stack(picked)))


class Run(TrainingRun):
    """Training of the repair network."""

    EMA_DECAY = 0.998

    def build(self) -> RepairNet:
        """The repair network."""
        return RepairNet()

    def loss(self, data: Reservoir) -> tuple[Tensor, float]:
        """Mean logarithm of the square error, and the batch's gain over the scatter [dB]."""
        parts = draw_batch(self.rng, data, self.recipe.batch)
        plate = torch.from_numpy(self.rng.uniform(0, 0.8, (self.recipe.batch, 3, 1, 1))).float()
        geometry = parts["geometry"].contiguous(memory_format=torch.channels_last)
        found = resolve(parts, self.network(geometry))
        loss = torch.log(error(found, parts["truth"], plate, RIM_PX) + FLOOR).mean()
        before = error(parts["scattered"], parts["truth"], plate, RIM_PX)
        gain = torch.log(before + FLOOR).mean() - loss.detach()
        return loss, float(gain) * 10 / math.log(10)


def validate(network: RepairNet, data: Reservoir) -> dict[str, tuple[float, float, float]]:
    """Mean PSNR of scatter, ordered layers and network by category of held-out objects [dB]."""
    figures: dict[str, list[tuple[float, float, float]]] = {name: [] for name in CATEGORIES}
    plate = torch.full((1, 3, 1, 1), 0.18)
    for index in range(data.drawn):
        parts = to_tensors(split_maps(data.maps[index : index + 1]))
        with torch.inference_mode():
            judgement = network(parts["geometry"])
            ordered = torch.zeros_like(judgement)
            ordered[:, :1] = 1.0
            found = (parts["scattered"], resolve(parts, ordered), resolve(parts, judgement))
            row = [float(error(f, parts["truth"], plate, RIM_PX)) for f in found]
        psnr = [-10 * math.log10(max(value, 1e-9)) for value in row]
        figures[CATEGORIES[index % len(CATEGORIES)]].append((psnr[0], psnr[1], psnr[2]))
    return {
        name: (float(mean[0]), float(mean[1]), float(mean[2]))
        for name, rows in figures.items()
        if rows
        for mean in [np.mean(rows, axis=0)]
    }


def held_out(run: Run, options: argparse.Namespace) -> dict[str, float]:
    """PSNR by category of the held-out objects [dB]."""
    row = {}
    for name, values in validate(run.average, Reservoir(options.validation)).items():
        scattered, ordered, network = values
        print(f"  {name:10} scatter {scattered:.2f}  ordered {ordered:.2f}  network {network:.2f}")
        for method, value in (("scatter", scattered), ("ordered", ordered), ("network", network)):
            row[f"{name}_{method}_db"] = round(value, 3)
    return row


def main() -> None:
    """Train until the time is up."""
    options = arguments(__doc__, Recipe()).parse_args()
    torch.set_num_threads(1)
    run = Run(Recipe(minutes=options.minutes, rate=options.rate))
    train(
        run, Reservoir(options.data), options, lambda: held_out(run, options),
        figure=("train_gain_db", 3), shown=lambda gain: f"gain {gain:.2f} dB",
        check_every_s=CHECK_EVERY_S,
    )  # fmt: skip


if __name__ == "__main__":
    main()
