"""ARNet and IUNet in the shapes of BokehMe (Peng et al. 2022), which the paper adopts.

Written anew from the published shapes: 923,664 and 240,076 parameters. No weights of theirs are
used.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

GAMMA_INPUT = (2.2 - 1.0) / 4.0  # BokehMe's normalisation of the exponent it was told
ARNET_WIDTH, IUNET_WIDTH = 128, 64
BLOCKS = 3
NO_ERROR = -2.0  # logit of the error map before any training: the classical result stands


def _block(width: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(width, width, 3, padding=1),
        nn.ELU(),
        nn.Conv2d(width, width, 3, padding=1),
        nn.ELU(),
    )


class _Trunk(nn.Module):
    """A first convolution, residual blocks, a last convolution; all at half the size."""

    def __init__(self, before: int, width: int, after: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(before, width, 3, padding=1)
        self.blocks = nn.ModuleList(_block(width) for _ in range(BLOCKS))
        self.last = nn.Conv2d(width, after, 3, padding=1)

    def forward(self, features: Tensor) -> Tensor:
        """(N, before, h, w) to (N, after, h, w)."""
        features = F.elu(self.first(features))
        for block in self.blocks:
            features = block(features) + features
        answer: Tensor = self.last(features)
        return answer


class ARNet(nn.Module):
    """Code values (N, 3, H, W) and defocus (N, 1, H, W) to picture and error map (N, 4, H, W).

    H and W are even. The picture is what it adds to the one it is given.
    """

    def __init__(self) -> None:
        super().__init__()
        self.trunk = _Trunk(4 * 4 + 1, ARNET_WIDTH, 16)
        nn.init.normal_(self.trunk.last.weight, std=0.002)
        with torch.no_grad():
            self.trunk.last.bias.zero_()
            self.trunk.last.bias[12:] = NO_ERROR

    def forward(self, code: Tensor, defocus: Tensor) -> Tensor:
        """Blur by defocus, |defocus| <= 1 at this size."""
        folded = F.pixel_unshuffle(torch.cat([code, defocus], 1), 2)
        gamma = torch.full_like(folded[:, :1], GAMMA_INPUT)
        answer = F.pixel_shuffle(self.trunk(torch.cat([folded, gamma], 1)), 2)
        return torch.cat([code + answer[:, :3], torch.sigmoid(answer[:, 3:])], 1)


class IUNet(nn.Module):
    """Code values, defocus and a coarse result (N, 3, H / 2, W / 2) to the picture (N, 3, H, W)."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = _Trunk(4 * 4 + 3 + 1, IUNET_WIDTH, 12)
        nn.init.normal_(self.trunk.last.weight, std=0.002)
        nn.init.zeros_(self.trunk.last.bias)

    def forward(self, code: Tensor, defocus: Tensor, coarse: Tensor) -> Tensor:
        """Refine; what it adds to the coarse result."""
        folded = F.pixel_unshuffle(torch.cat([code, defocus], 1), 2)
        gamma = torch.full_like(folded[:, :1], GAMMA_INPUT)
        answer = F.pixel_shuffle(self.trunk(torch.cat([folded, coarse, gamma], 1)), 2)
        return F.interpolate(coarse, scale_factor=2.0, mode="bilinear") + answer
