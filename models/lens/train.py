"""Train the lens network on a folder of examples of `data.py`, on the CPU.

    python -m models.lens.train --data /tmp/lens --validation /tmp/lens_held --out /tmp/lens_run

Every picture is seen with the object at ever other places of its ground, mirrored, and with ever
other patches left out. `--rendered` names examples of `rendered.py`, a share of each batch.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from models.coc.scene import MAX_COC_PX, SIZE
from models.lens.data import Examples
from models.lens.network import LensNet, negative_log_likelihood
from models.training import Schedule, TrainingRun, arguments, train
from nlens_video.stages.whole_ground.patches import FARTHEST_SHARE, patch_middles, places

SLIGHTEST_SLOPE = 0.05  # [px]
LEAVING_OUT_SHARE, UPPER_LEFT_OUT_SHARE = 0.5, 0.15
PATCHES_WEIGHT = 0.3
RENDERED_SHARE = 0.3
CHECKED = 64  # examples of a batch of those that are held out
OBJECT_PX = (60.0, 452.0), (100.0, 500.0)  # columns and rows between which the object stands


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(Schedule):
    """Schedule and batches of a run.

    Attributes:
        batch: pictures of a batch.
    """

    minutes: float = 60.0
    rate: float = 1.5e-3
    warm_up_steps: int = 200
    batch: int = 32


@dataclass(frozen=True, slots=True)
class Batch:
    """Readings, places, which patches are used, lenses (N, 2), log(1 + CoC) of patches (N, P)."""

    readings: Tensor
    places: Tensor
    used: Tensor
    lens: Tensor
    log_coc: Tensor


def _posed(
    plane: np.ndarray, rng: np.random.Generator, *, varied: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places, used patches, lens and log(1 + CoC) of a plane with an object somewhere on it."""
    across, down, slope, offset, end = plane
    x, y = (middles - 0.5 * SIZE for middles in patch_middles(SIZE, SIZE))
    disparity = 1.0 + across * x[None, :] + down * y[:, None]
    at = 0.0
    while at <= 1.02 * end:
        column, row = (rng.uniform(low, high) - 0.5 * SIZE for low, high in OBJECT_PX)
        at = 1.0 + across * column + down * row
    slant = float(np.hypot(across, down)) / at
    used = disparity > FARTHEST_SHARE * at
    where = places(disparity / at, slant, x, y)
    if varied:
        if rng.random() < LEAVING_OUT_SHARE:
            used &= rng.random(used.shape) > rng.uniform(0.0, 0.5)
        if rng.random() < UPPER_LEFT_OUT_SHARE:
            used &= (y > rng.uniform(-0.5, 0.0) * SIZE)[:, None]
        if rng.random() < 0.5:
            where[..., -2] *= -1.0
    coc = np.abs(offset + slope * (disparity - 1.0))
    at_object = offset + slope * (at - 1.0)
    lens = np.array([np.arcsinh(0.5 * at_object), np.log(max(slope * at, SLIGHTEST_SLOPE))])
    return where, used, lens, np.log1p(np.minimum(coc, MAX_COC_PX))


def drawn(
    examples: Examples, picked: np.ndarray, rng: np.random.Generator, *, varied: bool = True
) -> Batch:
    """A batch of the examples of some numbers, as they are or varied."""
    posed = [_posed(examples.planes[index], rng, varied=varied) for index in picked]
    readings = examples.readings[picked].astype(np.float32)
    where, used, lens, log_coc = (np.stack(part) for part in zip(*posed, strict=True))
    count = len(picked)
    return Batch(
        torch.from_numpy(readings.reshape(count, -1, readings.shape[-1])),
        torch.from_numpy(where.reshape(count, -1, where.shape[-1])),
        torch.from_numpy(used.reshape(count, -1)),
        torch.from_numpy(lens.astype(np.float32)),
        torch.from_numpy(log_coc.astype(np.float32).reshape(count, -1)),
    )


def losses(network: LensNet, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Negative log-likelihood of each lens (N,), the mean of patches, and the answers."""
    lenses, of_patch = network.with_patches(batch.readings, batch.places, batch.used)
    log_coc, log_scale = of_patch.unbind(-1)
    at_patch = (log_coc - batch.log_coc).abs() * torch.exp(-log_scale) + log_scale
    return negative_log_likelihood(lenses, batch.lens), at_patch[batch.used].mean(), lenses


class Run(TrainingRun):
    """Training of the lens network."""

    EMA_DECAY = 0.998

    def build(self) -> LensNet:
        """The lens network."""
        return LensNet()

    def loss(self, data: Examples) -> tuple[Tensor, float]:
        """Loss of a batch, and the mean negative log-likelihood of its lenses."""
        count = len(data.planes)
        picked = self.rng.integers(count - data.rendered, size=self.recipe.batch)
        if data.rendered:
            rendered = self.rng.integers(count - data.rendered, count, self.recipe.batch)
            picked = np.where(self.rng.random(len(picked)) < RENDERED_SHARE, rendered, picked)
        at_lens, at_patch, _ = losses(self.network, drawn(data, picked, self.rng))
        return at_lens.mean() + PATCHES_WEIGHT * at_patch, float(at_lens.mean().detach())


def normalise(network: LensNet, examples: Examples) -> None:
    """Take mean and deviation of the readings from examples."""
    readings = torch.from_numpy(examples.readings[::7].astype(np.float32)).flatten(0, 2)
    network.mean.copy_(readings.mean(0))
    network.deviation.copy_(readings.std(0) + 1e-3)


def validate(network: LensNet, examples: Examples) -> dict[str, float]:
    """Figures on examples that are held out."""
    rng = np.random.default_rng(0)
    likelihoods, errors = [], []
    with torch.inference_mode():
        for first in range(0, len(examples.planes), CHECKED):
            picked = np.arange(first, min(first + CHECKED, len(examples.planes)))
            batch = drawn(examples, picked, rng, varied=False)
            at_lens, _, lenses = losses(network, batch)
            likeliest = lenses[torch.arange(len(lenses)), lenses[..., 0].argmax(1)]
            likelihoods.append(at_lens)
            errors.append(2 * (torch.sinh(likeliest[:, 1]) - torch.sinh(batch.lens[:, 0])).abs())
    error = torch.cat(errors)
    return {
        "held_out_nll": round(float(torch.cat(likelihoods).mean()), 4),
        "held_out_mean_px": round(float(error.mean()), 3),
        "held_out_median_px": round(float(error.median()), 3),
        "held_out_within_1_px": round(float((error <= 1.0).float().mean()), 3),
    }


def main() -> None:
    """Train until the time is up."""
    parser = arguments(__doc__, Recipe())
    parser.add_argument("--rendered", type=Path, help="what rendered.py wrote")
    options = parser.parse_args()
    torch.set_num_threads(1)
    examples, held_out = Examples.load(options.data), Examples.load(options.validation)
    if options.rendered:
        examples = examples.with_rendered(Examples.load(options.rendered))
    run = Run(Recipe(minutes=options.minutes, rate=options.rate))
    if not options.begin_from:
        for network in (run.network, run.average):
            normalise(network, examples)
    train(
        run, examples, options, lambda: validate(run.average, held_out),
        figure=("train_nll", 4), shown=lambda value: f"nll {value:.3f}",
        check_every_s=120.0,
    )  # fmt: skip


if __name__ == "__main__":
    main()
