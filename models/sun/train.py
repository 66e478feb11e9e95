"""Train the sun network on a folder of pictures of `data.py`, on the CPU.

    python -m models.sun.train --data /tmp/sun --out /tmp/sun_run

Every picture is seen through ever other crops, mirrored, exposed and developed anew, and with an
error of the camera's pitch and focal length, as solved cameras have it. One in ten is held out.
"""

from __future__ import annotations

import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from scipy.spatial.transform import Rotation
from torch import Tensor

from models.sun.data import BRIGHTEST, Examples
from models.sun.network import SunNet
from models.training import Schedule, TrainingRun, arguments, train
from nlens_video.scene.plate_sun import (
    AZIMUTHS,
    BRIGHT,
    ELEVATIONS,
    HIGHEST_DEG,
    LOWEST_DEG,
    GroundMaps,
)  # fmt: skip

SMALLEST_CROP = 0.55
PITCH_ERROR, FOCAL_ERROR = math.radians(2.0), 0.08
LABELS_WEIGHT = 4.0
_BESIDE = ThreadPoolExecutor(1, "batches")  # the next is drawn while one is learnt from
_SPREADS_DEG = (8.0, 5.0)  # of the targets, over azimuths and elevations


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(Schedule):
    """Schedule and batches of a run.

    Attributes:
        batch: pictures of a batch.
    """

    minutes: float = 64.0
    rate: float = 2e-3
    warm_up_steps: int = 200
    batch: int = 48


@dataclass(frozen=True, slots=True)
class Batch:
    """Features (N, MAP_ROWS, MAP_COLUMNS, CHANNELS), labels of every fourth pixel, suns (N,)."""

    features: Tensor
    labels: Tensor
    azimuth: Tensor
    elevation: Tensor
    left: Tensor


def maps(cameras: np.ndarray, window: np.ndarray) -> GroundMaps:
    """Maps of the ground through windows of frames.

    Args:
        cameras: pitch, roll, horizontal field of view [rad], aspect (N, 4).
        window: left, top, right and bottom of what is seen, by the frame's size (N, 4).
    """
    pitch, roll, fov, aspect = cameras.T.astype(np.float64)
    turn = Rotation.from_euler("XZ", np.stack([-pitch, roll], axis=1)).as_matrix()
    focal = 0.5 / np.tan(0.5 * fov)
    half = np.full(len(fov), 0.5)
    return GroundMaps.of(turn, np.stack([focal, focal * aspect, half, half], axis=1), window)


def drawn(examples: Examples, picked: np.ndarray, rng: np.random.Generator | None) -> Batch:
    """A batch of the examples of some numbers; varied by a generator, or as it is."""
    pictures = torch.from_numpy(examples.pictures[picked]).permute(0, 3, 1, 2).float() / 255.0
    labels = torch.from_numpy(examples.labels[picked]).permute(0, 3, 1, 2).float() / 255.0
    cameras, suns = examples.cameras[picked].copy(), torch.from_numpy(examples.suns[picked])
    count = len(pictures)
    window = np.tile([0.0, 0.0, 1.0, 1.0], (count, 1))
    gain = torch.full((count, 1, 1, 1), BRIGHT * BRIGHTEST)
    gamma = torch.full((count, 1, 1, 1), 2.0 / 2.2)  # the pictures are roots of light
    if rng is not None:

        def normal(spread: float, *shape: int) -> Tensor:
            return torch.from_numpy(rng.normal(0.0, spread, (count, *shape)).astype(np.float32))

        size = 1.0 - (1.0 - SMALLEST_CROP) * rng.random((count, 2)) * (rng.random((count, 1)) < 0.7)
        corner = (1.0 - size) * rng.random((count, 2))
        window = np.concatenate([corner, corner + size], axis=1)
        gain = gain * torch.exp(normal(0.35, 1, 1, 1) + normal(0.08, 3, 1, 1))
        gamma = gamma * torch.exp(normal(0.15, 1, 1, 1))
        cameras[:, 0] += rng.normal(0.0, PITCH_ERROR, count)
        cameras[:, 2] *= np.exp(rng.normal(0.0, FOCAL_ERROR, count))
    ground = maps(cameras, window)
    places = torch.from_numpy(ground.places)
    low, high = (torch.from_numpy(window[:, None, None, part]).float() for part in np.s_[:2, 2:])
    shown = ((places > low) & (places < high)).all(-1, keepdim=True).float()
    laid = _laid(pictures, places)
    labels = _laid(labels, F.avg_pool2d(places.permute(0, 3, 1, 2), 4).permute(0, 2, 3, 1))
    labels = labels * F.avg_pool2d(shown.permute(0, 3, 1, 2), 4)
    code = (laid * torch.sqrt(gain)).clamp(1e-3, 1.0) ** gamma
    place = torch.from_numpy(ground.coordinates)
    if rng is not None:
        noise = torch.from_numpy(rng.uniform(0.0, 0.02, (count, 1, 1, 1)).astype(np.float32))
        code = (code + noise * torch.randn_like(code)).clamp(0.0, 1.0)
    code = code.permute(0, 2, 3, 1) * shown
    features = torch.cat([code, shown, place], -1)
    if rng is not None:
        flipped = torch.from_numpy(rng.random(count) < 0.5)
        features[flipped] = features[flipped].flip(2)
        features[flipped, ..., -1] *= -1.0
        labels[flipped] = labels[flipped].flip(3)
        suns = suns.clone()
        suns[flipped, 0] *= -1.0
    return Batch(features, labels, suns[:, 0], suns[:, 1], torch.log2(suns[:, 2]))


def _laid(pictures: Tensor, places: Tensor) -> Tensor:
    """Pictures (N, C, H, W) laid onto maps, by places in them, 0 to 1 (N, h, w, 2)."""
    grid = 2.0 * places - 1.0
    return F.grid_sample(pictures, grid, padding_mode="border", align_corners=False)


def surprise(answer: Tensor, batch: Batch) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Of azimuths, elevations, of whether a sun shines, and the error of what is left [EV]."""
    sunny = ~torch.isnan(batch.azimuth)
    at = 2.0 * math.pi * torch.arange(AZIMUTHS) / AZIMUTHS
    off = torch.remainder(at - batch.azimuth[sunny, None] + math.pi, 2.0 * math.pi) - math.pi
    target = torch.softmax(-0.5 * (off / math.radians(_SPREADS_DEG[0])) ** 2, 1)
    azimuth = F.cross_entropy(answer[sunny, :AZIMUTHS], target)
    step = (HIGHEST_DEG - LOWEST_DEG) / ELEVATIONS
    middles = LOWEST_DEG + (torch.arange(ELEVATIONS) + 0.5) * step
    away = (middles - torch.rad2deg(batch.elevation[sunny, None])) / _SPREADS_DEG[1]
    elevation = F.cross_entropy(
        answer[sunny, AZIMUTHS : AZIMUTHS + ELEVATIONS], torch.softmax(-0.5 * away**2, 1)
    )
    shines = F.binary_cross_entropy_with_logits(answer[:, -2], sunny.float())
    left = F.smooth_l1_loss(answer[sunny, -1], batch.left[sunny], beta=0.3)
    return azimuth, elevation, shines, left


class Run(TrainingRun):
    """Training of the sun network."""

    EMA_DECAY = 0.998
    _ahead: Future[Batch] | None = None

    def build(self) -> SunNet:
        """The sun network."""
        return SunNet()

    def loss(self, data: Examples) -> tuple[Tensor, float]:
        """Loss of a batch, and that of its azimuths."""
        batch = self._draw(data) if self._ahead is None else self._ahead.result()
        self._ahead = _BESIDE.submit(self._draw, data)
        with torch.autocast("cpu", torch.bfloat16):
            answer, labels = self.network.train().with_labels(batch.features)
        azimuth, elevation, shines, left = surprise(answer.float(), batch)
        seen = F.binary_cross_entropy_with_logits(labels.float(), batch.labels)
        loss = azimuth + 0.5 * elevation + shines + 0.5 * left + LABELS_WEIGHT * seen
        return loss, float(azimuth.detach())

    def _draw(self, data: Examples) -> Batch:
        picked = self.rng.integers(len(data.suns), size=self.recipe.batch)
        return drawn(data, picked, self.rng)

    def advance(self, data: Examples) -> float:
        """One step; statistics of the normalisation follow as the weights do."""
        shown = super().advance(data)
        for slow, fast in zip(self.average.buffers(), self.network.buffers(), strict=True):
            slow.copy_(fast)
        return shown


def validate(network: SunNet, examples: Examples) -> dict[str, float]:
    """Figures on examples that were held out."""
    answers, batches = [], []
    for part in np.array_split(np.arange(len(examples.suns)), 1 + len(examples.suns) // 200):
        batch = drawn(examples, part, None)
        with torch.inference_mode():
            answers.append(network.eval()(batch.features))
        batches.append(
            Batch(torch.zeros(0), torch.zeros(0), batch.azimuth, batch.elevation, batch.left)
        )
    answer = torch.cat(answers)
    joined = Batch(*(torch.cat([getattr(b, n) for b in batches]) for n in Batch.__slots__))
    azimuth, elevation, shines, left = (float(part) for part in surprise(answer, joined))
    off, certainty = judged(answer, joined)
    sure = certainty > 0.75
    sunny = ~torch.isnan(joined.azimuth)
    wrong = ~sunny | (off > 25.0)
    return {
        "azimuth": round(azimuth, 3), "elevation": round(elevation, 3),
        "shines": round(shines, 3), "left": round(left, 3),
        "median_off_deg": round(float(off[sunny].median()), 1),
        "sure": round(float((sure & sunny).float().sum() / sunny.sum()), 3),
        "sure_and_wrong": round(float(wrong[sure].float().mean()) if sure.any() else 0.0, 3),
    }  # fmt: skip


def judged(answer: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
    """Error of the azimuth (N,) [deg], and how certain it is (N,) [1]."""
    shares = torch.softmax(answer[:, :AZIMUTHS], 1)
    mode = shares.argmax(1)
    at = (mode[:, None] + torch.arange(-2, 3)) % AZIMUTHS
    certainty = torch.gather(shares, 1, at).sum(1) * torch.sigmoid(answer[:, -2])
    off = 2.0 * math.pi * mode / AZIMUTHS - batch.azimuth
    off = torch.remainder(off + math.pi, 2.0 * math.pi) - math.pi
    return torch.rad2deg(off.abs()), certainty


def main() -> None:
    """Train until the time is up."""
    options = arguments(__doc__, Recipe(), validation=False).parse_args()
    torch.set_num_threads(1)
    examples = Examples.load(options.data)
    # every tenth picture, so that files may be added to a run
    apart = np.arange(len(examples.suns)) % 10 == 9
    training, held_out = (
        Examples(*(getattr(examples, name)[mask] for name in Examples.__slots__))
        for mask in (~apart, apart)
    )
    run = Run(Recipe(minutes=options.minutes, rate=options.rate))
    train(
        run, training, options, lambda: validate(run.average, held_out),
        figure=("train_azimuth", 3), shown=lambda value: f"azimuth {value:.3f}",
        every_steps=100, check_every_s=120.0,
    )  # fmt: skip


if __name__ == "__main__":
    main()
