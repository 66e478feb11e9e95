"""Train the camera network on crops of rendered views, on one CPU thread.

    python -m models.camera.train --data /tmp/camera.npz --out /tmp/camera_run --minutes 20

The loss is the distance of the means, and from half of the training time on the likelihood of the
whole distribution too. Pitches that are rare in the views are drawn as often as the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from models.camera.data import Examples
from models.camera.network import CameraNet, root, scaled, surprise
from models.training import Schedule, TrainingRun, arguments, train
from nlens_video.solve.still.picture_cue import SPREADS, mirrored

NOISE = 0.1  # added to the features, by their deviation [1]
MEANS_WEIGHT, BEND = 3.0, 0.3
LIKELIHOOD_FROM = 0.5  # of the training time
PITCHES, FEWEST = 12, 60  # bins, and examples of one that count at least


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(Schedule):
    """Schedule and batches of a run.

    Attributes:
        batch: examples of a batch.
    """

    minutes: float = 20.0
    rate: float = 1.2e-3
    warm_up_steps: int = 100
    batch: int = 96


@dataclass(frozen=True, slots=True)
class Drawn:
    """Examples that are drawn by shares.

    Attributes:
        examples: N of them.
        ends: shares of each and of those before it (N,), the last 1.
    """

    examples: Examples
    ends: np.ndarray

    @classmethod
    def evenly(cls, examples: Examples) -> Drawn:
        """Every pitch about as often as any other."""
        pitches = examples.cameras[:, 0]
        counts, bins = np.histogram(pitches, PITCHES)
        which = np.clip(np.digitize(pitches, bins) - 1, 0, PITCHES - 1)
        shares = 1.0 / np.maximum(counts[which], FEWEST)
        return cls(examples, np.cumsum(shares / shares.sum()))


class Run(TrainingRun):
    """Training of the camera network."""

    EMA_DECAY = 0.998

    def build(self) -> CameraNet:
        """The camera network."""
        return CameraNet()

    def loss(self, data: Drawn) -> tuple[Tensor, float]:
        """Loss of a batch, and the mean error of its pitches [deg]."""
        picked = np.searchsorted(data.ends, self.rng.random(self.recipe.batch))
        picked = np.minimum(picked, len(data.ends) - 1)
        features, aspects, truth = tensors(data.examples, picked)
        flipped = torch.from_numpy(self.rng.random(len(features)) < 0.5)
        features[flipped] = torch.from_numpy(mirrored(features[flipped].numpy()).copy())
        truth[flipped, 1] *= -1.0  # its middle is 0
        features = features + NOISE * self.network.deviation * torch.randn_like(features)
        answer = self.network.train()(features, aspects)
        loss = MEANS_WEIGHT * F.smooth_l1_loss(answer[:, :3], truth, beta=BEND)
        spread_alone = torch.cat([answer[:, :3].detach(), answer[:, 3:]], 1)
        loss = loss + surprise(spread_alone, truth).mean()
        if self.progress > LIKELIHOOD_FROM:
            loss = loss + surprise(answer, truth).mean()
        off = (answer[:, 0] - truth[:, 0]).detach().abs().mean()
        return loss, float(off) * math.degrees(SPREADS[0])

    def advance(self, data: Drawn) -> float:
        """One step; the statistics of the normalisation follow at once, without an average."""
        shown = super().advance(data)
        for slow, fast in zip(self.average.buffers(), self.network.buffers(), strict=True):
            slow.copy_(fast)
        return shown


def tensors(examples: Examples, picked: np.ndarray) -> tuple[Tensor, Tensor, Tensor]:
    """Features, aspects (N, 1) and scaled cameras of some examples."""
    features = torch.from_numpy(examples.features[picked].astype(np.float32))
    aspects = torch.from_numpy(examples.aspects[picked])[:, None]
    return features, aspects, scaled(torch.from_numpy(examples.cameras[picked]))


def normalise(network: CameraNet, examples: Examples) -> None:
    """Give the network the mean and the deviation of the features."""
    some = examples.features[:: max(1, len(examples.features) // 4000)].astype(np.float32)
    network.mean.copy_(torch.from_numpy(some.mean(axis=(0, 1, 2))))
    network.deviation.copy_(torch.from_numpy(some.std(axis=(0, 1, 2)) + 1e-3))


def validate(network: CameraNet, examples: Examples) -> dict[str, float]:
    """Figures on examples: errors of the means, and how many are within one stated error."""
    answers, truths = [], []
    for part in np.array_split(np.arange(len(examples.scenes)), 1 + len(examples.scenes) // 500):
        features, aspects, truth = tensors(examples, part)
        with torch.inference_mode():
            answers.append(network.eval()(features, aspects))
        truths.append(truth)
    answer, truth = torch.cat(answers), torch.cat(truths)
    off = ((answer[:, :3] - truth) * torch.from_numpy(SPREADS).float()).abs()
    lower = root(answer)
    covariance = torch.linalg.inv(lower.transpose(1, 2) @ lower)
    stated = torch.diagonal(covariance, dim1=1, dim2=2).sqrt() * torch.from_numpy(SPREADS).float()
    return {
        "surprise": round(float(surprise(answer, truth).mean()), 3),
        "pitch_median_deg": round(math.degrees(float(off[:, 0].median())), 2),
        "pitch_90th_deg": round(math.degrees(float(off[:, 0].quantile(0.9))), 2),
        "roll_median_deg": round(math.degrees(float(off[:, 1].median())), 2),
        "focal_median": round(float(off[:, 2].median()), 3),
        "pitch_within_one": round(float((off[:, 0] < stated[:, 0]).float().mean()), 3),
    }


def main() -> None:
    """Train until the time is up."""
    options = arguments(__doc__, Recipe(), validation=False).parse_args()
    torch.set_num_threads(1)
    examples = Examples.load(options.data)
    training, apart = examples.part(apart=False), examples.part(apart=True)
    run = Run(Recipe(minutes=options.minutes, rate=options.rate))
    for network in (run.network, run.average):
        normalise(network, training)
    train(
        run, Drawn.evenly(training), options, lambda: validate(run.average, apart),
        figure=("train_pitch_deg", 2), shown=lambda off: f"pitch {off:.2f} deg",
        every_steps=200, check_every_s=120.0,
    )  # fmt: skip


if __name__ == "__main__":
    main()
