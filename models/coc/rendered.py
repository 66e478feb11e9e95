"""Crops of rendered plates, photographed anew at every draw, for a reservoir beside the drawn one.

python -m models.coc.rendered --plates FOLDER --out /tmp/coc_rendered --count 1500 --seed 1

FOLDER holds a folder a plate with `bg.exr` (scene-linear) and `bg_coc.npy` (signed), as
`samples/truth` writes them. A second run on the same reservoir adds to it: it replaces the oldest
pictures once the ring is full, while a training may go on reading.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import OpenEXR

from models.coc.data import Reservoir
from models.coc.degrade import filmed, photographed
from models.coc.scene import MARGIN, SIZE

Float32 = npt.NDArray[np.float32]
FILMED_SHARE = 0.4  # of the crops; the others are photographed
CROP = SIZE + 2 * MARGIN  # what softens or moves a picture needs to see beyond its border [px]


@dataclass(frozen=True, slots=True)
class Plate:
    """A rendered picture and its truth, both mirrored beyond the border by MARGIN.

    Attributes:
        light: scene-linear light (H + 2 MARGIN, W + 2 MARGIN, 3).
        coc: unsigned CoC diameter, likewise [px].
    """

    light: Float32
    coc: Float32

    @classmethod
    def load(cls, folder: Path) -> Plate:
        """Read a plate's folder.

        Raises:
            ValueError: the plate is smaller than a crop, or its two files differ in size.
        """
        channels = OpenEXR.File(str(folder / "bg.exr")).channels()
        light = np.asarray(channels["RGB"].pixels, np.float32)
        coc = np.abs(np.load(folder / "bg_coc.npy").astype(np.float32))
        if light.shape[:2] != coc.shape or min(coc.shape) < SIZE:
            raise ValueError(
                f"{folder}: light {light.shape[:2]} and CoC {coc.shape}, "
                f"expected the same size, {SIZE} px or more each way"
            )
        return cls(mirrored(light), mirrored(coc))


def mirrored(part: Float32) -> Float32:
    """A picture with its mirror image beyond the border, MARGIN wide."""
    return np.asarray(cv2.copyMakeBorder(part, *[MARGIN] * 4, cv2.BORDER_REFLECT_101), np.float32)


def plate_folders(folder: Path) -> list[Path]:
    """Folders of finished plates, sorted."""
    found = (path.parent for path in folder.glob("*/bg_coc.npy"))
    return sorted(path for path in found if path.suffix != ".new" and (path / "bg.exr").exists())


def draw_crop(rng: np.random.Generator, plate: Plate) -> tuple[npt.NDArray[np.uint8], Float32]:
    """A degraded crop uint8 (SIZE, SIZE, 3) and its unsigned CoC diameter (SIZE, SIZE) [px]."""
    y, x = (int(rng.integers(0, n - CROP + 1)) for n in plate.coc.shape)
    window = np.s_[y : y + CROP, x : x + CROP]
    inner = np.s_[MARGIN : MARGIN + SIZE, MARGIN : MARGIN + SIZE]
    finish = filmed if rng.random() < FILMED_SHARE else photographed
    picture = finish(rng, np.ascontiguousarray(plate.light[window]))
    return picture[inner], plate.coc[window][inner]


def fill(reservoir: Reservoir, plates: list[Path], count: int, seed: int) -> None:
    """Append `count` crops, as many of each plate, in an order that mixes them."""
    turns = np.random.default_rng([seed, reservoir.drawn])
    order = np.concatenate(
        [turns.permutation(len(plates)) for _ in range(-(-count // len(plates)))]
    )
    loaded = [Plate.load(path) for path in plates]
    for which in order[:count]:
        rng = np.random.default_rng([seed, reservoir.drawn])
        reservoir.append(*draw_crop(rng, loaded[which]))


def main() -> None:
    """Fill a reservoir from a folder of plates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plates", type=Path, required=True, help="a folder a plate")
    parser.add_argument("--out", type=Path, required=True, help="folder of the reservoir")
    parser.add_argument("--count", type=int, default=1500, help="pictures to draw now")
    parser.add_argument("--capacity", type=int, default=1500, help="pictures a new one holds")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    plates = plate_folders(options.plates)
    if not plates:
        sys.exit(f"{options.plates}: no folder with bg.exr and bg_coc.npy; render some first")
    known = (options.out / "state.json").exists()
    capacity = Reservoir(options.out).pictures.shape[0] if known else options.capacity
    reservoir = Reservoir(options.out, capacity)
    fill(reservoir, plates, options.count, options.seed)
    print(f"{options.count} pictures of {len(plates)} plates; {reservoir.drawn} drawn so far")


if __name__ == "__main__":
    main()
