"""Train the CoC network on a reservoir of drawn pictures, on one CPU thread.

    python -m models.coc.train --data /tmp/coc_data --validation /tmp/coc_val --out /tmp/coc_run \
        --minutes 80 [--plates FOLDER]

The schedule follows training time, not steps: learning rate along a cosine, crops of 256 px, then
whole pictures of 384 px for the second half. A run that stopped goes on from its checkpoint.
"""

from __future__ import annotations

import argparse
import copy
import csv
import math
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor

from models.coc.data import LABEL_STEP, Reservoir
from models.coc.evaluate import Estimate, Figures, evaluate_plates, figures
from models.coc.network import CocNet, coc_and_sigma, laplace_loss
from models.coc.scene import SIZE

WARM_UP_STEPS = 300
EMA_DECAY = 0.999
NEWEST = 9000  # batches come from the newest pictures, so that a better generator soon takes over
RENDERED_SHARE = 0.2  # of a batch, when there are rendered pictures
LARGE_CROPS_FROM = 0.5  # share of the time
CHECK_EVERY_S = 600.0


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a run does.

    Attributes:
        minutes: training time, checks not counted [min].
        rate: peak learning rate.
        pixels: pixels of a batch [px].
        crop: edge of the crops in the first part, a multiple of 32 [px].
        beta: exponent of the beta-NLL.
        seed: of the weights and the batches.
    """

    minutes: float = 80.0
    rate: float = 1.2e-3
    pixels: int = 2 * 384 * 384
    crop: int = 256
    beta: float = 0.5
    seed: int = 1

    def rate_at(self, progress: float, step: int) -> float:
        """Learning rate at a share of the time."""
        warm = min(1.0, (step + 1) / WARM_UP_STEPS)
        return self.rate * warm * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(progress, 1))))

    def crop_at(self, progress: float) -> int:
        """Edge of the crops at a share of the time [px]."""
        return self.crop if progress < LARGE_CROPS_FROM else SIZE


class Source:
    """Where a batch comes from: drawn pictures and, once there are some, rendered ones."""

    def __init__(self, drawn: Path, rendered: Path | None) -> None:
        self._drawn = Reservoir(drawn)
        self._path, self._rendered = rendered, None

    def pick(self, rng: np.random.Generator) -> tuple[Reservoir, int]:
        """A reservoir and the index of a picture in it."""
        if self._rendered is None and self._path and (self._path / "state.json").exists():
            self._rendered = Reservoir(self._path)
        data = self._drawn
        if self._rendered and self._rendered.drawn and rng.random() < RENDERED_SHARE:
            data = self._rendered
        drawn = data.drawn
        oldest = max(0, drawn - min(len(data.pictures), NEWEST))
        return data, int(rng.integers(oldest, drawn)) % len(data.pictures)


def draw_batch(
    rng: np.random.Generator, source: Source, crop: int, count: int
) -> tuple[Tensor, Tensor]:
    """Random crops, turned and re-exposed a little: RGB (n, 3, c, c) and CoC (n, c/4, c/4)."""
    side = crop // LABEL_STEP
    pictures = np.empty((count, crop, crop, 3), np.float32)
    labels = np.empty((count, side, side), np.float32)
    for i in range(count):
        data, index = source.pick(rng)
        y, x = rng.integers(0, (SIZE - crop) // LABEL_STEP + 1, 2)
        rows, columns = (slice(at * LABEL_STEP, at * LABEL_STEP + crop) for at in (y, x))
        picture = np.rot90(data.pictures[index, rows, columns], turns := int(rng.integers(4)))
        target = np.rot90(data.labels[index, y : y + side, x : x + side], turns)
        flip = int(rng.integers(2)) * 2 - 1
        pictures[i], labels[i] = picture[:, ::flip], target[:, ::flip]
    rgb = torch.from_numpy(pictures).permute(0, 3, 1, 2) / 255
    gain = torch.from_numpy(np.exp(rng.normal(0, 0.06, (count, 3, 1, 1))).astype(np.float32))
    level = torch.from_numpy(
        np.maximum(0, rng.normal(-0.5, 1, (count, 1, 1, 1))).astype(np.float32)
    )
    seed = torch.Generator().manual_seed(int(rng.integers(2**31)))
    grain = torch.randn(rgb.shape, generator=seed) * (level / 255)
    return (rgb * gain + grain).clamp(0, 1), torch.from_numpy(labels)


class Run:
    """The state of a training run: weights, their moving average, the optimiser, the clock."""

    def __init__(self, recipe: Recipe) -> None:
        torch.manual_seed(recipe.seed)
        self.recipe = recipe
        self.network = CocNet().to(memory_format=torch.channels_last)
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

    def advance(self, source: Source) -> float:
        """One step; returns the negative log-likelihood of its batch."""
        start = time.perf_counter()
        crop = self.recipe.crop_at(self.progress)
        rgb, coc = draw_batch(self.rng, source, crop, max(1, self.recipe.pixels // crop**2))
        for group in self.optimiser.param_groups:
            group["lr"] = self.recipe.rate_at(self.progress, self.step)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            answer = self.network(rgb.contiguous(memory_format=torch.channels_last))
        loss, likelihood = laplace_loss(answer, coc, self.recipe.beta)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimiser.step()
        decay = min(EMA_DECAY, (self.step + 1) / (self.step + 10))
        with torch.no_grad():
            for slow, fast in zip(
                self.average.parameters(), self.network.parameters(), strict=True
            ):
                slow.lerp_(fast, 1 - decay)
        self.step += 1
        self.trained_s += time.perf_counter() - start
        return float(likelihood.detach())

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
        """Take shipped weights, or a checkpoint's averaged ones, as the beginning of a new run.

        Residual blocks that those weights lack begin as the identity.
        """
        state = torch.load(path, weights_only=True)
        weights = {name: value.float() for name, value in state.get("average", state).items()}
        state = self.network.state_dict()
        for name, value in state.items():
            if name not in weights:
                weights[name] = value * (".second." not in name)
        self.network.load_state_dict(weights)
        self.average.load_state_dict(weights)


def torch_estimate(network: CocNet) -> Estimate:
    """An estimator on pictures whose sides are multiples of 32."""

    def estimate(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with torch.inference_mode():
            answer = network(torch.from_numpy(rgb).permute(2, 0, 1)[None])
            maps = [part[0].numpy() for part in coc_and_sigma(answer)]
        size = (rgb.shape[1], rgb.shape[0])
        coc, sigma = (cv2.resize(part, size, interpolation=cv2.INTER_LINEAR) for part in maps)
        return coc, sigma

    return estimate


def validate(network: CocNet, data: Reservoir) -> tuple[float, Figures]:
    """Negative log-likelihood and figures on the held-out pictures, whole, as they are."""
    count = min(data.drawn, len(data.pictures))
    losses, maps = [], []
    for first in range(0, count, 16):
        part = slice(first, min(first + 16, count))
        rgb = torch.from_numpy(np.float32(data.pictures[part]) / 255).permute(0, 3, 1, 2)
        truth = torch.from_numpy(np.float32(data.labels[part]))
        with torch.inference_mode():
            answer = network(rgb)
            losses.append(float(laplace_loss(answer, truth)[1]) * len(rgb))
            maps.append(torch.stack([*coc_and_sigma(answer), truth]).numpy())
    coc, sigma, truth_px = np.concatenate(maps, 1)
    return sum(losses) / count, figures("held-out", coc, sigma, truth_px)


def check(run: Run, loss: float, options: argparse.Namespace) -> None:
    """Validate, evaluate, log a line in the curve, save."""
    likelihood, held_out = validate(run.average, Reservoir(options.validation))
    print(held_out.line(), f" nll {likelihood:.3f}")
    row = {
        "minutes": round(run.trained_s / 60, 2),
        "step": run.step,
        "train_nll": round(loss, 4),
        "held_out_nll": round(likelihood, 4),
        "held_out_rmse_px": round(held_out.rmse_px, 3),
        "held_out_confident_rmse_px": round(held_out.confident_rmse_px, 3),
        "held_out_relative": round(held_out.relative, 4),
    }
    if options.plates:
        results = evaluate_plates(torch_estimate(run.average), options.plates)
        print("\n".join(result.line() for result in results), flush=True)
        row["plates_rmse_px"] = round(results[-1].rmse_px, 3)
        row["plates_confident_rmse_px"] = round(results[-1].confident_rmse_px, 3)
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
    parser.add_argument("--rendered", type=Path, help="reservoir of rendered pictures, if any")
    parser.add_argument("--validation", type=Path, required=True, help="held-out reservoir")
    parser.add_argument("--out", type=Path, required=True, help="checkpoint and curve")
    parser.add_argument("--plates", type=Path, help="rendered plates, for the log only")
    parser.add_argument("--minutes", type=float, default=Recipe().minutes)
    parser.add_argument("--rate", type=float, default=Recipe().rate)
    parser.add_argument("--crop", type=int, default=Recipe().crop, help="of the first half [px]")
    parser.add_argument("--begin-from", type=Path, help="weights.pt or a checkpoint")
    options = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    options.out.mkdir(parents=True, exist_ok=True)
    run = Run(Recipe(minutes=options.minutes, rate=options.rate, crop=options.crop))
    if (options.out / "checkpoint.pt").exists():
        run.load(options.out / "checkpoint.pt")
    elif options.begin_from:
        run.begin_from(options.begin_from)
    source = Source(options.data, options.rendered)
    recent, checked = 0.0, run.trained_s
    while run.progress < 1:
        recent = recent * 0.99 + 0.01 * run.advance(source) if run.step else run.advance(source)
        if run.step % 100 == 0:
            minutes = run.trained_s / 60
            print(f"{minutes:6.1f} min  step {run.step}  nll {recent:.3f}", flush=True)
        if run.trained_s - checked > CHECK_EVERY_S or run.progress >= 1:
            check(run, recent, options)
            checked = run.trained_s


if __name__ == "__main__":
    main()
