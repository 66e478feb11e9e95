"""Training pictures with a known sun, drawn by ray casting.

    python -m models.sun.data --photos DIR --out /tmp/sun/0.npz --first 0 --count 2000

`--photos` is a folder of photographs, crops of which are textures, drawn anew for each file. A seed
and the textures name a picture.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.sun.ground import Texture, draw_ground, load_textures
from models.sun.render import render
from models.sun.scene import Scene, draw_scene
from nlens_video.scene.plate_sun import BRIGHT_PERCENTILE, COLUMNS, ROWS

TEXTURES = 400
BRIGHTEST = 4.0
"""Light that is kept, by the percentile that pictures are scaled by."""


@dataclass(frozen=True, slots=True)
class Examples:
    """Pictures and what lights them.

    Attributes:
        pictures: 255 times the root of light, by BRIGHTEST times what pictures are scaled by
            (N, ROWS, COLUMNS, 3).
        labels: shares of shaded ground and of things, 255 for all (N, ROWS / 4, COLUMNS / 4, 2).
        cameras: pitch, roll, horizontal field of view [rad], aspect (N, 4).
        suns: azimuth from the view to the right, elevation [rad], share of the light that its
            shadow leaves [1]; NaN without a sun (N, 3).
    """

    pictures: npt.NDArray[np.uint8]
    labels: npt.NDArray[np.uint8]
    cameras: npt.NDArray[np.float32]
    suns: npt.NDArray[np.float32]

    @classmethod
    def load(cls, folder: Path) -> Examples:
        """Read the files that `main` wrote into a folder."""
        files = [np.load(path) for path in sorted(folder.glob("*.npz"))]
        return cls(*(np.concatenate([one[name] for one in files]) for name in cls.__slots__))


def draw_example(
    seed: int, textures: list[Texture]
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8], Scene]:
    """A picture, its labels and its scene."""
    rng = np.random.default_rng([seed, 41])
    scene = draw_scene(rng)
    ground = draw_ground(rng, textures)
    picture, labels = render(scene, ground, textures, rng, COLUMNS, ROWS)
    bright = max(float(np.percentile(picture.mean(axis=2), BRIGHT_PERCENTILE)), 1e-6)
    code = np.sqrt(np.minimum(picture / (BRIGHTEST * bright), 1.0))
    return np.uint8(255.0 * code + 0.5), np.uint8(255.0 * labels + 0.5), scene


def sun_of(scene: Scene) -> tuple[float, float, float]:
    """Azimuth, elevation and share left of a scene's sun; NaN without one."""
    toward = scene.light.toward
    if toward is None:
        return math.nan, math.nan, math.nan
    return math.atan2(toward[0], -toward[2]), math.asin(toward[1]), scene.light.left


def photographs(folder: Path) -> list[npt.NDArray[np.uint8]]:
    """The pictures of a folder, RGB, at most 1000 columns wide."""
    found = []
    for path in sorted([*folder.glob("*.png"), *folder.glob("*.jpg")]):
        picture = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        shrink = max(picture.shape[1] / 1000.0, 1.0)
        size = round(picture.shape[1] / shrink), round(picture.shape[0] / shrink)
        found.append(np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA)))
    return found


def main() -> None:
    """Draw pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=10000)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng([options.first, 40])
    textures = load_textures(rng, photographs(options.photos), TEXTURES)
    drawn = [draw_example(options.first + k, textures) for k in range(options.count)]
    cameras = [(s.camera.pitch, s.camera.roll, s.camera.fov, s.camera.aspect) for *_, s in drawn]
    np.savez(
        options.out,
        pictures=np.stack([picture for picture, _, _ in drawn]),
        labels=np.stack([labels for _, labels, _ in drawn]),
        cameras=np.float32(cameras),
        suns=np.float32([sun_of(scene) for *_, scene in drawn]),
    )
    print(f"{options.count} pictures")


if __name__ == "__main__":
    main()
