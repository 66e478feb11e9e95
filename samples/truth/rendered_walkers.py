"""Path-traced clips in which people walk about an object, and what the whole command makes of them.

PYTHONPATH=.:samples python -m truth.rendered_walkers --seed N --out DIR [--frames 40]
PYTHONPATH=.:samples python -m truth.rendered_walkers --out DIR --measure

Cycles renders the plate, and the same scene with the object in it: the lens, the light, the shadows
and the motion blur are the renderer's. `walkers.py` draws layers instead and asks what the matte
costs; here the composite is made from the GLB by defaults, so its errors of lens and light count
as well, where somebody walks before the object and where nobody does.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.cli.main import main as run
from nlens_video.evaluate.metrics import psnr_of_error
from truth import develop, subject
from truth.clip_file import read_clip_file, write_clip_file
from truth.make import run_blender
from truth.plan import WIDTH, View, draw_lens, draw_view
from truth.routes import kind

RATE = 15
CRF = 18
SEEN_BEFORE = 0.02
"""Share of the object that somebody must cover for a frame to count as one with him before it."""
MARGIN_PX = 24
"""Around the object's box, for its blur; of a plate WIDTH px wide."""
SAME_CODES = 1.0
"""Where truth and plate differ by less, the truth shows the plate, with its compression."""
Codes = npt.NDArray[np.uint8]


def write_clip(seed: int, frames: int, raw: Path, folder: Path) -> None:
    """Write bg.mp4, object.glb, gt/NNNN.png and params.json.

    Args:
        seed: names the clip.
        frames: of it.
        raw: what render_walkers.py left.
        folder: to be made.
    """
    (folder / "gt").mkdir(parents=True)
    view = draw_view(seed)
    body = subject.mesh(view)
    lens = draw_lens(view, "mid", subject.depths(view, body))
    level = develop.exposure(seed, develop.read_rgb(raw / "bg_0000.exr"))

    def codes(name: str) -> Codes:
        return develop.to_code(level * develop.read_rgb(raw / f"{name}.exr"))

    plates: Iterator[npt.NDArray[np.float64]] = (
        codes(f"bg_{frame:04d}") / 255.0 for frame in range(frames)
    )
    write_clip_file(folder / "bg.mp4", plates, RATE, crf=CRF)
    own = develop.read_depth(raw / "object_depth.exr")
    held = own < 0.5 * develop.NO_OBJECT_M
    hidden = []
    for frame, seen in enumerate(read_clip_file(folder / "bg.mp4")):
        plate, truth = codes(f"bg_{frame:04d}"), codes(f"gt_{frame:04d}")
        apart = np.abs(plate.astype(np.float32) - truth).max(2, keepdims=True)
        shown = cv2.blur((apart < SAME_CODES).astype(np.float32), (5, 5))[..., None]
        light = truth + shown * (255.0 * seen - plate)
        picture = np.uint8(np.clip(light + 0.5, 0, 255))
        cv2.imwrite(str(folder / f"gt/{frame:04d}.png"), picture[..., ::-1])
        nearer = develop.read_depth(raw / f"depth_{frame:04d}.exr") < own
        hidden.append(float((nearer & held).sum() / held.sum()))
    sun = json.loads((raw / "lights.json").read_text())
    develop.write_glb(view, body, sun, folder)
    size = held.shape
    described = {
        "resolution": [size[1], size[0]],
        "fps": RATE,
        "kind": kind(seed),
        "focus_distance_m": lens.focus_m,
        "coc_at_infinity_px": lens.coc_at_infinity_px * size[1] / WIDTH,
        "box": _box(view, size),
        "hidden_share": hidden,
    }
    (folder / "params.json").write_text(json.dumps(described, indent=1))


def _box(view: View, size: tuple[int, int]) -> list[int]:
    """Left, top, right and bottom of what the object covers, blurred [px]."""
    seen = view.project(subject.mesh(view).positions)[:, :2]
    scale = size[1] / WIDTH
    low = np.floor((seen.min(0) - MARGIN_PX) * scale).clip(0)
    high = np.ceil((seen.max(0) + MARGIN_PX) * scale).clip(0, [size[1], size[0]])
    return [int(at) for at in (*low, *high)]


def measure(folder: Path, *options: str) -> tuple[float, float]:
    """PSNR in the object's box, composited from the GLB by defaults, but at crf 4.

    Args:
        folder: of a clip.
        options: of the command, beside those.

    Returns:
        Of the frames in which somebody covers SEEN_BEFORE of the object or more, and of the others
        [dB]; NaN where there is no such frame.
    """
    told = json.loads((folder / "params.json").read_text())
    left, top, right, bottom = told["box"]
    errors: dict[bool, list[npt.NDArray[np.float64]]] = {True: [], False: []}
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / "out.mp4"
        if run([str(folder / "bg.mp4"), str(folder / "object.glb"), str(made), "-q",
                "--crf", "4", *options]):  # fmt: skip
            raise SystemExit(f"{folder}: not composited")
        for frame, codes in enumerate(read_clip_file(made)):
            truth = cv2.imread(str(folder / f"gt/{frame:04d}.png"))[..., ::-1].astype(np.float64)
            off = (255.0 * codes - truth)[top:bottom, left:right]
            errors[told["hidden_share"][frame] >= SEEN_BEFORE].append(off)
    before, elsewhere = (
        psnr_of_error(np.array(one)) if one else math.nan for one in errors.values()
    )
    return before, elsewhere


def main() -> None:
    """Render a clip, or measure those that are in DIR."""
    parser = argparse.ArgumentParser(
        prog="truth.rendered_walkers", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--seed", type=int, help="names the clip")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--samples", type=int, default=24, help="rays of a pixel")
    parser.add_argument("--percent", type=int, default=50, help="size of the picture")
    parser.add_argument("--measure", action="store_true", help="the clips that are in DIR")
    given, options = parser.parse_known_args()
    if given.measure:
        for folder in sorted(path.parent for path in given.out.glob("*/params.json")):
            before, elsewhere = measure(folder, *options)
            print(f"{folder.name}: {before:.2f} dB, elsewhere {elsewhere:.2f} dB", flush=True)
        return
    if given.seed is None or options:
        parser.error("--seed names a clip to render; other options go with --measure")
    folder = given.out / f"{given.seed}_{kind(given.seed)}"
    fresh = folder.with_name(folder.name + ".new")
    shutil.rmtree(fresh, ignore_errors=True)
    with tempfile.TemporaryDirectory() as name:
        job = {"seed": given.seed, "frames": given.frames, "percent": given.percent}
        run_blender(
            {**job, "samples": given.samples, "out": name}, threads=1, script="render_walkers.py"
        )
        write_clip(given.seed, given.frames, Path(name), fresh)
    shutil.rmtree(folder, ignore_errors=True)
    fresh.replace(folder)


if __name__ == "__main__":
    main()
