"""Train the CoC network on a reservoir of drawn pictures, on one CPU thread or a GPU.

    python -m models.coc.train --data /tmp/coc_data --validation /tmp/coc_val --out /tmp/coc_run \
        --minutes 80 [--device cuda --pictures 24] [--plates FOLDER]

The schedule follows training time, not steps: learning rate along a cosine, crops of 256 px, then
whole pictures for the second half. An interrupted run resumes from its checkpoint.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import torch

from models.coc.batches import Batches, moved
from models.coc.data import Reservoir
from models.coc.evaluate import Estimate, Figures, evaluate_plates, figures
from models.coc.network import CocNet, coc_and_sigma, laplace_loss
from models.coc.recorded import RecordedRun
from models.coc.run import Recipe, Run
from models.coc.scene import SIZE
from models.training import arguments, train


def _where(network: CocNet) -> torch.device:
    return next(network.parameters()).device


def torch_estimate(network: CocNet) -> Estimate:
    """An estimator on pictures whose sides are multiples of 32."""

    def estimate(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with torch.inference_mode():
            answer = network(moved(torch.from_numpy(rgb), _where(network)).permute(2, 0, 1)[None])
            maps = [part[0].cpu().numpy() for part in coc_and_sigma(answer)]
        size = (rgb.shape[1], rgb.shape[0])
        coc, sigma = (cv2.resize(part, size, interpolation=cv2.INTER_LINEAR) for part in maps)
        return coc, sigma

    return estimate


def validate(network: CocNet, data: Reservoir) -> tuple[float, Figures]:
    """Negative log-likelihood and figures on the held-out pictures, whole, as they are."""
    count = min(data.drawn, len(data.pictures))
    losses, maps = [], []
    for first in range(0, count, 16):
        part = slice(first, min(first + 16, count))
        rgb, truth = (
            moved(torch.from_numpy(np.float32(values)), _where(network))
            for values in (data.pictures[part], data.labels[part])
        )
        rgb = rgb.permute(0, 3, 1, 2) / 255
        with torch.inference_mode():
            answer = network(rgb)
            losses.append(float(laplace_loss(answer, truth)[1]) * len(rgb))
            maps.append(torch.stack([*coc_and_sigma(answer), truth]).cpu().numpy())
    coc, sigma, truth_px = np.concatenate(maps, 1)
    return sum(losses) / count, figures("held-out", coc, sigma, truth_px)


def held_out(run: Run, options: argparse.Namespace) -> dict[str, float]:
    """Figures on the held-out pictures, and on plates where there are any."""
    row: dict[str, float] = {}
    for name, folder in (("held_out", options.validation), ("hard", options.hard_validation)):
        if folder is None:
            continue
        likelihood, found = validate(run.average, Reservoir(folder))
        print(found.line(), f" {name}, nll {likelihood:.3f}", flush=True)
        row[f"{name}_nll"] = round(likelihood, 4)
        row[f"{name}_rmse_px"] = round(found.rmse_px, 3)
        row[f"{name}_confident_rmse_px"] = round(found.confident_rmse_px, 3)
        row[f"{name}_relative"] = round(found.relative, 4)
    if options.plates:
        results = evaluate_plates(torch_estimate(run.average), options.plates)
        print("\n".join(result.line() for result in results), flush=True)
        row["plates_rmse_px"] = round(results[-1].rmse_px, 3)
        row["plates_confident_rmse_px"] = round(results[-1].confident_rmse_px, 3)
    return row


def main() -> None:
    """Train until the time is up."""
    parser = arguments(__doc__, Recipe())
    parser.add_argument("--rendered", type=Path, help="reservoir of rendered pictures, if any")
    parser.add_argument("--hard-validation", type=Path, help="another one, of long grounds")
    parser.add_argument("--plates", type=Path, help="rendered plates, for the log only")
    parser.add_argument("--crop", type=int, default=Recipe().crop, help="of the first half [px]")
    parser.add_argument("--device", default="cpu", choices=("cpu", "cuda"))
    parser.add_argument("--check-every", type=float, default=10.0, help="until a validation [min]")
    parser.add_argument("--pictures", type=int, default=2, help="whole ones of a batch")
    options = parser.parse_args()
    torch.set_num_threads(1)
    torch.backends.cudnn.benchmark = True
    cv2.setNumThreads(1)
    recipe = Recipe(
        minutes=options.minutes,
        rate=options.rate,
        crop=options.crop,
        pixels=options.pictures * SIZE**2,
    )
    run = RecordedRun(recipe) if options.device == "cuda" else Run(recipe)
    batches = Batches(options.data, options.rendered, run.device)
    train(
        run, batches, options, lambda: held_out(run, options),
        figure=("train_nll", 4), shown=lambda nll: f"nll {nll:.3f}",
        check_every_s=60 * options.check_every,
    )  # fmt: skip


if __name__ == "__main__":
    main()
