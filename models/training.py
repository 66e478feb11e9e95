"""Training on one CPU thread or a GPU: cosine schedule over training time, checkpoints, curve."""

from __future__ import annotations

import argparse
import copy
import csv
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

WEIGHT_DECAY = 0.01  # of AdamW
GRADIENT_NORM = 1.0  # at which gradients are clipped
Shown = float | Tensor
"""A figure; of a run on a GPU a tensor, which is waited for only where it is shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Learning rate: linear warm-up, then a cosine over the training time.

    Attributes:
        minutes: training time, validation not counted [min].
        rate: peak learning rate.
        warm_up_steps: steps until the peak.
        last: learning rate at the end, as a share of the peak.
        seed: of the weights and the batches.
    """

    minutes: float
    rate: float
    warm_up_steps: int
    last: float = 0.01
    seed: int = 1

    def rate_at(self, progress: float, step: int) -> float:
        """Learning rate at a share of the training time."""
        warm = min(1.0, (step + 1) / self.warm_up_steps)
        cosine = 0.5 * (1 + math.cos(math.pi * min(progress, 1)))
        return self.rate * warm * (self.last + (1 - self.last) * cosine)


class TrainingRun(ABC):
    """State of a training run: weights, their moving average, optimiser, clock.

    Subclasses build the network and define the loss of one batch.

    Args:
        recipe: the schedule and what else a subclass needs.
        device: where the weights lie, as torch names it.
    """

    EMA_DECAY: ClassVar[float | None] = None
    """Decay of the moving average of the weights; None: no average is kept."""
    BETAS: ClassVar[tuple[float, float]] = (0.9, 0.99)

    def __init__(
        self,
        recipe: Any,  # noqa: ANN401  each subclass its own schedule
        device: str = "cpu",
    ) -> None:
        torch.manual_seed(recipe.seed)
        self.recipe = recipe
        self.device = torch.device(device)
        self.network = self.build().to(self.device, memory_format=torch.channels_last)
        self.average = self.network
        if self.EMA_DECAY is not None:
            self.average = copy.deepcopy(self.network).eval()
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), recipe.rate, betas=self.BETAS, weight_decay=WEIGHT_DECAY
        )
        self.rng = np.random.default_rng(recipe.seed)
        self.step = 0
        self.trained_s = 0.0

    @abstractmethod
    def build(self) -> nn.Module:
        """The network with fresh weights."""

    @abstractmethod
    def loss(self, data: Any) -> tuple[Tensor, Shown]:  # noqa: ANN401  each subclass its own data
        """Loss of one random batch, and the figure that the log shows."""

    @property
    def progress(self) -> float:
        """Share of the training time that has passed."""
        return self.trained_s / (60 * self.recipe.minutes)

    def ema_decay_at(self, step: int) -> float:
        """Decay of the moving average at a step: less at first, when the average is of few [1]."""
        return min(self.EMA_DECAY or 0.0, (step + 1) / (step + 10))

    def advance(self, data: Any) -> Shown:  # noqa: ANN401  as for `loss`
        """One optimiser step; returns the figure for the log."""
        start = time.perf_counter()
        for group in self.optimiser.param_groups:
            group["lr"] = self.recipe.rate_at(self.progress, self.step)
        loss, shown = self.loss(data)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), GRADIENT_NORM)
        self.optimiser.step()
        if self.EMA_DECAY is not None:
            decay = self.ema_decay_at(self.step)
            slow, fast = (list(n.parameters()) for n in (self.average, self.network))
            with torch.no_grad():
                get_ema_multi_avg_fn(decay)(slow, fast, self.step)
        self.step += 1
        self.trained_s += time.perf_counter() - start
        return shown

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
        """Resume from a checkpoint (batches differ from those of an uninterrupted run)."""
        state = torch.load(path, weights_only=True, map_location=self.device)
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.trained_s = state["step"], state["trained_s"]
        self.rng = np.random.default_rng([self.recipe.seed, self.step])

    def begin_from(self, path: Path) -> None:
        """Start a new run from shipped weights, or from a checkpoint's averaged ones."""
        weights = self.completed(read_weights(path))
        self.network.load_state_dict(weights)
        self.average.load_state_dict(weights)

    def completed(self, weights: dict[str, Tensor]) -> dict[str, Tensor]:
        """Weights for every parameter of the network; here they must be complete already."""
        return weights


def read_weights(path: Path) -> dict[str, Tensor]:
    """Weights in single precision: a checkpoint's averaged ones, or shipped ones."""
    state = torch.load(path, weights_only=True, map_location="cpu")
    return {name: value.float() for name, value in state.get("average", state).items()}


def append_row(curve: Path, row: dict[str, float]) -> None:
    """Append a line to a learning curve (CSV), with a heading where it is new."""
    fresh = not curve.exists()
    with curve.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        if fresh:
            writer.writeheader()
        writer.writerow(row)


def arguments(
    description: str | None, recipe: Schedule, *, validation: bool = True
) -> argparse.ArgumentParser:
    """The options that every training has.

    Args:
        description: of the command.
        recipe: gives the defaults.
        validation: whether what is held out lies in a file of its own.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--data", type=Path, required=True, help="what data.py wrote")
    if validation:
        parser.add_argument("--validation", type=Path, required=True, help="likewise, held out")
    parser.add_argument("--out", type=Path, required=True, help="checkpoint and curve")
    parser.add_argument("--minutes", type=float, default=recipe.minutes)
    parser.add_argument("--rate", type=float, default=recipe.rate)
    parser.add_argument("--begin-from", type=Path, help="shipped weights, or a checkpoint")
    return parser


def train(
    run: TrainingRun,
    data: Any,  # noqa: ANN401  as for `TrainingRun.loss`
    options: argparse.Namespace,
    validate: Callable[[], dict[str, float]],
    *,
    figure: tuple[str, int],
    shown: Callable[[float], str],
    every_steps: int = 100,
    check_every_s: float = 300.0,
    memory: float = 0.99,
) -> None:
    """Train until the time is up; validate, extend the curve and save now and then.

    Args:
        run: fresh; resumed here from the checkpoint in `options.out`, if there is one.
        data: what `run.loss` takes.
        options: of `arguments`.
        validate: figures on the held-out data, for the curve.
        figure: column of the curve for what `run.loss` shows, and its digits.
        shown: a phrase for the log, of the running mean of what `run.loss` shows.
        every_steps: steps between two lines of the log.
        check_every_s: training time between two validations [s].
        memory: share of the running mean that a step keeps.
    """
    options.out.mkdir(parents=True, exist_ok=True)
    checkpoint = options.out / "checkpoint.pt"
    if checkpoint.exists():
        run.load(checkpoint)
    elif options.begin_from:
        run.begin_from(options.begin_from)
    recent: Shown = 0.0
    checked = run.trained_s
    while run.progress < 1:
        value = run.advance(data)
        recent = value if run.step == 1 else recent * memory + (1 - memory) * value
        minutes = run.trained_s / 60
        if run.step % every_steps == 0:
            print(f"{minutes:6.1f} min  step {run.step}  {shown(float(recent))}", flush=True)
        if run.trained_s - checked > check_every_s or run.progress >= 1:
            name, digits = figure
            row = {
                "minutes": round(minutes, 2),
                "step": run.step,
                name: round(float(recent), digits),
            }
            append_row(options.out / "curve.csv", {**row, **validate()})
            run.save(checkpoint)
            checked = run.trained_s
