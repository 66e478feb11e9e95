"""Train the CoC network on a reservoir of drawn pictures, on one CPU thread or a GPU.

    python -m models.coc.train --data /tmp/coc_data --validation /tmp/coc_val --out /tmp/coc_run \
        --minutes 80 [--device cuda --pictures 24] [--plates FOLDER]

The schedule follows training time, not steps: learning rate along a cosine, crops of 256 px, then
whole pictures for the second half. An interrupted run resumes from its checkpoint.
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

RENDERED_SHARE = 0.12  # of a batch, when there are rendered pictures
LARGE_CROPS_FROM = 0.5  # share of the time
CPU = torch.device("cpu")


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
    pixels: int = 2 * SIZE * SIZE
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
        return data, int(rng.integers(min(data.drawn, len(data.pictures))))


def draw_batch(
    rng: np.random.Generator, source: Source, crop: int, count: int, device: torch.device = CPU
) -> tuple[Tensor, Tensor]:
    """Random crops, turned and re-exposed a little: RGB (n, 3, c, c) and CoC (n, c/4, c/4)."""
    side = crop // LABEL_STEP
    pictures = np.empty((count, crop, crop, 3), np.uint8)
    labels = np.empty((count, side, side), np.float16)
    for i in range(count):
        data, index = source.pick(rng)
        y, x = rng.integers(0, (SIZE - crop) // LABEL_STEP + 1, 2)
        rows, columns = (slice(at * LABEL_STEP, at * LABEL_STEP + crop) for at in (y, x))
        pictures[i] = data.pictures[index, rows, columns]
        labels[i] = data.labels[index, y : y + side, x : x + side]
    rgb, coc = (_moved(torch.from_numpy(part), device) for part in (pictures, labels))
    rgb = rgb.permute(0, 3, 1, 2).float() / 255
    turns, flips = rng.integers(4, size=count), rng.integers(2, size=count)
    for i, (turn, flip) in enumerate(zip(turns, flips, strict=True)):
        for part in (rgb, coc):
            turned = torch.rot90(part[i], int(turn), (-2, -1))
            part[i] = turned.flip(-1) if flip else turned.clone()
    gain = np.exp(rng.normal(0, 0.06, (count, 3, 1, 1)))
    level = np.maximum(0, rng.normal(-0.5, 1, (count, 1, 1, 1))) / 255
    gain, level = (_moved(torch.from_numpy(np.float32(part)), device) for part in (gain, level))
    seed = torch.Generator(device).manual_seed(int(rng.integers(2**31)))
    grain = level * torch.randn(rgb.shape, generator=seed, device=device)
    return (rgb * gain + grain).clamp(0, 1), coc.float()


def _moved(part: Tensor, device: torch.device) -> Tensor:
    """A tensor on the device; a GPU goes on working meanwhile."""
    return part if device.type == "cpu" else part.pin_memory().to(device, non_blocking=True)


class Run(TrainingRun):
    """Training of the CoC network."""

    EMA_DECAY = 0.999

    def build(self) -> CocNet:
        """The CoC network."""
        return CocNet()

    def loss(self, data: Source) -> tuple[Tensor, Tensor]:
        """Beta-NLL of a batch, and its negative log-likelihood."""
        crop = self.recipe.crop_at(self.progress)
        count = max(1, self.recipe.pixels // crop**2)
        rgb, coc = draw_batch(self.rng, data, crop, count, self.device)
        with torch.autocast(self.device.type, dtype=torch.bfloat16):
            answer = self.network(rgb.contiguous(memory_format=torch.channels_last))
        loss, likelihood = laplace_loss(answer, coc, self.recipe.beta)
        return loss, likelihood.detach()

    def completed(self, weights: dict[str, Tensor]) -> dict[str, Tensor]:
        """The weights, with residual blocks that they lack begun as the identity."""
        fresh = self.network.state_dict().items()
        return {name: weights.get(name, value * (".second." not in name)) for name, value in fresh}


def _where(network: CocNet) -> torch.device:
    return next(network.parameters()).device


def torch_estimate(network: CocNet) -> Estimate:
    """An estimator on pictures whose sides are multiples of 32."""

    def estimate(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with torch.inference_mode():
            answer = network(_moved(torch.from_numpy(rgb), _where(network)).permute(2, 0, 1)[None])
            maps = [part[0].cpu().numpy() for part in coc_and_sigma(answer)]
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
        rgb, truth = (
            _moved(torch.from_numpy(np.float32(values)), _where(network))
            for values in (data.pictures[part], data.labels[part])
        )
        rgb = rgb.permute(0, 3, 1, 2) / 255
        with torch.inference_mode():
            answer = network(rgb)
            losses.append(float(laplace_loss(answer, truth)[1]) * len(rgb))
            maps.append(torch.stack([*coc_and_sigma(answer), truth]).cpu().numpy())
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
    parser.add_argument("--device", default="cpu", choices=("cpu", "cuda"))
    parser.add_argument("--check-every", type=float, default=10.0, help="until a validation [min]")
    parser.add_argument("--pictures", type=int, default=2, help="whole ones of a batch")
    options = parser.parse_args()
    torch.set_num_threads(1)
    torch.backends.cudnn.benchmark = True
    cv2.setNumThreads(1)
    recipe = Recipe(
        minutes=options.minutes,
        rate=options.rate,
        crop=options.crop,
        pixels=options.pictures * SIZE**2,
    )
    run = Run(recipe, options.device)
    train(
        run, Source(options.data, options.rendered), options, lambda: held_out(run, options),
        figure=("train_nll", 4), shown=lambda nll: f"nll {nll:.3f}",
        check_every_s=60 * options.check_every,
    )  # fmt: skip


if __name__ == "__main__":
    main()
