"""The CoC network: a U-Net without normalisation layers that answers at a quarter of the size.

A blur is seen in how contrast changes from one octave to the next, whatever the contrast itself.
So the picture enters twice: as it is, and as luma divided by its local contrast, so that a faint
wooden grain speaks as loudly as a printed letter. Features go down to 1/32 of the size, because a
CoC of 64 px must be seen whole.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from models.blocks import Residual

STRIDE = 32  # height and width must be multiples of it [px]
LABEL_STEP = 4
WIDTHS = (24, 48, 64, 80, 88)
DEPTHS = (0, 2, 3, 4, 4)
DECODER_DEPTHS = (2, 2, 2)  # at 1/16, 1/8 and 1/4 of the size
MIN_LOG_SCALE, MAX_LOG_SCALE = -5.0, 1.5
CONTRAST_FLOOR = 0.004  # a code value: fainter contrast is not amplified further
CONTRAST_STEP = 8  # cell of the local contrast; it is gathered over five cells [px]


def with_contrast(picture: Tensor) -> Tensor:
    """The picture around zero and its contrast-normalised luma, (N, 4, H, W) of (N, 3, H, W)."""
    luma = 0.3 * picture[:, :1] + 0.6 * picture[:, 1:2] + 0.1 * picture[:, 2:]
    moments = F.avg_pool2d(torch.cat([luma, luma * luma], 1), CONTRAST_STEP)
    moments = F.avg_pool2d(moments, 5, stride=1, padding=2, count_include_pad=False)
    moments = F.interpolate(moments, scale_factor=CONTRAST_STEP, mode="bilinear")
    mean, square = moments[:, :1], moments[:, 1:]
    variance = F.relu(square - mean * mean) + CONTRAST_FLOOR**2
    return torch.cat([picture - 0.5, 0.5 * (luma - mean) / torch.sqrt(variance)], 1)


class CocNet(nn.Module):
    """RGB (N, 3, H, W), display-coded in [0, 1], to (N, 2, H / 4, W / 4).

    Channel 0 is the median of log(1 + CoC diameter [px]), channel 1 the log of its Laplace scale.
    """

    def __init__(self, widths: tuple[int, ...] = WIDTHS, depths: tuple[int, ...] = DEPTHS) -> None:
        super().__init__()
        self.stem = nn.Conv2d(4, widths[0], 6, stride=2, padding=2)
        self.down = nn.ModuleList()
        self.encode = nn.ModuleList([self._blocks(widths[0], depths[0])])
        for before, width, depth in zip(widths, widths[1:], depths[1:], strict=False):
            self.down.append(nn.Conv2d(before, width, 3, stride=2, padding=1))
            self.encode.append(self._blocks(width, depth))
        self.lateral, self.decode = nn.ModuleList(), nn.ModuleList()
        for deep, width, depth in zip(widths[:1:-1], widths[-2:0:-1], DECODER_DEPTHS, strict=True):
            self.lateral.append(nn.Conv2d(deep, width, 1))
            self.decode.append(self._blocks(width, depth))
        self.head = nn.Sequential(
            nn.ReLU(), nn.Conv2d(widths[1], widths[1], 3, padding=1), nn.ReLU()
        )
        self.answer = nn.Conv2d(widths[1], 2, 1)
        nn.init.normal_(self.answer.weight, std=0.01)
        with torch.no_grad():
            self.answer.bias.copy_(torch.tensor([1.8, -0.5]))

    @staticmethod
    def _blocks(width: int, depth: int) -> nn.Sequential:
        return nn.Sequential(*(Residual(width) for _ in range(depth)))

    def forward(self, picture: Tensor) -> Tensor:
        """Log-CoC and its log-scale; H and W multiples of STRIDE."""
        kind = picture.device.type
        with torch.autocast(kind, enabled=False):  # faint texture needs the full precision
            features = self.stem(with_contrast(picture.float()))
        levels = [self.encode[0](features)]
        for down, encode in zip(self.down, self.encode[1:], strict=True):
            levels.append(encode(down(F.relu(levels[-1]))))
        features = levels.pop()
        for lateral, decode in zip(self.lateral, self.decode, strict=True):
            raised = F.interpolate(lateral(features), scale_factor=2, mode="bilinear")
            features = decode(levels.pop() + raised)
        with torch.autocast(kind, enabled=False):
            answer = self.answer(self.head(features.float()))
        log_coc = answer[:, :1]
        log_scale = answer[:, 1:].clamp(MIN_LOG_SCALE, MAX_LOG_SCALE)
        return torch.cat([log_coc, log_scale], 1)


def coc_and_sigma(answer: Tensor) -> tuple[Tensor, Tensor]:
    """CoC diameter [px] and its expected absolute error [px], each (N, h, w)."""
    coc = (torch.exp(answer[:, 0]) - 1).clamp_min(0)
    return coc, torch.exp(answer[:, 1]) * (1 + coc)


def laplace_loss(answer: Tensor, coc_px: Tensor, beta: float = 0.5) -> tuple[Tensor, Tensor]:
    """The loss to descend and the plain negative log-likelihood to report.

    Weighting each pixel by its own (detached) scale^beta keeps uncertain pixels from being given up
    on (beta-NLL, Seitzer et al. 2022).

    Args:
        answer: output of the network (N, 2, h, w).
        coc_px: true CoC diameter (N, h, w) [px].
        beta: 0 the plain likelihood, 1 nearly the plain absolute error.
    """
    log_scale = answer[:, 1]
    error = (answer[:, 0] - torch.log1p(coc_px)).abs()
    likelihood = error * torch.exp(-log_scale) + log_scale
    weight = torch.exp(beta * log_scale.detach())
    return (weight * likelihood).mean(), likelihood.mean()
