"""Objects naively composited over photographs, and what a sampled lens makes of them.

    python -m models.paper.data --photos PHOTOS --out /tmp/paper_data --count 600
    python -m models.paper.data --photos PHOTOS --out /tmp/paper_val --count 48 --held-out

The plate lies at its own blur, as the paper has it: its CoC is zero and it is not touched.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from models.coc.textures import Photos
from models.reblur.data import HELD_OUT_VIEWS, Reservoir
from models.reblur.lens import CROP, GRID, Float32, pinhole, through_lens
from models.reblur.shapes import CATEGORIES, draw_held_out, draw_object
from nlens_video.kernels.scatter.paper_scatter import paper_scatter

VIEWS = 64
PARTS = {"light": 3, "radius": 1, "dilated": 1, "classical": 3, "truth": 3}


def draw_maps(seed: int, index: int, photos: Photos, *, held_out: bool) -> dict[str, Float32]:
    """The maps of one composite, named by seed and index."""
    rng = np.random.default_rng([seed, index])
    if held_out:
        shapes = draw_held_out(rng, photos, CATEGORIES[index % len(CATEGORIES)])
    else:
        shapes = draw_object(rng, photos)
    if index % 2 and len(shapes) > 2:
        shapes = shapes[1:]  # often no wall behind: silhouettes over the plate
    rgba, coc = pinhole(shapes)
    plate = photos.crop(rng, GRID)
    blur = float(rng.choice([0.0, rng.uniform(0.5, 6.0)]))
    if blur:
        plate = cv2.GaussianBlur(plate, (0, 0), blur)
    light = rgba[..., :3] + (1.0 - rgba[..., 3:]) * plate
    radius = np.where(rgba[..., 3] > 0, 0.5 * coc, 0.0).astype(np.float32)
    classical, dilated = paper_scatter(light, np.abs(radius))
    edge = (GRID - CROP) // 2
    middle = (slice(edge, -edge), slice(edge, -edge))
    seen = through_lens(shapes, HELD_OUT_VIEWS if held_out else VIEWS)
    return {
        "light": light[middle],
        "radius": radius[middle][..., None],
        "dilated": dilated[middle][..., None],
        "classical": classical[middle],
        "truth": seen[..., :3] + (1.0 - seen[..., 3:]) * plate[middle],
    }


def main() -> None:
    """Fill a reservoir."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=Path, required=True, help="folder with sharp/, kodak/, …")
    parser.add_argument("--out", type=Path, required=True, help="folder of the reservoir")
    parser.add_argument("--count", type=int, default=600, help="composites it holds")
    parser.add_argument("--held-out", action="store_true", help="held-out shapes and photographs")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    photos = Photos.load(options.photos, held_out=options.held_out)
    reservoir = Reservoir(options.out, options.count, PARTS)
    start = time.time()
    for index in range(reservoir.drawn, options.count):
        reservoir.append(draw_maps(options.seed, index, photos, held_out=options.held_out))
        if index % 100 == 0:
            print(f"{index} composites, {time.time() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
