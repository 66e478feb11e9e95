"""A training of the CoC network: its schedule and the loss of a batch."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from models.coc.batches import Batches
from models.coc.network import CocNet, laplace_loss
from models.coc.scene import SIZE
from models.training import Schedule, TrainingRun

LARGE_CROPS_FROM = 0.5  # share of the time


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


class Run(TrainingRun):
    """Training of the CoC network."""

    EMA_DECAY = 0.999

    def build(self) -> CocNet:
        """The CoC network."""
        return CocNet()

    def loss(self, data: Batches) -> tuple[Tensor, Tensor]:
        """Beta-NLL of a batch, and its negative log-likelihood."""
        crop = self.recipe.crop_at(self.progress)
        rgb, coc = data.draw(self.rng, crop, max(1, self.recipe.pixels // crop**2))
        with torch.autocast(self.device.type, dtype=torch.bfloat16):
            answer = self.network(rgb.contiguous(memory_format=torch.channels_last))
        loss, likelihood = laplace_loss(answer, coc, self.recipe.beta)
        return loss, likelihood.detach()

    def completed(self, weights: dict[str, Tensor]) -> dict[str, Tensor]:
        """The weights, with residual blocks that they lack begun as the identity."""
        fresh = self.network.state_dict().items()
        return {name: weights.get(name, value * (".second." not in name)) for name, value in fresh}
