"""Train ARNet and IUNet together, in a small time box, on one CPU thread.

    python -m models.paper.train --data /tmp/paper_data --validation /tmp/paper_val \
        --out /tmp/paper_run --minutes 20

A run that stopped goes on from its checkpoint; `--begin-from` starts from shipped weights.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from models.paper.data import PARTS
from models.paper.network import ARNet, IUNet
from models.reblur.data import Reservoir, split_maps
from nlens_video.stages.reblur.l_paper import GAMMA, NEURAL_RADIUS_PX

WARM_UP_STEPS = 60
RIM_PX = 16  # not counted: discs from beyond the crop arrive there
CHECK_EVERY_S = 300.0


class PaperNets(nn.Module):
    """Both networks, wired as `nlens_video.stages.reblur.l_paper` wires them."""

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


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a run does.

    Attributes:
        minutes: training time, checks not counted [min].
        rate: peak learning rate.
        batch: composites of a batch.
        seed: of the weights and the batches.
    """

    minutes: float = 20.0
    rate: float = 5e-4
    batch: int = 2
    seed: int = 1

    def rate_at(self, progress: float, step: int) -> float:
        """Learning rate at a share of the time."""
        warm = min(1.0, (step + 1) / WARM_UP_STEPS)
        return self.rate * warm * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(progress, 1))))


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


class Run:
    """The state of a training run."""

    def __init__(self, recipe: Recipe) -> None:
        torch.manual_seed(recipe.seed)
        self.recipe = recipe
        self.nets = PaperNets().to(memory_format=torch.channels_last)
        self.optimiser = torch.optim.AdamW(self.nets.parameters(), recipe.rate, weight_decay=0.01)
        self.rng = np.random.default_rng(recipe.seed)
        self.step = 0
        self.trained_s = 0.0

    @property
    def progress(self) -> float:
        """Share of the training time that has passed."""
        return self.trained_s / (60 * self.recipe.minutes)

    def advance(self, data: Reservoir) -> float:
        """One step; returns its loss."""
        start = time.perf_counter()
        picked = [
            np.rot90(data.maps[index], int(self.rng.integers(4)))[
                :, :: int(self.rng.integers(2)) * 2 - 1
            ]
            for index in self.rng.integers(0, data.drawn, self.recipe.batch)
        ]
        for group in self.optimiser.param_groups:
            group["lr"] = self.recipe.rate_at(self.progress, self.step)
        loss = loss_of(self.nets, to_tensors(np.stack(picked)))
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.nets.parameters(), 1.0)
        self.optimiser.step()
        self.step += 1
        self.trained_s += time.perf_counter() - start
        return float(loss.detach())

    def save(self, path: Path) -> None:
        """Write a checkpoint; the old one stays until the new one is complete."""
        state = {
            "nets": self.nets.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "trained_s": self.trained_s,
        }
        fresh = path.with_suffix(".new")
        torch.save(state, fresh)
        fresh.replace(path)

    def load(self, path: Path) -> None:
        """Go on from a checkpoint (other batches follow than without the stop)."""
        state = torch.load(path, weights_only=True)
        self.nets.load_state_dict(state["nets"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.trained_s = state["step"], state["trained_s"]
        self.rng = np.random.default_rng([self.recipe.seed, self.step])

    def begin_from(self, path: Path) -> None:
        """Take the shipped half-precision weights as the beginning of a new run."""
        weights = torch.load(path, weights_only=True)
        self.nets.load_state_dict({name: value.float() for name, value in weights.items()})


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


def check(run: Run, loss: float, options: argparse.Namespace) -> None:
    """Validate, log a line in the curve, save."""
    naive, classical, blend = validate(run.nets, Reservoir(options.validation, parts=PARTS))
    row = {
        "minutes": round(run.trained_s / 60, 2),
        "step": run.step,
        "loss": round(loss, 5),
        "naive_db": round(naive, 3),
        "classical_db": round(classical, 3),
        "blend_db": round(blend, 3),
    }
    print("  ", row, flush=True)
    curve = options.out / "curve.csv"
    fresh = not curve.exists()
    with curve.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        if fresh:
            writer.writeheader()
        writer.writerow(row)
    run.save(options.out / "checkpoint.pt")


def main() -> None:
    """Train until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="reservoir written by data.py")
    parser.add_argument("--validation", type=Path, required=True, help="held-out reservoir")
    parser.add_argument("--out", type=Path, required=True, help="checkpoint and curve")
    parser.add_argument("--minutes", type=float, default=Recipe().minutes)
    parser.add_argument("--rate", type=float, default=Recipe().rate)
    parser.add_argument("--begin-from", type=Path, help="shipped weights")
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.out.mkdir(parents=True, exist_ok=True)
    run = Run(Recipe(minutes=options.minutes, rate=options.rate))
    if (options.out / "checkpoint.pt").exists():
        run.load(options.out / "checkpoint.pt")
    elif options.begin_from:
        run.begin_from(options.begin_from)
    data = Reservoir(options.data, parts=PARTS)
    recent, checked = 0.0, run.trained_s
    while run.progress < 1:
        loss = run.advance(data)
        recent = loss if run.step == 1 else recent * 0.97 + 0.03 * loss
        if run.step % 50 == 0:
            minutes = run.trained_s / 60
            print(f"{minutes:6.1f} min  step {run.step}  loss {recent:.5f}", flush=True)
        if run.trained_s - checked > CHECK_EVERY_S or run.progress >= 1:
            check(run, recent, options)
            checked = run.trained_s


if __name__ == "__main__":
    main()
