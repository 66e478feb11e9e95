"""Examples for the lens network: what F reads on drawn grounds, and the lens of each.

    python -m models.lens.data --photos PHOTOS --out /tmp/lens/1 --seed 1 --minutes 50

Each ground is photographed `FINISHES` times, in turn by a plain camera and as footage, and read by
the shipped F. A seed names a ground; those of other seeds are held out.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.degrade import filmed, photographed
from models.coc.long_ground import GroundPlane, draw_ground_light
from models.coc.scene import MARGIN, SIZE
from models.coc.textures import Photos
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork
from nlens_video.stages.whole_ground.patches import patch_readings, reading_cells

Float32 = npt.NDArray[np.float32]
FINISHES = 3
HARD_SHARE = 0.75  # of the grounds have a surface that is hard to read
FILE = 300  # examples of a file


@dataclass(frozen=True, slots=True)
class Examples:
    """Pictures as F reads them, and their lenses.

    Attributes:
        readings: of the patches of each (N, rows, columns, READINGS).
        planes: gradient of the ground's disparity, which is 1 in the middle, along columns and
            rows [1 / px], slope and signed CoC in the middle [px], disparity of the ground's far
            end (N, 5).
        rendered: how many at the end are of rendered plates.
    """

    readings: npt.NDArray[np.float16]
    planes: npt.NDArray[np.float64]
    rendered: int = 0

    @classmethod
    def load(cls, folder: Path) -> Examples:
        """Read the files that `main` wrote into a folder."""
        files = [np.load(path) for path in sorted(folder.rglob("*.npz"))]
        return cls(*(np.concatenate([one[n] for one in files]) for n in ("readings", "planes")))

    def with_rendered(self, other: Examples) -> Examples:
        """These and others of rendered plates."""
        return Examples(
            readings=np.concatenate([self.readings, other.readings]),
            planes=np.concatenate([self.planes, other.planes]),
            rendered=len(other.planes),
        )


def numbers_of(plane: GroundPlane) -> tuple[float, ...]:
    """The numbers of a plane and its lens, as in `Examples`."""
    return (*plane.gradient, plane.layout.slope, plane.layout.offset, plane.end)


def draw_pictures(
    rng: np.random.Generator, photos: Photos
) -> tuple[list[npt.NDArray[np.uint8]], GroundPlane]:
    """Pictures (SIZE, SIZE, 3) of one ground."""
    ground = draw_ground_light(rng, photos, HARD_SHARE)
    inner = slice(MARGIN, MARGIN + SIZE)
    ways = (filmed, photographed) if rng.random() < 0.5 else (photographed, filmed)
    finishes = (ways[number % 2] for number in range(FINISHES))
    return [finish(rng, ground.light)[inner, inner] for finish in finishes], ground.plane


def readings_of(network: OnnxCocNetwork, picture: npt.NDArray[np.uint8]) -> Float32:
    """What F reads in the patches of a picture (SIZE, SIZE, 3): (rows, columns, READINGS)."""
    cells = reading_cells(network(np.float32(picture) / np.float32(255)), picture.shape[1])
    assert cells is not None
    return patch_readings(cells)


def main() -> None:
    """Draw examples until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--held-out", action="store_true", help="use the held-out photographs")
    parser.add_argument("--out", type=Path, required=True, help="folder of the files")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=50.0)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    photos = Photos.load(options.photos, held_out=options.held_out)
    options.out.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + 60.0 * options.minutes
    number = written = 0
    with OnnxCocNetwork(find_model("coc").path) as network:
        while time.monotonic() < end:
            readings: list[Float32] = []
            planes: list[tuple[float, ...]] = []
            while len(planes) < FILE:
                rng = np.random.default_rng([options.seed, number])
                pictures, plane = draw_pictures(rng, photos)
                number += 1
                if plane.layout.offset >= plane.layout.slope:
                    continue  # focused beyond infinity
                for picture in pictures:
                    readings.append(readings_of(network, picture))
                    planes.append(numbers_of(plane))
            np.savez(
                options.out / f"{written}.npz", readings=np.float16(readings),
                planes=np.float64(planes),
            )  # fmt: skip
            written += 1
            print(f"{written * FILE} pictures", flush=True)


if __name__ == "__main__":
    main()
