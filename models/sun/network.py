"""The sun network: the map of a plate's ground to where the sun stands."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from nlens_video.scene.plate_sun import ANSWERS, AZIMUTHS, CHANNELS

WIDTHS = (32, 64, 96)
VOTES, HIDDEN = 96, 128
HARMONICS, GAIN = 8, 10.0
PLACE = 3
"""Channels that say which place of the ground a pixel is, of those that the network sees."""
LABELS = 2
"""Shadow on the ground, and things: what the training asks for beside the sun."""


class Block(nn.Module):
    """Two convolutions beside the identity."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.second = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.norms = nn.ModuleList([nn.BatchNorm2d(width), nn.BatchNorm2d(width)])

    def forward(self, features: Tensor) -> Tensor:
        """Features (N, width, h, w) in and out."""
        first, second = self.norms
        return F.relu(features + second(self.second(F.relu(first(self.first(features))))))


class SunNet(nn.Module):
    """Convolutions on the map of the ground, to a coarse grid whose cells vote; 0.6 M parameters.

    A cell tells the azimuth of the sun from its own direction of view, as a Fourier series of the
    logarithm of its likelihood. Series are turned to the frame's direction of view and added.
    """

    order: Tensor
    waves: Tensor

    def __init__(self) -> None:
        super().__init__()
        narrow, middle, wide = WIDTHS
        self.stem = _reduction(CHANNELS, narrow, 6, 4)
        self.fine = Block(narrow)
        self.second = _reduction(narrow + PLACE, middle, 3, 2)
        self.medium = nn.Sequential(Block(middle), Block(middle))
        self.label = nn.Conv2d(middle, 4 * LABELS, 1)
        self.third = _reduction(middle + PLACE, wide, 3, 2)
        self.coarse = nn.Sequential(Block(wide), Block(wide))
        self.vote = nn.Conv2d(wide + PLACE, VOTES, 1)
        self.series = nn.Conv2d(VOTES, 2 * HARMONICS, 1)
        self.hidden = nn.Linear(2 * VOTES, HIDDEN)
        self.answer = nn.Linear(HIDDEN, ANSWERS - AZIMUTHS)
        self.dropout = nn.Dropout(0.1)
        for last in (self.answer, self.series):
            nn.init.normal_(last.weight, std=0.01)
            nn.init.zeros_(last.bias)
        order = torch.arange(1, HARMONICS + 1)
        self.register_buffer("order", order.float()[None, :, None, None])
        at = 2.0 * torch.pi * torch.arange(AZIMUTHS) / AZIMUTHS
        waves = torch.cat([torch.cos(order[:, None] * at), torch.sin(order[:, None] * at)])
        self.register_buffer("waves", waves)

    def forward(self, features: Tensor) -> Tensor:
        """Features (N, MAP_ROWS, MAP_COLUMNS, CHANNELS) to answers (N, ANSWERS)."""
        return self.with_labels(features)[0]

    def with_labels(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Answers, and logits of the labels (N, LABELS, MAP_ROWS / 4, MAP_COLUMNS / 4)."""
        grid = features.permute(0, 3, 1, 2)
        place = F.avg_pool2d(grid[:, 3:], 4)
        grid = self.fine(self.stem(torch.cat([grid[:, :3] - 0.5, grid[:, 3:]], 1)))
        grid = self.medium(self.second(torch.cat([grid, place], 1)))
        labels = F.pixel_shuffle(self.label(grid), 2)
        place = F.avg_pool2d(place, 2)
        grid = self.coarse(self.third(torch.cat([grid, place], 1)))
        place = F.avg_pool2d(place, 2)
        votes = F.relu(self.vote(torch.cat([grid, place], 1)))
        real, imaginary = self.series(votes).float().chunk(2, 1)
        turn = self.order * place[:, -1:].float()
        cosine, sine = torch.cos(turn), torch.sin(turn)
        turned = torch.cat([real * cosine - imaginary * sine, real * sine + imaginary * cosine], 1)
        azimuths = (GAIN * (turned * place[:, :1]).mean((2, 3))) @ self.waves
        pooled = torch.cat([votes.mean((2, 3)), votes.amax((2, 3))], 1)
        rest = self.answer(self.dropout(F.relu(self.hidden(self.dropout(pooled)))))
        return torch.cat([azimuths, rest.float()], 1), labels


def _reduction(before: int, width: int, size: int, stride: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, width, size, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(width), nn.ReLU(),
    )  # fmt: skip
