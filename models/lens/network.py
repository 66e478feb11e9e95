"""The lens network: reads the lens model off all patches of the ground together.

A patch alone does not tell a blurred surface from a soft one, nor grain from detail. All patches
together tell more: the lens blurs them by their disparity, which the camera tells. So the patches,
with what F reads in each and where it lies, attend to each other, and two query tokens gather the
answer.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from nlens_video.stages.whole_ground.network_reading import CANDIDATES, NUMBERS
from nlens_video.stages.whole_ground.patches import PLACE, READINGS

WIDTH, LAYERS, HEADS, ANSWERING = 96, 4, 4, 2
HIDDEN = 128  # of the layer before the answer
LARGEST_READING = 6.0  # in standard deviations
MIN_LOG_DEVIATION, MAX_LOG_DEVIATION = -4.5, 2.0
MOST_CORRELATED = 0.98


class Block(nn.Module):
    """Self-attention and two dense layers, each added to what comes in (N, T, width)."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = nn.LayerNorm(width)
        self.mixed = nn.Linear(width, 3 * width)
        self.back = nn.Linear(width, width)
        self.dense = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )

    def forward(self, tokens: Tensor, used: Tensor | None) -> Tensor:
        """Tokens (N, T, width); those not `used` (N, T) are not attended to, None: all are."""
        count, length, width = tokens.shape
        parts = self.mixed(self.norm(tokens)).reshape(count, length, 3, self.heads, -1)
        query, key, value = parts.permute(2, 0, 3, 1, 4).unbind()
        mask = None if used is None else used[:, None, None, :]
        seen = F.scaled_dot_product_attention(query, key, value, attn_mask=mask)
        tokens = tokens + self.back(seen.transpose(1, 2).reshape(count, length, width))
        return tokens + self.dense(tokens)


class LensNet(nn.Module):
    """Patches of a ground to a mixture of lenses.

    A lens is two numbers, in units in which the disparity is 1 where the object stands: a, where
    the CoC of the object's ground is 2 sinh(a) px, and b, the logarithm of the slope [px].
    """

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(READINGS))
        self.register_buffer("deviation", torch.ones(READINGS))
        self.entry = nn.Sequential(
            nn.Linear(READINGS + PLACE, 2 * WIDTH), nn.GELU(), nn.Linear(2 * WIDTH, WIDTH)
        )
        self.answering = nn.Parameter(0.1 * torch.randn(ANSWERING, WIDTH))
        self.blocks = nn.ModuleList([Block(WIDTH, HEADS) for _ in range(LAYERS)])
        self.norm = nn.LayerNorm(WIDTH)
        self.of_patch = nn.Linear(WIDTH, 2)
        self.answer = nn.Sequential(
            nn.Linear(ANSWERING * WIDTH, HIDDEN), nn.GELU(), nn.Linear(HIDDEN, CANDIDATES * NUMBERS)
        )
        last = self.answer[2]
        with torch.no_grad():
            last.weight.mul_(0.3)
            bias = torch.zeros(CANDIDATES, NUMBERS)
            bias[:, 1], bias[:, 2] = torch.linspace(-2, 2, CANDIDATES), 2.3
            last.bias.copy_(bias.flatten())

    def forward(self, readings: Tensor, places: Tensor, used: Tensor | None = None) -> Tensor:
        """Lenses (N, CANDIDATES, NUMBERS) of readings (N, P, READINGS) and places (N, P, PLACE)."""
        return self.with_patches(readings, places, used)[0]

    def with_patches(
        self, readings: Tensor, places: Tensor, used: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Lenses, and log(1 + CoC) of the ground and its log-scale in each patch (N, P, 2)."""
        seen = ((readings - self.mean) / self.deviation).clamp(-LARGEST_READING, LARGEST_READING)
        patches = self.entry(torch.cat([seen, places], 2))
        tokens = torch.cat([self.answering.expand(readings.shape[0], -1, -1), patches], 1)
        if used is not None:
            used = F.pad(used, (ANSWERING, 0), value=True)
        for block in self.blocks:
            tokens = block(tokens, used)
        tokens = self.norm(tokens)
        lenses = self.answer(tokens[:, :ANSWERING].flatten(1)).view(-1, CANDIDATES, NUMBERS)
        # by what F reads there
        of_patch = self.of_patch(tokens[:, ANSWERING:]) + readings[..., [0, 2]]
        return lenses, torch.cat([of_patch[..., :1], of_patch[..., 1:].clamp(-5.0, 2.0)], 2)


def told(lenses: Tensor) -> Tensor:
    """The mixture in plain numbers: weight, a, b, their deviations and correlation (…, NUMBERS)."""
    weight = torch.softmax(lenses[..., :1], -2)
    deviation = torch.exp(lenses[..., 3:5].clamp(MIN_LOG_DEVIATION, MAX_LOG_DEVIATION))
    correlation = MOST_CORRELATED * torch.tanh(lenses[..., 5:])
    return torch.cat([weight, lenses[..., 1:3], deviation, correlation], -1)


def negative_log_likelihood(lenses: Tensor, truth: Tensor) -> Tensor:
    """That of true lenses (N, 2) under the mixtures (N,), without the constant log(2 pi)."""
    log_weight = F.log_softmax(lenses[..., 0], 1)
    plain = told(lenses)
    deviation, correlation = plain[..., 3:5], plain[..., 5]
    first, second = ((truth[:, None] - plain[..., 1:3]) / deviation).unbind(-1)
    free = 1 - correlation**2
    distance = (first**2 - 2 * correlation * first * second + second**2) / free
    scale = torch.log(deviation).sum(-1) + 0.5 * torch.log(free)
    return -torch.logsumexp(log_weight - scale - 0.5 * distance, 1)
