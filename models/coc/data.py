"""Defocused pictures with known CoC, drawn without end into a reservoir on disk.

python -m models.coc.data --photos FOLDER --out /tmp/coc_data --count 30000
python -m models.coc.data --photos FOLDER --sheet sheet.png
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.long_ground import draw_long_ground
from models.coc.scene import SIZE, draw_scene
from models.coc.textures import Photos

Float32 = npt.NDArray[np.float32]
LABEL_STEP = 4  # the network answers at a quarter of the size
HARD_SHARE = 0.55  # of the pictures show one long ground that is hard to read


def draw_picture(
    rng: np.random.Generator, photos: Photos, hard_share: float
) -> tuple[npt.NDArray[np.uint8], Float32]:
    """A picture uint8 (SIZE, SIZE, 3) and its unsigned CoC diameter (SIZE, SIZE) [px]."""
    if hard_share and rng.random() < hard_share:
        return draw_long_ground(rng, photos)
    return draw_scene(rng, photos)


def label(coc_px: Float32) -> Float32:
    """Unsigned CoC [px] at the network's output size: the mean over each cell, in log(1 + CoC)."""
    rows, columns = (n // LABEL_STEP for n in coc_px.shape)
    cells = np.log1p(coc_px).reshape(rows, LABEL_STEP, columns, LABEL_STEP)
    return np.expm1(cells.mean((1, 3))).astype(np.float32)


class Reservoir:
    """Pictures and labels in two memory-mapped files, a ring; readers see its count grow.

    Attributes:
        folder: where they lie.
        pictures: uint8 (capacity, SIZE, SIZE, 3).
        labels: CoC [px], float16 (capacity, SIZE / LABEL_STEP, SIZE / LABEL_STEP).
    """

    def __init__(self, folder: Path, capacity: int | None = None) -> None:
        self.folder = folder
        self._state = folder / "state.json"
        mode = "r" if capacity is None else "r+"
        if capacity is None:
            capacity = json.loads(self._state.read_text())["capacity"]
        side = SIZE // LABEL_STEP
        shapes = {"pictures": (capacity, SIZE, SIZE, 3), "labels": (capacity, side, side)}
        if mode == "r+" and not self._state.exists():
            folder.mkdir(parents=True, exist_ok=True)
            mode = "w+"
        self.pictures, self.labels = (
            np.memmap(folder / f"{name}.raw", dtype, mode, shape=shapes[name])
            for name, dtype in (("pictures", np.uint8), ("labels", np.float16))
        )
        if mode == "w+":
            self._write(0)

    def _write(self, drawn_so_far: int) -> None:
        state = {"capacity": len(self.pictures), "drawn": drawn_so_far}
        fresh = self._state.with_suffix(".new")
        fresh.write_text(json.dumps(state))
        fresh.replace(self._state)

    @property
    def drawn(self) -> int:
        """Pictures drawn since the start; beyond the capacity old ones were replaced."""
        return int(json.loads(self._state.read_text())["drawn"])

    def append(self, picture: npt.NDArray[np.uint8], coc_px: Float32) -> None:
        """Store one picture with its CoC [px] at full size."""
        index = self.drawn
        self.pictures[index % len(self.pictures)] = picture
        self.labels[index % len(self.labels)] = label(coc_px)
        self._write(index + 1)


def contact_sheet(
    seed: int, photos: Photos, hard_share: float, path: Path, columns: int = 8, rows: int = 4
) -> None:
    """Write pictures above their CoC (blue 0, red 64 px) for a look by eye."""
    strips = []
    for row in range(rows):
        pairs = []
        for column in range(columns):
            rng = np.random.default_rng([seed, row * columns + column])
            picture, coc = draw_picture(rng, photos, hard_share)
            shade = cv2.applyColorMap(np.uint8(np.minimum(coc * 4, 255)), cv2.COLORMAP_TURBO)
            pairs.append(np.vstack([picture[..., ::-1], cv2.resize(shade, None, fx=1, fy=0.5)]))
        strips.append(np.hstack(pairs))
    cv2.imwrite(str(path), np.vstack(strips))


def fill(
    reservoir: Reservoir,
    draw: Callable[[int], tuple[npt.NDArray[np.uint8], Float32]],
    count: int | None,
    workers: int = 1,
) -> None:
    """Append what `draw` makes of index after index; by one worker in their order.

    Args:
        reservoir: it is begun, or goes on.
        draw: picture and CoC [px] of an index.
        count: pictures that are drawn in all; None: without end.
        workers: processes that draw; several append in the order in which they are ready.
    """
    first, start = reservoir.drawn, time.time()
    if workers > 1:
        draw(first)  # compiles the scatter once, before there are processes
    processes = multiprocessing.get_context("fork")
    writing = processes.Lock()

    def work(turn: int) -> None:
        for index in itertools.count(first + turn, workers):
            if count is not None and index >= count:
                return
            picture, coc = draw(index)
            with writing:
                reservoir.append(picture, coc)
                if reservoir.drawn % 500 == 0:
                    print(f"{reservoir.drawn} pictures, {time.time() - start:.0f} s", flush=True)

    if workers == 1:
        work(0)
        return
    started = [processes.Process(target=work, args=(turn,)) for turn in range(workers)]
    for process in started:
        process.start()
    for process in started:
        process.join()
        if process.exitcode:
            raise RuntimeError(f"a process that draws ended with code {process.exitcode}")


def main() -> None:
    """Fill a reservoir, or write a contact sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=Path, required=True, help="folder with sharp/, kodak/, …")
    parser.add_argument("--held-out", action="store_true", help="use the held-out photographs")
    parser.add_argument("--out", type=Path, help="folder of the reservoir")
    parser.add_argument("--count", type=int, default=30000, help="pictures it holds")
    parser.add_argument("--endless", action="store_true", help="go on, replacing the oldest")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hard", type=float, default=HARD_SHARE, help="share of long grounds")
    parser.add_argument("--workers", type=int, default=1, help="processes that draw")
    parser.add_argument("--sheet", type=Path, help="write a contact sheet there and stop")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    photos = Photos.load(options.photos, held_out=options.held_out)
    if options.sheet:
        contact_sheet(options.seed, photos, options.hard, options.sheet)
        return
    fill(
        Reservoir(options.out, options.count),
        lambda index: draw_picture(
            np.random.default_rng([options.seed, index]), photos, options.hard
        ),
        None if options.endless else options.count,
        options.workers,
    )


if __name__ == "__main__":
    main()
