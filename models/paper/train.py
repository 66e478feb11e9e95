"""Train ARNet and IUNet together, in a small time box, on one CPU thread.

    python -m models.paper.train --data /tmp/paper_data --validation /tmp/paper_val \
        --out /tmp/paper_run --minutes 20

An interrupted run resumes from its checkpoint; `--begin-from` starts from shipped weights.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from models.paper.data import PARTS
from models.paper.network import ARNet, IUNet
from models.reblur.data import Reservoir, split_maps
from models.training import Schedule, TrainingRun, arguments, train
from nlens_video.stages.l_paper import GAMMA, NEURAL_RADIUS_PX

RIM_PX = 16  # not counted: discs from beyond the crop arrive there


class PaperNets(nn.Module):
    """Both networks, wired as `nlens_video.stages.l_paper` wires them."""

    def __init__(self) -> None:
        super().__init__()
        self.arnet = ARNet()
        self.iunet = IUNet()

    def forward(
        self, code: Tensor, radius: Tensor, dilated: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The neural picture, the coarse one that it was made from, and the error map.

        Args:
            code: code values of the naive composite (N, 3, H, W), H and W multiples of 4.
            radius: signed radius (N, 1, H, W), at most twice NEURAL_RADIUS_PX [px].
            dilated: largest radius whose disc covers a pixel (N, 1, H, W) [px].
        """
        defocus = radius / NEURAL_RADIUS_PX
        halved = bool(radius.abs().max() > NEURAL_RADIUS_PX)
        if halved:
            answer = self.arnet(F.avg_pool2d(code, 2), 0.5 * F.avg_pool2d(defocus, 2))
            coarse = half = answer[:, :3]
        else:
            answer = self.arnet(code, defocus)
            coarse, half = answer[:, :3], F.avg_pool2d(answer[:, :3], 2)
        neural = self.iunet(code, defocus.clamp(-1, 1), half)
        error = answer[:, 3:]
        if halved:
            within = (dilated < NEURAL_RADIUS_PX).to(code.dtype)
            mask = F.avg_pool2d(within, 5, stride=1, padding=2, count_include_pad=False)
            raised = F.interpolate(coarse, scale_factor=2.0, mode="bilinear")
            neural = mask * neural + (1 - mask) * raised
            error = F.interpolate(error, scale_factor=2.0, mode="bilinear")
        return neural, coarse, error


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(Schedule):
    """Schedule and batches of a run.

    Attributes:
        batch: composites of a batch.
    """

    minutes: float = 20.0
    rate: float = 5e-4
    warm_up_steps: int = 60
    last: float = 0.02
    batch: int = 2


def coded(light: Tensor) -> Tensor:
    """Code values of light."""
    return light.clamp_min(1e-5) ** (1 / GAMMA)


def to_tensors(maps: np.ndarray) -> dict[str, Tensor]:
    """Stored maps (N, H, W, channels) by name as tensors (N, c, H, W)."""
    return {
        name: torch.from_numpy(np.ascontiguousarray(part)).permute(0, 3, 1, 2)
        for name, part in split_maps(maps, PARTS).items()
    }


def rendered(nets: PaperNets, parts: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """The blend, the neural picture and the coarse one, as code values."""
    code, classical = coded(parts["light"]), coded(parts["classical"])
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=torch.is_grad_enabled()):
        neural, coarse, error = nets(code, parts["radius"], parts["dilated"])
    neural, coarse, error = neural.float(), coarse.float(), error.float()
    return classical + error * (neural - classical), neural, coarse


def loss_of(nets: PaperNets, parts: dict[str, Tensor]) -> Tensor:
    """Absolute errors of the blend and, less, of what it is made from."""
    truth = coded(parts["truth"])
    blend, neural, coarse = rendered(nets, parts)
    small = F.avg_pool2d(truth, 2) if coarse.shape != truth.shape else truth

    def wrong(found: Tensor, true: Tensor) -> Tensor:
        rim = RIM_PX * found.shape[-1] // truth.shape[-1]
        return (found - true)[..., rim:-rim, rim:-rim].abs().mean()

    return wrong(blend, truth) + 0.5 * wrong(neural, truth) + 0.25 * wrong(coarse, small)


class Run(TrainingRun):
    """Training of both networks."""

    BETAS = (0.9, 0.999)

    def build(self) -> PaperNets:
        """ARNet and IUNet."""
        return PaperNets()

    def loss(self, data: Reservoir) -> tuple[Tensor, float]:
        """Loss of a batch of composites, turned and mirrored; twice."""
        picked = [
            np.rot90(data.maps[index], int(self.rng.integers(4)))[
                :, :: int(self.rng.integers(2)) * 2 - 1
            ]
            for index in self.rng.integers(0, data.drawn, self.recipe.batch)
        ]
        loss = loss_of(self.network, to_tensors(np.stack(picked)))
        return loss, float(loss.detach())


def validate(nets: PaperNets, data: Reservoir) -> tuple[float, float, float]:
    """Mean PSNR of naive composite, classical result and blend on held-out composites [dB]."""
    rows = []
    for index in range(data.drawn):
        parts = to_tensors(data.maps[index : index + 1])
        with torch.inference_mode():
            truth = coded(parts["truth"]).clamp_max(1)
            found = (coded(parts["light"]), coded(parts["classical"]), rendered(nets, parts)[0])
            wrong = [(f.clamp(0, 1) - truth)[..., RIM_PX:-RIM_PX, RIM_PX:-RIM_PX] for f in found]
        rows.append([-10 * math.log10(max(float((w**2).mean()), 1e-9)) for w in wrong])
    naive, classical, blend = np.mean(rows, axis=0)
    return float(naive), float(classical), float(blend)


def held_out(run: Run, options: argparse.Namespace) -> dict[str, float]:
    """PSNR on the held-out composites [dB]."""
    found = validate(run.network, Reservoir(options.validation, parts=PARTS))
    names = ("naive_db", "classical_db", "blend_db")
    row = {name: round(value, 3) for name, value in zip(names, found, strict=True)}
    print("  ", row, flush=True)
    return row


def main() -> None:
    """Train until the time is up."""
    options = arguments(__doc__, Recipe()).parse_args()
    torch.set_num_threads(1)
    run = Run(Recipe(minutes=options.minutes, rate=options.rate))
    train(
        run, Reservoir(options.data, parts=PARTS), options, lambda: held_out(run, options),
        figure=("loss", 5), shown=lambda loss: f"loss {loss:.5f}", every_steps=50, memory=0.97,
    )  # fmt: skip


if __name__ == "__main__":
    main()
