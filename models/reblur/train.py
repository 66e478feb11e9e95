"""Train the repair network on drawn objects, on one CPU thread.

    python -m models.reblur.train --data /tmp/reblur_data --validation /tmp/reblur_val \
        --out /tmp/reblur_run --minutes 25

The loss is the mean logarithm of each object's square error, so that a step is worth the decibels
it brings, whatever the contrast of the object. The learning rate follows a cosine over the training
time. A run that stopped goes on from its checkpoint; `--begin-from` starts from shipped weights.
"""

from __future__ import annotations

import argparse
import copy
import csv
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from models.reblur.data import Reservoir, split_maps
from models.reblur.network import RepairNet, error, resolve
from models.reblur.shapes import CATEGORIES

WARM_UP_STEPS = 200
EMA_DECAY = 0.998
RIM_PX = 12  # not counted: the network would see beyond the crop there
FLOOR = 2e-6  # square error that counts as none: 57 dB
CHECK_EVERY_S = 240.0


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a run does.

    Attributes:
        minutes: training time, checks not counted [min].
        rate: peak learning rate.
        batch: objects of a batch.
        seed: of the weights and the batches.
    """

    minutes: float = 25.0
    rate: float = 2e-3
    batch: int = 6
    seed: int = 1

    def rate_at(self, progress: float, step: int) -> float:
        """Learning rate at a share of the time."""
        warm = min(1.0, (step + 1) / WARM_UP_STEPS)
        return self.rate * warm * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(progress, 1))))


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


class Run:
    """The state of a training run: weights, their moving average, the optimiser, the clock."""

    def __init__(self, recipe: Recipe) -> None:
        torch.manual_seed(recipe.seed)
        self.recipe = recipe
        self.network = RepairNet().to(memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.network).eval()
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), recipe.rate, betas=(0.9, 0.99), weight_decay=0.01
        )
        self.rng = np.random.default_rng(recipe.seed)
        self.step = 0
        self.trained_s = 0.0

    @property
    def progress(self) -> float:
        """Share of the training time that has passed."""
        return self.trained_s / (60 * self.recipe.minutes)

    def advance(self, data: Reservoir) -> float:
        """One step; returns the batch's gain over the scatter [dB]."""
        start = time.perf_counter()
        parts = draw_batch(self.rng, data, self.recipe.batch)
        plate = torch.from_numpy(self.rng.uniform(0, 0.8, (self.recipe.batch, 3, 1, 1))).float()
        for group in self.optimiser.param_groups:
            group["lr"] = self.recipe.rate_at(self.progress, self.step)
        geometry = parts["geometry"].contiguous(memory_format=torch.channels_last)
        found = resolve(parts, self.network(geometry))
        wrong = torch.log(error(found, parts["truth"], plate, RIM_PX) + FLOOR)
        self.optimiser.zero_grad(set_to_none=True)
        wrong.mean().backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimiser.step()
        decay = min(EMA_DECAY, (self.step + 1) / (self.step + 10))
        with torch.no_grad():
            for slow, fast in zip(
                self.average.parameters(), self.network.parameters(), strict=True
            ):
                slow.lerp_(fast, 1 - decay)
            before = error(parts["scattered"], parts["truth"], plate, RIM_PX)
        self.step += 1
        self.trained_s += time.perf_counter() - start
        gain = torch.log(before + FLOOR).mean() - wrong.detach().mean()
        return float(gain) * 10 / math.log(10)

    def save(self, path: Path) -> None:
        """Write a checkpoint; the old one stays until the new one is complete."""
        state = {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "trained_s": self.trained_s,
        }
        fresh = path.with_suffix(".new")
        torch.save(state, fresh)
        fresh.replace(path)

    def load(self, path: Path) -> None:
        """Go on from a checkpoint (other batches follow than without the stop)."""
        state = torch.load(path, weights_only=True)
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.trained_s = state["step"], state["trained_s"]
        self.rng = np.random.default_rng([self.recipe.seed, self.step])

    def begin_from(self, path: Path) -> None:
        """Take the shipped half-precision weights as the beginning of a new run."""
        weights = torch.load(path, weights_only=True)
        state = {name: value.float() for name, value in weights.items()}
        self.network.load_state_dict(state)
        self.average.load_state_dict(state)


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


def check(run: Run, gain: float, options: argparse.Namespace) -> None:
    """Validate, log a line in the curve, save."""
    figures = validate(run.average, Reservoir(options.validation))
    row: dict[str, float] = {
        "minutes": round(run.trained_s / 60, 2),
        "step": run.step,
        "train_gain_db": round(gain, 3),
    }
    for name, (scattered, ordered, network) in figures.items():
        print(f"  {name:10} scatter {scattered:.2f}  ordered {ordered:.2f}  network {network:.2f}")
        row[f"{name}_scatter_db"] = round(scattered, 3)
        row[f"{name}_ordered_db"] = round(ordered, 3)
        row[f"{name}_network_db"] = round(network, 3)
    curve = options.out / "curve.csv"
    fresh = not curve.exists()
    with curve.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        if fresh:
            writer.writeheader()
        writer.writerow(row)
    run.save(options.out / "checkpoint.pt")


def main() -> None:
    """Train until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="reservoir written by data.py")
    parser.add_argument("--validation", type=Path, required=True, help="held-out reservoir")
    parser.add_argument("--out", type=Path, required=True, help="checkpoint and curve")
    parser.add_argument("--minutes", type=float, default=Recipe().minutes)
    parser.add_argument("--rate", type=float, default=Recipe().rate)
    parser.add_argument("--begin-from", type=Path, help="shipped weights")
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.out.mkdir(parents=True, exist_ok=True)
    run = Run(Recipe(minutes=options.minutes, rate=options.rate))
    if (options.out / "checkpoint.pt").exists():
        run.load(options.out / "checkpoint.pt")
    elif options.begin_from:
        run.begin_from(options.begin_from)
    data = Reservoir(options.data)
    recent, checked = 0.0, run.trained_s
    while run.progress < 1:
        gain = run.advance(data)
        recent = gain if run.step == 1 else recent * 0.99 + 0.01 * gain
        if run.step % 100 == 0:
            minutes = run.trained_s / 60
            print(f"{minutes:6.1f} min  step {run.step}  gain {recent:.2f} dB", flush=True)
        if run.trained_s - checked > CHECK_EVERY_S or run.progress >= 1:
            check(run, recent, options)
            checked = run.trained_s


if __name__ == "__main__":
    main()
