"""Batches of crops from reservoirs that go on growing, on the device that trains."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from models.coc.data import LABEL_STEP, Reservoir
from models.coc.scene import SIZE

RENDERED_SHARE = 0.15  # of a batch, when there are rendered pictures
GAIN_DEVIATION = 0.06  # of the logarithm, of each channel


class Pictures:
    """The pictures of one reservoir; a GPU keeps them all and takes what is new.

    A GPU needs the memory of the full reservoir at once, 0.82 MB a picture.

    Args:
        folder: the reservoir; it may not exist yet.
        device: that trains.

    Attributes:
        folder: the reservoir.
        pictures: uint8 (capacity, SIZE, SIZE, 3), display-coded; empty before the first refresh.
        labels: CoC [px], float16 (capacity, SIZE / LABEL_STEP, SIZE / LABEL_STEP), likewise.
    """

    def __init__(self, folder: Path, device: torch.device) -> None:
        self.folder, self._device = folder, device
        self._reservoir: Reservoir | None = None
        self._taken = 0
        self.pictures, self.labels = torch.empty(0), torch.empty(0)

    @property
    def count(self) -> int:
        """Pictures that can be drawn from."""
        return min(self._taken, len(self.pictures))

    def refresh(self) -> None:
        """Take what was drawn since."""
        if self._reservoir is None:
            if not (self.folder / "state.json").exists():
                return
            self._reservoir = Reservoir(self.folder)
            files = (self._reservoir.pictures, self._reservoir.labels)
            if self._device.type == "cpu":
                self.pictures, self.labels = (_read_only(part) for part in files)
            else:
                self.pictures, self.labels = (
                    torch.empty(part.shape, dtype=kind, device=self._device)
                    for part, kind in zip(files, (torch.uint8, torch.float16), strict=True)
                )
        drawn, capacity = self._reservoir.drawn, len(self.pictures)
        if self._device.type != "cpu":
            for index in range(max(self._taken, drawn - capacity), drawn):
                at = index % capacity
                self.pictures[at] = _read_only(self._reservoir.pictures[at]).to(self._device)
                self.labels[at] = _read_only(self._reservoir.labels[at]).to(self._device)
        self._taken = drawn


class Batches:
    """Random crops of drawn pictures and of rendered ones, turned and re-exposed a little.

    Args:
        drawn: reservoir of drawn pictures.
        rendered: reservoir of rendered ones, if any.
        device: that trains.
    """

    REFRESH_STEPS = 50  # between two looks at how much was drawn

    def __init__(self, drawn: Path, rendered: Path | None, device: torch.device) -> None:
        self._drawn = Pictures(drawn, device)
        self._rendered = None if rendered is None else Pictures(rendered, device)
        self._device = device
        self._turn = 0

    def draw(self, rng: np.random.Generator, crop: int, count: int) -> tuple[Tensor, Tensor]:
        """RGB (count, 3, crop, crop) in [0, 1] and CoC (count, crop / 4, crop / 4) [px].

        Args:
            rng: source of chance.
            crop: edge, a multiple of 32, at most SIZE [px].
            count: of the crops.

        Raises:
            FileNotFoundError: nothing is drawn yet.
        """
        if self._turn % self.REFRESH_STEPS == 0:
            for part in (self._drawn, self._rendered):
                if part is not None:
                    part.refresh()
        self._turn += 1
        if not self._drawn.count:
            raise FileNotFoundError(
                f"{self._drawn.folder}: no picture there; draw some with models.coc.data"
            )
        of_rendered = 0
        if self._rendered is not None and self._rendered.count:
            of_rendered = int(rng.binomial(count, RENDERED_SHARE))
        parts = [self._crops(rng, self._drawn, crop, count - of_rendered)]
        if self._rendered is not None and of_rendered:
            parts.append(self._crops(rng, self._rendered, crop, of_rendered))
        pictures, labels = (torch.cat(part) for part in zip(*parts, strict=True))
        return self._re_exposed(rng, pictures.permute(0, 3, 1, 2).float() / 255), labels.float()

    def _crops(
        self, rng: np.random.Generator, data: Pictures, crop: int, count: int
    ) -> tuple[Tensor, Tensor]:
        """Crops uint8 (count, crop, crop, 3) and their CoC (count, crop / 4, crop / 4) [px].

        Each in one of eight orientations.
        """
        places = rng.integers(0, (SIZE - crop) // LABEL_STEP + 1, (2, count))
        flips = rng.integers(2, size=(3, count))
        index = rng.integers(data.count, size=(1, count))
        drawn = self._on_device(np.concatenate([index, places, flips]))[..., None, None]
        index, above, left, transposed, upside_down, mirrored = drawn
        taken = []
        for part, step in ((data.pictures, LABEL_STEP), (data.labels, 1)):
            along = torch.arange(crop * step // LABEL_STEP, device=self._device)
            down, across = along[:, None], along[None, :]
            rows = torch.where(transposed > 0, across, down)
            columns = torch.where(transposed > 0, down, across)
            rows = torch.where(upside_down > 0, len(along) - 1 - rows, rows) + step * above
            columns = torch.where(mirrored > 0, len(along) - 1 - columns, columns) + step * left
            taken.append(part[index, rows, columns])
        return taken[0], taken[1]

    def _re_exposed(self, rng: np.random.Generator, rgb: Tensor) -> Tensor:
        """RGB (N, 3, h, w) in and out: a gain for each channel; on a third faint noise too."""
        count = len(rgb)
        gain = np.exp(rng.normal(0, GAIN_DEVIATION, (count, 3, 1, 1)))
        level = np.maximum(0, rng.normal(-0.5, 1, (count, 1, 1, 1))) / 255
        gain, level = (self._on_device(np.float32(part)) for part in (gain, level))
        generator = torch.Generator(self._device).manual_seed(int(rng.integers(2**31)))
        noise = torch.randn(rgb.shape, generator=generator, device=self._device)
        return (rgb * gain + level * noise).clamp(0, 1)

    def _on_device(self, part: np.ndarray) -> Tensor:
        """A tensor on the device; a GPU goes on working meanwhile."""
        return moved(torch.from_numpy(np.ascontiguousarray(part)), self._device)


def _read_only(part: np.ndarray) -> Tensor:
    """A tensor over a file that others write; it is only read, whatever torch warns of."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*not writable", UserWarning)
        return torch.from_numpy(part)


def moved(part: Tensor, device: torch.device) -> Tensor:
    """A tensor on the device; a GPU goes on working meanwhile."""
    return part if device.type == "cpu" else part.pin_memory().to(device, non_blocking=True)
