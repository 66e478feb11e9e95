"""Objects that hide parts of themselves, blurred by a sampled lens, with what the network reads.

    python -m models.reblur.data --photos PHOTOS --out /tmp/reblur_data --count 3000
    python -m models.reblur.data --photos PHOTOS --out /tmp/reblur_val --count 96 --held-out

Held-out objects go round the categories of `shapes.CATEGORIES`, so object i is of category i mod 4.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.textures import Photos
from models.reblur.lens import CROP, GRID, Float32, Shape, pinhole, through_lens
from models.reblur.shapes import CATEGORIES, draw_held_out, draw_object
from nlens_video.kernels.coc_discontinuities import find_discontinuities
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.stages.l_depth_order import CHANNELS, candidates, fade

VIEWS, HELD_OUT_VIEWS = 96, 256
LEAST_TOUCHED = 0.03  # share of the crop within reach of a step; other objects are drawn anew
PARTS = {
    "scattered": 4,
    "near": 4,
    "back": 4,
    "covariance": 4,
    "truth": 4,
    "geometry": CHANNELS,
    "where": 1,
}


class Reservoir:
    """Half-precision maps of each object in one memory-mapped file; readers see its count grow.

    Attributes:
        parts: name of each map and its channels.
        maps: (capacity, CROP, CROP, channels of all parts) float16.
    """

    def __init__(
        self, folder: Path, capacity: int | None = None, parts: Mapping[str, int] = PARTS
    ) -> None:
        self.parts = parts
        self._state = folder / "state.json"
        mode = "r" if capacity is None else "r+"
        if capacity is None:
            capacity = json.loads(self._state.read_text())["capacity"]
        if mode == "r+" and not self._state.exists():
            folder.mkdir(parents=True, exist_ok=True)
            mode = "w+"
        shape = (capacity, CROP, CROP, sum(parts.values()))
        self.maps = np.memmap(folder / "maps.raw", np.float16, mode, shape=shape)
        if mode == "w+":
            self._write(0)

    def _write(self, drawn: int) -> None:
        fresh = self._state.with_suffix(".new")
        fresh.write_text(json.dumps({"capacity": len(self.maps), "drawn": drawn}))
        fresh.replace(self._state)

    @property
    def drawn(self) -> int:
        """Objects drawn so far."""
        return int(json.loads(self._state.read_text())["drawn"])

    def append(self, maps: dict[str, Float32]) -> None:
        """Store one object's maps, (CROP, CROP, parts[name]) each."""
        index = self.drawn
        self.maps[index] = np.concatenate([maps[name] for name in self.parts], axis=2)
        self._write(index + 1)


def split_maps(
    maps: npt.NDArray[np.float16], parts: Mapping[str, int] = PARTS
) -> dict[str, Float32]:
    """Stored maps (..., channels of all parts) by name, single precision."""
    ends = np.cumsum(list(parts.values()))[:-1]
    pieces = np.split(maps.astype(np.float32), ends, axis=-1)
    return dict(zip(parts, pieces, strict=True))


def make_maps(shapes: list[Shape], views: int) -> dict[str, Float32] | None:
    """What the network reads and what is true; None where next to nothing is hidden."""
    rgba, coc = pinhole(shapes)
    steps = find_discontinuities(rgba, coc)
    if steps is None:
        return None
    edge = (GRID - CROP) // 2
    middle = (slice(edge, -edge), slice(edge, -edge))
    where = fade(steps.inside_px)[middle]
    if (where > 0).mean() < LEAST_TOUCHED:
        return None
    made = candidates((rgba, coc), scatter(rgba, coc), steps, scatter)
    return {
        "scattered": made.scattered[middle],
        "near": made.near[middle],
        "back": made.back[middle],
        "covariance": made.covariance[middle],
        "truth": through_lens(shapes, views),
        "geometry": made.geometry[middle],
        "where": where[..., None],
    }


def draw_maps(
    seed: int, index: int, photos: Photos, *, held_out: bool, views: int | None = None
) -> dict[str, Float32]:
    """The maps of one object, named by seed and index; the truth from so many views."""
    views = views or (HELD_OUT_VIEWS if held_out else VIEWS)
    for attempt in range(100):
        rng = np.random.default_rng([seed, index, attempt])
        if held_out:
            shapes = draw_held_out(rng, photos, CATEGORIES[index % len(CATEGORIES)])
        else:
            shapes = draw_object(rng, photos)
        maps = make_maps(shapes, views)
        if maps is not None:
            return maps
    raise RuntimeError(f"seed {seed}, object {index}: a hundred objects without a depth step")


def main() -> None:
    """Fill a reservoir."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=Path, required=True, help="folder with sharp/, kodak/, …")
    parser.add_argument("--out", type=Path, required=True, help="folder of the reservoir")
    parser.add_argument("--count", type=int, default=3000, help="objects it holds")
    parser.add_argument("--held-out", action="store_true", help="held-out shapes and photographs")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    photos = Photos.load(options.photos, held_out=options.held_out)
    reservoir = Reservoir(options.out, options.count)
    start = time.time()
    for index in range(reservoir.drawn, options.count):
        maps = draw_maps(options.seed, index, photos, held_out=options.held_out)
        reservoir.append(maps)
        if index % 100 == 0:
            print(f"{index} objects, {time.time() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
