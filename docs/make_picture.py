"""Make docs/lens.jpg, the README's picture: plate, sharp composite, through the plate's lens.

python docs/make_picture.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import av
from PIL import Image, ImageDraw, ImageFont

from nlens_video.core.settings import (
    ObjectSettings,
    OutputSettings,
    Settings,
    SourceSettings,
)
from nlens_video.run.render import render

ROOT = Path(__file__).parents[1]
SHOTS = (
    ("in.mp4", "anim.glb", 12, (375, 70, 795, 350)),
    ("in2.mp4", "anim2.glb", 4, (60, 228, 480, 508)),
)
TITLES = ("plate", "sharp composite", "nlens-video")
GAP = 6


def frame_of(path: Path, index: int) -> Image.Image:
    """One decoded frame."""
    with av.open(str(path)) as container:
        for number, frame in enumerate(container.decode(video=0)):
            if number == index:
                return Image.fromarray(frame.to_ndarray(format="rgb24"))
    raise ValueError(f"{path} has no frame {index}")


def composite(plate: Path, glb: Path, index: int, effects: str) -> Image.Image:
    """One composited frame."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "frame.mkv"
        render(
            Settings(
                source=SourceSettings(spec=str(plate), frames=(index, index + 1)),
                scene=ObjectSettings(glb=glb),
                output=OutputSettings(spec=str(output), codec="ffv1"),
                effects=effects,
            )
        )
        return frame_of(output, 0)


def main() -> None:
    """Write the picture."""
    font = ImageFont.load_default(18)
    rows = []
    for plate, glb, index, crop in SHOTS:
        paths = ROOT / "samples" / plate, ROOT / "samples" / glb
        pictures = (
            frame_of(paths[0], index),
            composite(*paths, index, "none"),
            composite(*paths, index, "auto"),
        )
        rows.append([picture.crop(crop) for picture in pictures])
    width, height = rows[0][0].size
    sheet = Image.new("RGB", (3 * width + 2 * GAP, len(rows) * (height + GAP) - GAP), "white")
    for y, row in enumerate(rows):
        for x, picture in enumerate(row):
            sheet.paste(picture, (x * (width + GAP), y * (height + GAP)))
    draw = ImageDraw.Draw(sheet)
    for x, title in enumerate(TITLES):
        at = (x * (width + GAP) + 10, 8)
        draw.text(at, title, font=font, fill="white", stroke_width=2, stroke_fill="black")
    sheet.save(ROOT / "docs" / "lens.jpg", quality=90)


if __name__ == "__main__":
    main()
