"""Composite the same shots by two checkouts, for a look at what changed between them.

python docs/make_pairs.py FOLDER SHOTS BEFORE AFTER

SHOTS is a text file with the arguments of a run on each line but for its output, such as
`plate.jpg fox.glb --at 0.4,0.8 | --size 0.35`; only BEFORE gets what follows a bar, for a version
that asks for more. BEFORE and AFTER are folders of checkouts. For each shot FOLDER gets a picture,
the plate, before and after beside each other, whole and around the object, and a text of what both
runs printed. It is to be kept out of the repository, as `runs/` is.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import av
import cv2
import numpy as np

from nlens_video.core.layers import UInt8

WIDTH = 640
_MARGIN = 0.25  # of the object's size, around it [1]
_CHANGED = 6.0  # code values by which what an object changes differs from compression


def composite(tree: Path, arguments: list[str], output: Path) -> str:
    """Run one shot by a checkout; what it printed."""
    files = [str(Path(name).resolve()) for name in (*arguments[:2], output)]
    command = [sys.executable, "-m", "nlens_video", *files, *arguments[2:], "-y", "--no-progress"]
    environment = {**os.environ, "PYTHONPATH": str(tree.resolve())}
    done = subprocess.run(
        command, cwd=tree, env=environment, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return done.stdout


def middle_frame(path: Path, first: int, last: int | None) -> tuple[UInt8, int]:
    """The frame in the middle of a range of a file (h, w, 3) in code values, and their number."""
    with av.open(str(path)) as container:
        frames = [
            frame.to_ndarray(format="rgb24")
            for number, frame in enumerate(container.decode(video=0))
            if number >= first and (last is None or number < last)
        ]
    return frames[len(frames) // 2], len(frames)


def around(pictures: list[UInt8]) -> tuple[slice, slice]:
    """Rows and columns that show what differs from the first of the pictures."""
    height, width = pictures[0].shape[:2]
    light = [cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 2.0) for picture in pictures]
    changed = np.max([np.abs(other - light[0]).max(axis=2) for other in light[1:]], axis=0)
    rows, columns = np.nonzero(changed > _CHANGED)
    if not len(rows):
        return slice(0, height), slice(0, width)
    top, bottom, left, right = rows.min(), rows.max(), columns.min(), columns.max()
    more = int(_MARGIN * max(bottom - top, right - left))
    return (
        slice(max(top - more, 0), min(bottom + more, height)),
        slice(max(left - more, 0), min(right + more, width)),
    )


def beside(pictures: list[UInt8]) -> UInt8:
    """Pictures of one size beside each other, each `WIDTH` wide."""
    height, width = pictures[0].shape[:2]
    size = WIDTH, round(WIDTH * height / width)
    way = cv2.INTER_AREA if width > WIDTH else cv2.INTER_CUBIC
    return np.hstack([cv2.resize(picture, size, interpolation=way) for picture in pictures])


def pair(folder: Path, shot: str, trees: list[Path]) -> None:
    """Write the picture and the words of one shot, a line of the list of shots."""
    arguments, more = (shlex.split(part) for part in (*shot.split("|"), "")[:2])
    plate, animation = Path(arguments[0]), Path(arguments[1])
    name = f"{plate.stem}-{animation.stem}"
    frames, words, first, count = [], [], 0, 1
    if "--range" in arguments:
        first = int(arguments[arguments.index("--range") + 1].split(":")[0])
    for number, tree in enumerate(trees):
        output = folder / f"{name}-{number}{'.png' if plate.suffix in {'.png', '.jpg'} else '.mp4'}"
        output.unlink(missing_ok=True)
        words += [f"# {tree}", composite(tree, arguments + (more if number == 0 else []), output)]
        if output.exists():
            frame, count = middle_frame(output, 0, None)
            frames.append(frame)
    (folder / f"{name}.txt").write_text("\n".join(words), encoding="utf-8")
    if not frames:
        return
    frames.insert(0, middle_frame(plate, first, first + count)[0])
    rows, columns = around(frames)
    picture = np.vstack([beside(frames), beside([frame[rows, columns] for frame in frames])])
    cv2.imwrite(str(folder / f"{name}.png"), picture[..., ::-1])


def main() -> None:
    """Composite all shots."""
    if len(sys.argv) != 5:
        raise SystemExit(__doc__)
    folder, shots = Path(sys.argv[1]), Path(sys.argv[2]).read_text(encoding="utf-8")
    folder.mkdir(parents=True, exist_ok=True)
    for line in filter(None, shots.splitlines()):
        pair(folder, line, [Path(tree) for tree in sys.argv[3:]])


if __name__ == "__main__":
    main()
