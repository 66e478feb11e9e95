"""Examples for the lens network from rendered plates, photographed anew at every draw.

    PYTHONPATH=.:samples python -m truth.make --seed 9223 --camera hard --plates-only … --out PLATES
    python -m models.lens.rendered --plates PLATES --out /tmp/lens_rendered/1.npz

PLATES holds a folder a plate, as `samples/truth` writes them.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.degrade import filmed, photographed
from models.coc.rendered import CROP, Plate, plate_folders
from models.coc.scene import MARGIN, SIZE
from models.lens.data import readings_of
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene

FARTHEST = 0.3  # disparity, by that in the middle, beyond which no object is put
COUNT = 12  # crops of a plate


@dataclass(frozen=True, slots=True)
class View:
    """Camera and lens of a plate.

    Attributes:
        camera: in metres.
        ground_y: height of the ground [m].
        infinity_px: unsigned CoC diameter at infinity.
        focus_m: distance in focus.
    """

    camera: Camera
    ground_y: float
    infinity_px: float
    focus_m: float

    @classmethod
    def load(cls, folder: Path) -> View:
        """Read a plate's folder."""
        known = json.loads((folder / "params.json").read_text())
        camera = Scene.load(folder / "object.glb").camera(0.0, *known["resolution"])
        return cls(
            camera, known["ground_plane_y_gltf"], known["coc_at_infinity_px"],
            known["focus_distance_m"],
        )  # fmt: skip


def plane_of(view: View, middle: tuple[float, float]) -> tuple[float, ...] | None:
    """Numbers of a plate's ground and lens about a place of it [px], as in `Examples`.

    None where that place is no ground.
    """
    x, y = (np.array([at, at + 1.0]) for at in middle)
    disparity = view.camera.disparity_at(x, y, view.ground_y)
    at = float(disparity[0, 0])
    if at <= 0.0:
        return None
    slope = view.infinity_px * view.focus_m * at
    across, down = float(disparity[0, 1]) / at - 1.0, float(disparity[1, 0]) / at - 1.0
    return across, down, slope, slope - view.infinity_px, FARTHEST


def crops(
    folder: Path, rng: np.random.Generator
) -> Iterator[tuple[npt.NDArray[np.uint8], tuple[float, ...]]]:
    """Pictures (SIZE, SIZE, 3) of parts of a plate, half of them as footage, and their planes."""
    plate, view = Plate.load(folder), View.load(folder)
    for number in range(COUNT):
        top, left = (int(rng.integers(0, n - CROP + 1)) for n in plate.coc.shape)
        light = np.ascontiguousarray(plate.light[top : top + CROP, left : left + CROP])
        picture = (filmed, photographed)[number % 2](rng, light)
        plane = plane_of(view, (left + 0.5 * SIZE, top + 0.5 * SIZE))
        if plane is not None:
            yield picture[MARGIN : MARGIN + SIZE, MARGIN : MARGIN + SIZE], plane


def main() -> None:
    """Read all plates of a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plates", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True, help="the file")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    readings, planes = [], []
    with OnnxCocNetwork(find_model("coc").path) as network:
        for folder in plate_folders(options.plates):
            seed = int(folder.name.partition("_")[0])
            for picture, plane in crops(folder, np.random.default_rng([options.seed, seed])):
                readings.append(readings_of(network, picture))
                planes.append(plane)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    np.savez(options.out, readings=np.float16(readings), planes=np.float64(planes))
    print(f"{len(planes)} pictures")


if __name__ == "__main__":
    main()
