"""Train the CoC network on a reservoir of drawn pictures, on one CPU thread.

    python -m models.coc.train --data /tmp/coc_data --validation /tmp/coc_val --out /tmp/coc_run \
        --minutes 80 [--plates FOLDER]

The schedule follows training time, not steps: learning rate along a cosine, crops of 256 px, then
whole pictures of 384 px for the second half. An interrupted run resumes from its checkpoint.
"""

from __future__ import annotations

import argparse
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
from models.training import Schedule, TrainingRun, arguments, train

NEWEST = 9000  # batches come from the newest pictures, so that a better generator soon takes over
RENDERED_SHARE = 0.2  # of a batch, when there are rendered pictures
LARGE_CROPS_FROM = 0.5  # share of the time
CHECK_EVERY_S = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(Schedule):
    """Schedule and batches of a run.

    Attributes:
        pixels: pixels of a batch [px].
        crop: edge of the crops in the first part, a multiple of 32 [px].
        beta: exponent of the beta-NLL.
    """

    minutes: float = 80.0
    rate: float = 1.2e-3
    warm_up_steps: int = 300
    pixels: int = 2 * 384 * 384
    crop: int = 256
    beta: float = 0.5

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


class Run(TrainingRun):
    """Training of the CoC network."""

    EMA_DECAY = 0.999

    def build(self) -> CocNet:
        """The CoC network."""
        return CocNet()

    def loss(self, data: Source) -> tuple[Tensor, float]:
        """Beta-NLL of a batch, and its negative log-likelihood."""
        crop = self.recipe.crop_at(self.progress)
        rgb, coc = draw_batch(self.rng, data, crop, max(1, self.recipe.pixels // crop**2))
        with torch.autocast("cpu", dtype=torch.bfloat16):
            answer = self.network(rgb.contiguous(memory_format=torch.channels_last))
        loss, likelihood = laplace_loss(answer, coc, self.recipe.beta)
        return loss, float(likelihood.detach())

    def completed(self, weights: dict[str, Tensor]) -> dict[str, Tensor]:
        """The weights, with residual blocks that they lack begun as the identity."""
        fresh = self.network.state_dict().items()
        return {name: weights.get(name, value * (".second." not in name)) for name, value in fresh}


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


def held_out(run: Run, options: argparse.Namespace) -> dict[str, float]:
    """Figures on the held-out pictures, and on plates where there are any."""
    row: dict[str, float] = {}
    for name, folder in (("held_out", options.validation), ("hard", options.hard_validation)):
        if folder is None:
            continue
        likelihood, found = validate(run.average, Reservoir(folder))
        print(found.line(), f" {name}, nll {likelihood:.3f}", flush=True)
        row[f"{name}_nll"] = round(likelihood, 4)
        row[f"{name}_rmse_px"] = round(found.rmse_px, 3)
        row[f"{name}_confident_rmse_px"] = round(found.confident_rmse_px, 3)
        row[f"{name}_relative"] = round(found.relative, 4)
    if options.plates:
        results = evaluate_plates(torch_estimate(run.average), options.plates)
        print("\n".join(result.line() for result in results), flush=True)
        row["plates_rmse_px"] = round(results[-1].rmse_px, 3)
        row["plates_confident_rmse_px"] = round(results[-1].confident_rmse_px, 3)
    return row


def main() -> None:
    """Train until the time is up."""
    parser = arguments(__doc__, Recipe())
    parser.add_argument("--rendered", type=Path, help="reservoir of rendered pictures, if any")
    parser.add_argument("--hard-validation", type=Path, help="another one, of long grounds")
    parser.add_argument("--plates", type=Path, help="rendered plates, for the log only")
    parser.add_argument("--crop", type=int, default=Recipe().crop, help="of the first half [px]")
    options = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    run = Run(Recipe(minutes=options.minutes, rate=options.rate, crop=options.crop))
    train(
        run, Source(options.data, options.rendered), options, lambda: held_out(run, options),
        figure=("train_nll", 4), shown=lambda nll: f"nll {nll:.3f}", check_every_s=CHECK_EVERY_S,
    )  # fmt: skip


if __name__ == "__main__":
    main()
