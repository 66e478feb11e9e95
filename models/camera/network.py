"""The camera network: a picture's features to a distribution of pitch, roll and focal length."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from nlens_video.solve.still.picture_cue import (
    ANSWERS,
    CHANNELS,
    COLUMNS,
    FREEDOM,
    LOGARITHMS,
    MIDDLES,
    ROWS,
    SPREADS,
)  # fmt: skip

WIDTH, NARROW, HIDDEN = 128, 32, 128


class CameraNet(nn.Module):
    """Three convolutions on the grid, then two layers that see all of it; 0.4 M parameters.

    Attributes:
        mean: of the features of the training, by channel (CHANNELS,).
        deviation: likewise.
    """

    mean: Tensor
    deviation: Tensor
    place: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Conv2d(CHANNELS + 3, 96, 3, stride=2, padding=1)
        self.second = nn.Conv2d(96, WIDTH, 3, padding=1)
        self.third = nn.Conv2d(WIDTH, WIDTH, 3, padding=1)
        self.norms = nn.ModuleList(nn.BatchNorm2d(width) for width in (96, WIDTH, WIDTH))
        self.narrow = nn.Conv2d(WIDTH, NARROW, 1)
        self.hidden = nn.Linear(NARROW * (ROWS // 2) * (COLUMNS // 2), HIDDEN)
        self.answer = nn.Linear(HIDDEN, ANSWERS)
        self.dropout = nn.Dropout(0.2)
        nn.init.normal_(self.answer.weight, std=0.01)
        nn.init.zeros_(self.answer.bias)
        y, x = torch.meshgrid(
            torch.linspace(-1, 1, ROWS), torch.linspace(-1, 1, COLUMNS), indexing="ij"
        )
        self.register_buffer("place", torch.stack([x, y])[None])
        self.register_buffer("mean", torch.zeros(CHANNELS))
        self.register_buffer("deviation", torch.ones(CHANNELS))

    def forward(self, features: Tensor, aspect: Tensor) -> Tensor:
        """Features (N, ROWS, COLUMNS, CHANNELS), logarithm of the aspect (N, 1); (N, ANSWERS)."""
        grid = ((features - self.mean) / self.deviation).permute(0, 3, 1, 2)
        shape = (grid.shape[0], -1, ROWS, COLUMNS)
        wide = (aspect[:, :, None, None] - 0.5).expand(shape)
        grid = torch.cat([grid, self.place.expand(shape), wide], 1)
        first, second, third = self.norms
        grid = F.relu(first(self.first(grid)))
        grid = F.relu(second(self.second(self.dropout(grid))))
        grid = F.relu(grid + third(self.third(self.dropout(grid))))
        flat = self.dropout(F.relu(self.narrow(grid)).flatten(1))
        answer: Tensor = self.answer(self.dropout(F.relu(self.hidden(flat))))
        return answer


def scaled(cameras: Tensor) -> Tensor:
    """Cameras (N, 3) in what the network answers in."""
    middles, spreads = (torch.from_numpy(values).float() for values in (MIDDLES, SPREADS))
    return (cameras - middles) / spreads


def root(answer: Tensor) -> Tensor:
    """Lower triangular root of the information (N, 3, 3) of answers (N, ANSWERS)."""
    diagonal = torch.exp(answer[:, 3:6].clamp(*LOGARITHMS))
    lower = torch.diag_embed(diagonal)
    for column, (i, j) in enumerate(((1, 0), (2, 0), (2, 1)), start=6):
        lower[:, i, j] = answer[:, column]
    return lower


def surprise(answer: Tensor, truth: Tensor) -> Tensor:
    """Negative logarithm of the likelihood (N,) of scaled cameras (N, 3), up to a constant."""
    lower = root(answer)
    off = (lower @ (truth - answer[:, :3])[:, :, None])[:, :, 0]
    heavy = 0.5 * (FREEDOM + 3.0) * torch.log1p((off**2).sum(1) / FREEDOM)
    return heavy - torch.log(torch.diagonal(lower, dim1=1, dim2=2)).sum(1)
