"""The repair network: sees geometry, judges candidates; never sees colour.

What hides what is a matter of geometry, so the answer is the same whatever the exposure and the
texture, and what it weighs stays linear in light. The maps are smooth at the scale of a disc, and
blurring is done before it: it works on cells of 4 x 4 pixels and need not look far.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from models.blocks import Residual
from nlens_video.stages.l_depth_order import CELL, CHANNELS

WIDTH = 40
BLOCKS = 2  # of two convolutions; with stem and answer they look 6 cells = HALO_PX around
ANSWERS = 2
BEGINNING = 2.0  # logit of the ordered layers' share before any training


class RepairNet(nn.Module):
    """Geometry (N, CHANNELS, H, W), H and W multiples of CELL, to judgement (N, ANSWERS, H, W).

    Channel 0: share of the ordered layers, in [0, 1]. Channel 1: relative change of the near
    layer's coverage, in [-0.5, 0.5]. See `nlens_video.stages.l_depth_order.Candidates`.
    """

    def __init__(self, width: int = WIDTH, blocks: int = BLOCKS) -> None:
        super().__init__()
        self.stem = nn.Conv2d(CHANNELS * CELL**2, width, 3, padding=1)
        self.blocks = nn.Sequential(*(Residual(width) for _ in range(blocks)))
        self.answer = nn.Conv2d(width, ANSWERS * CELL**2, 3, padding=1)
        nn.init.normal_(self.answer.weight, std=0.003)
        with torch.no_grad():
            self.answer.bias.zero_()
            self.answer.bias[: CELL**2] = BEGINNING

    def forward(self, geometry: Tensor) -> Tensor:
        """Judge a picture's maps."""
        features = self.blocks(self.stem(F.pixel_unshuffle(geometry, CELL)))
        answer = F.pixel_shuffle(self.answer(F.relu(features)), CELL)
        return torch.cat([torch.sigmoid(answer[:, :1]), 0.5 * torch.tanh(answer[:, 1:])], 1)


def resolve(parts: dict[str, Tensor], judgement: Tensor) -> Tensor:
    """`Candidates.resolve` on batches (N, 4, H, W), without its limits, which have no gradient."""
    share = judgement[:, :1] * parts["where"]
    swapped = parts["near"] - parts["near"][:, 3:] * parts["back"]
    ordered = parts["back"] + (1.0 + judgement[:, 1:]) * swapped - parts["covariance"]
    return parts["scattered"] + share * (ordered - parts["scattered"])


def coded(rgba: Tensor, plate: Tensor) -> Tensor:
    """A layer over a plate (N, 3, 1, 1), scene-linear, as code values; flat above white."""
    light = rgba[:, :3] + (1.0 - rgba[:, 3:]) * plate
    light = torch.where(light > 1.0, 1.0 + 0.1 * (light - 1.0), light)
    return light.clamp_min(1e-4) ** (1.0 / 2.2)


def error(found: Tensor, truth: Tensor, plate: Tensor, edge: int = 0) -> Tensor:
    """Mean square error of code values for each of a batch (N,), without `edge` px of the rim."""
    square = (coded(found, plate) - coded(truth, plate)) ** 2
    if edge:
        square = square[..., edge:-edge, edge:-edge]
    return square.mean((1, 2, 3))
