"""Clips in which the focus is pulled, through a sampled lens that is known on every frame.

PYTHONPATH=.:samples python -m truth.pulls --out DIR [--clips 8] [--frames 36] [--first 0]
PYTHONPATH=.:samples python -m truth.pulls --out DIR --measure

With `--measure` the lens of each clip in DIR is followed, and its error printed.

A camera at rest looks down on a textured ground with upright cards and a wall behind. Pinhole views
from points all over the aperture are averaged, shifted so that what is in focus stays in place: the
blur of each depth, also at edges, is that of the thin lens. Where a lens breathes, the picture
grows or shrinks with the focus. Grain and H.264 at crf 18 come last. A seed names a clip.

Each folder of DIR holds `bg.mp4`, `object.glb` (a box on the ground and the camera of the first
frame) and `params.json`: slope [px m] and intercept [px] of the lens of each frame, and the size of
the picture by that of the first frame.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.cli.main import main as run
from nlens_video.core.color import transfer
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.glb_writer import GlbWriter
from nlens_video.stages.r_lens_track import FitTrack
from truth.box_glb import add_box, add_lens
from truth.clip_file import write_clip_file

Array = npt.NDArray[np.float32]
Codes = npt.NDArray[np.uint8]
Points = npt.NDArray[np.float64]
WIDTH, HEIGHT, RATE = 960, 512, 24
VIEWS = 128
_CODED = transfer("iec61966-2-1").to_coded
_TO_LIGHT = transfer("iec61966-2-1").to_linear(np.arange(256, dtype=np.float32) / 255)
_FINE = 2  # samples of a pixel, each way
_TILE = 3072  # texels of a texture, each way
_BAND = 1.35  # from one band of the ground to the next, by depth
PATHS = ("smooth", "rests", "accelerates", "linear", "rack", "returns", "decelerates", "steps")
BREATHING = (0.0, 2.5, 0.0, 1.0, 0.0, -1.5, 0.0, 0.0)
"""By the seed: growth of the picture by that of a lens that moves as a whole."""


def path_of(name: str, frames: int) -> Points:
    """How far the focus has come on each frame, 0 at its start and 1 at its end [1]."""
    part = np.linspace(0.0, 1.0, frames)
    ease = {
        "smooth": (0.0, 1.0), "rests": (0.25, 0.75), "rack": (0.4, 0.6), "returns": (0.0, 0.5),
    }  # fmt: skip
    if name in ease:
        first, last = ease[name]
        share = np.clip((part - first) / (last - first), 0.0, 2.0 if name == "returns" else 1.0)
        return np.asarray(0.5 - 0.5 * np.cos(math.pi * share))
    if name == "steps":
        first, second = (np.clip((part - at) / 0.2, 0.0, 1.0) for at in (0.2, 0.6))
        return np.asarray(0.5 - 0.25 * np.cos(math.pi * first) - 0.25 * np.cos(math.pi * second))
    whole = {"accelerates": part**2, "linear": part, "decelerates": part * (2 - part)}
    return np.asarray(whole[name])


class Pull:
    """A clip of a seed: its camera, its lens on every frame, what stands in view."""

    def __init__(self, seed: int, frames: int) -> None:
        self.draw = draw = np.random.default_rng([seed, 7])
        self.path = PATHS[seed % len(PATHS)]
        focal_mm = float(draw.choice([28, 35, 50, 85]))
        self.focal = WIDTH * focal_mm / 36
        away = float(draw.uniform(1.4, 2.6)) * (focal_mm / 50) ** 0.7
        self.pitch = math.radians(float(draw.uniform(12, 28)))
        self.eye = away * math.tan(self.pitch + math.radians(float(draw.uniform(1, 4))))
        self.size = 0.16 * away * (50 / focal_mm)
        self.place = (float(draw.uniform(-0.12, 0.12)) * away, away)
        self.object_depth = away * math.cos(self.pitch) + self.eye * math.sin(self.pitch)
        near = float(draw.uniform(0.9, 1.15)) / self.object_depth
        far = float(draw.choice([draw.uniform(0.3, 0.65), draw.uniform(1.4, 1.9)]))
        ends = [near, far / self.object_depth]
        if draw.random() < 0.5:
            ends.reverse()
        focus = ends[0] + (ends[1] - ends[0]) * path_of(self.path, frames)
        largest = np.abs(1 / self.object_depth - focus).max()
        slope = float(draw.uniform(8, 20)) / largest
        self.aperture = min(slope / self.focal, 1e-3 * focal_mm / 1.4)
        slope = self.aperture * self.focal
        growth = BREATHING[seed % len(BREATHING)]
        image = 1 / (1 - np.minimum(1e-3 * focal_mm * focus, 0.5))  # by the focal length
        self.sizes = (image / image[0]) ** growth
        self.focus, self.slope = focus, slope
        self.grain = float(draw.uniform(0.5, 2.0))
        self.cards = list(self._cards())

    def _cards(self) -> Iterator[tuple[Codes, Points]]:
        """Textures with the places of their corners, from the farthest to the nearest."""
        draw, (_, away) = self.draw, self.place
        wall = float(draw.uniform(3.0, 6.0)) * away
        pixel = wall / self.focal
        yield self._surface(2 * wall, wall, pixel, pixel), _upright(0.0, wall, 2 * wall, wall)
        tile = texture(draw, _TILE)
        nearest = 0.35 * away
        base = nearest / self.focal  # [m] of a texel
        depth = wall
        while depth > nearest:
            near = depth / _BAND
            width = 1.6 * depth * WIDTH / self.focal + 0.5
            fine = max(near / self.focal, base), max(near * near / self.focal / self.eye, base)
            card = _tiled(tile, base, width, near, depth, fine)
            half = width / 2
            corners = [(-half, 0, depth), (half, 0, depth), (half, 0, near), (-half, 0, near)]
            yield card, np.array(corners, np.float64)
            depth = near
        for at in sorted(draw.uniform(0.9, 2.6, 5) * away, reverse=True):
            side = float(draw.choice([-1, 1])) * float(draw.uniform(0.18, 0.42))
            side *= at * WIDTH / self.focal
            wide, tall = (float(size) * away for size in draw.uniform(0.1, 0.35, 2))
            fine = at / self.focal
            yield self._surface(wide, tall, fine, fine), _upright(side, at, wide, tall)

    def _surface(self, wide: float, tall: float, across: float, down: float) -> Codes:
        size = max(8, min(2048, round(wide / across))), max(8, min(2048, round(tall / down)))
        return np.asarray(texture(self.draw, max(size))[: size[1], : size[0]])

    def view(self, right: float, up: float, margin: int) -> Array:
        """The scene from a point of the aperture, wider by a margin [px], two samples a pixel."""
        width, height = WIDTH + 2 * margin, HEIGHT + 2 * margin
        seen = np.full((height * _FINE, width * _FINE, 3), 150, np.uint8)
        for card, corners in self.cards:
            x, y, depth = self._to_camera(corners)
            columns = width / 2 + self.focal * (x - right) / depth
            rows = height / 2 - self.focal * (y - up) / depth
            flat = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * card.shape[1::-1]
            corner = np.stack([columns, rows], axis=1) * _FINE
            matrix = cv2.getPerspectiveTransform(np.float32(flat), np.float32(corner))
            cv2.warpPerspective(
                card, matrix, seen.shape[1::-1], dst=seen, borderMode=cv2.BORDER_TRANSPARENT
            )
        return np.asarray(_TO_LIGHT[seen], np.float32)

    def _to_camera(self, points: Points) -> Points:
        """Right, up and ahead (3, N) of points (N, 3): x right, y up, z away [m]."""
        x, y, z = points[:, 0], points[:, 1] - self.eye, points[:, 2]
        sine, cosine = math.sin(self.pitch), math.cos(self.pitch)
        return np.stack([x, y * cosine + z * sine, z * cosine - y * sine])

    def frames(self) -> Iterator[Array]:
        """All frames behind the lens, in linear light (H, W, 3)."""
        spare = math.ceil(0.5 * WIDTH * (1 / float(self.sizes.min()) - 1)) + 2
        width, height = WIDTH + 2 * spare, HEIGHT + 2 * spare
        mean = np.zeros((len(self.focus), height, width, 3), np.float32)
        margin = spare + math.ceil(0.5 * self.slope * float(self.focus.max())) + 2
        step = np.arange(VIEWS) + 0.5
        radius, angle = 0.5 * self.aperture * np.sqrt(step / VIEWS), step * math.pi * (3 - 5**0.5)
        for right, up in zip(radius * np.cos(angle), radius * np.sin(angle), strict=True):
            view = self.view(float(right), float(up), margin)
            halves = {(y, x): _reduced(view[y:, x:]) for y in (0, 1) for x in (0, 1)}
            for index, focus in enumerate(self.focus):
                # what is in focus stays: to half a pixel, a blur of less than 0.6 px of diameter
                shift = self.focal * focus * np.array([up, -right])
                at = np.round(_FINE * (margin - spare + shift)).astype(int)
                (y, x), (down, across) = at // _FINE, at % _FINE
                mean[index] += halves[down, across][y : y + height, x : x + width]
        for light, size in zip(mean, self.sizes.tolist(), strict=True):
            middle = np.array([WIDTH, HEIGHT]) / 2 - 0.5
            moved = middle - size * (middle + spare)
            matrix = np.array([[size, 0, moved[0]], [0, size, moved[1]]])
            frame = cv2.warpAffine(light / VIEWS, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
            yield np.asarray(np.maximum(frame, 0), np.float32)

    def lens(self) -> list[dict[str, float]]:
        """The truth of each frame."""
        return [
            {"slope": size * self.slope, "intercept": -size * self.slope * focus, "size": size}
            for focus, size in zip(self.focus.tolist(), self.sizes.tolist(), strict=True)
        ]


def _reduced(fine: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Pixels of two by two samples."""
    height, width = (side // _FINE * _FINE for side in fine.shape[:2])
    size = width // _FINE, height // _FINE
    return np.asarray(cv2.resize(fine[:height, :width], size, interpolation=cv2.INTER_AREA))


def texture(draw: np.random.Generator, side: int) -> Codes:
    """A square of leaves and grain of all sizes, sharp to the texel, code values."""
    tones = np.full((side, side, 3), draw.uniform(90, 130, 3), np.float32)
    size, part = 3, 26.0
    while size < side:
        octave = draw.normal(0, part, (size, size, 1)).repeat(3, axis=2)
        octave += draw.normal(0, 0.15 * part, (size, size, 3))
        whole = cv2.resize(octave, (side, side), interpolation=cv2.INTER_NEAREST)
        tones += whole.astype(np.float32)
        size, part = 2 * size + 1, 0.88 * part
    picture = np.asarray(np.clip(tones, 8, 247), np.uint8)
    for _ in range(side):
        radius = min(4 / math.sqrt(draw.random() + 1e-9), side / 10)
        place, colour = draw.integers(0, side, 2).tolist(), draw.integers(25, 225)
        tone = np.clip(colour + draw.normal(0, 12, 3), 5, 250).tolist()
        axes = max(1, round(radius)), max(1, round(radius * draw.uniform(0.3, 1)))
        cv2.ellipse(picture, place, axes, float(draw.uniform(0, 180)), 0, 360, tone, -1)
    return picture


def _tiled(
    tile: Codes, base: float, width: float, near: float, far: float, fine: tuple[float, float]
) -> Codes:
    """A band of the ground from a tile that is mirrored at its ends, reduced to texels [m]."""
    while 2 * base <= min(fine) and len(tile) > 64:  # coarse ground from a coarse tile
        tile, base = _reduced(tile), 2 * base
    ends, side = ((-width / 2, width / 2), (near, far)), len(tile)
    columns, rows = (np.arange(round(a / base), round(b / base)) % (2 * side) for a, b in ends)
    columns, rows = (np.where(at < side, at, 2 * side - 1 - at) for at in (columns, rows[::-1]))
    size = max(2, round(width / fine[0])), max(2, round((far - near) / fine[1]))
    return np.asarray(cv2.resize(tile[np.ix_(rows, columns)], size, interpolation=cv2.INTER_AREA))


def _upright(x: float, z: float, wide: float, tall: float) -> Points:
    left, right = x - wide / 2, x + wide / 2
    return np.array([(left, tall, z), (right, tall, z), (right, 0, z), (left, 0, z)], np.float64)


def write_clip(folder: Path, pull: Pull) -> None:
    """Write plate, object and truth."""
    folder.mkdir(parents=True, exist_ok=True)
    codes = (
        _CODED(light) + pull.draw.normal(0, pull.grain / 255, light.shape).astype(np.float32)
        for light in pull.frames()
    )
    write_clip_file(folder / "bg.mp4", codes, RATE, crf=18)
    write_glb(folder / "object.glb", pull)
    described = {
        "resolution": [WIDTH, HEIGHT], "fps": RATE, "path": pull.path,
        "object_depth_m": pull.object_depth, "frames": pull.lens(),
    }  # fmt: skip
    (folder / "params.json").write_text(json.dumps(described, indent=1))


def write_glb(path: Path, pull: Pull) -> None:
    """The object as a box, and the camera of the first frame."""
    writer = GlbWriter()
    add_box(writer, pull.place, (pull.size, pull.size, pull.size))
    camera = add_lens(writer, pull.focal, HEIGHT)
    half_turn = -pull.pitch / 2
    turn = [math.sin(half_turn), 0.0, 0.0, math.cos(half_turn)]
    writer.node(camera=camera, translation=[0.0, pull.eye, 0.0], rotation=turn)
    writer.write(path)


def measure(folder: Path) -> Points:
    """Errors of the object's CoC on each frame (N,) [px], with the lens that `fit` follows."""
    described = json.loads((folder / "params.json").read_text())
    with tempfile.TemporaryDirectory() as scratch:
        found = Path(scratch) / "fit.json"
        command = ["fit", str(folder / "bg.mp4"), str(folder / "object.glb"), str(found), "-q"]
        if run(command):
            raise SystemExit(f"{folder}: the lens is not found")
        track, fit = FitTrack.load(found), LensFit.load(found)
    disparity = 1 / described["object_depth_m"]
    off = []
    for index, truth in enumerate(described["frames"]):
        lens = fit if track is None else track.at(index)
        coc_px = lens.slope * disparity + lens.intercept
        off.append(coc_px - truth["slope"] * disparity - truth["intercept"])
    return np.array(off)


def main() -> None:
    """Write the clips, or measure them."""
    parser = argparse.ArgumentParser(prog="truth.pulls", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--clips", type=int, default=len(PATHS))
    parser.add_argument("--first", type=int, default=0, help="seed of the first clip")
    parser.add_argument("--frames", type=int, default=36)
    parser.add_argument("--measure", action="store_true", help="the clips that are in DIR")
    given = parser.parse_args()
    if given.measure:
        for folder in sorted(path.parent for path in given.out.glob("*/params.json")):
            off = np.abs(measure(folder))
            print(f"{folder.name}: mean {off.mean():.2f} px, worst {off.max():.2f} px", flush=True)
        return
    for seed in range(given.first, given.first + given.clips):
        pull = Pull(seed, given.frames)
        write_clip(given.out / f"{seed:02d}_{pull.path}", pull)


if __name__ == "__main__":
    main()
