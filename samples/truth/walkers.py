"""Clips in which people walk before, behind and past an object, with the true composite.

PYTHONPATH=.:samples python -m truth.walkers --out DIR [--clips 14] [--frames 60] [--first 0]

Textured planes, figures of limbs and a flat object are drawn in linear light, each blurred by the
lens at its own depth; a folder of DIR holds what `nlens-video evaluate occlusion` reads. Figures
are smeared over half of a frame and cast a shadow; grain and drift of the exposure come before
H.264 at crf 20. The true composite has the grain and compression of the plate wherever it shows the
plate: a composite leaves those pixels as they are. A seed names a clip.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.color import transfer
from nlens_video.evaluate.bench.glb_writer import GlbWriter
from nlens_video.video.exr import write_layers
from truth.figures import OBJECT_SIZE, PX_PER_M, Look, draw_figure, draw_object

Array = npt.NDArray[np.float32]
WIDTH, HEIGHT, RATE = 640, 360, 25
_CODED = transfer("iec61966-2-1").to_coded
_LINEAR = transfer("iec61966-2-1").to_linear
KINDS = ("before", "behind", "past", "before", "behind", "both", "past")
_FOCAL, _EYE = WIDTH / 2 / math.tan(math.radians(30)), 1.6
_PITCH, _WALL = math.radians(12), 14.0
_FINE = 2  # samples of a pixel, each way
_SMEAR = np.array([-0.25, -0.08, 0.08, 0.25])  # moments of the open shutter [frame]


def project(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Columns and rows (n, 2) of points (n, 3): x right, y up, z away from the camera [m]."""
    x, y, z = np.asarray(points, float).T
    up = y - _EYE
    depth = z * math.cos(_PITCH) - up * math.sin(_PITCH)
    rise = up * math.cos(_PITCH) + z * math.sin(_PITCH)
    return np.stack([WIDTH / 2 + _FOCAL * x / depth, HEIGHT / 2 - _FOCAL * rise / depth], axis=1)


def axis_depth(y: float, z: float) -> float:
    """Depth along the optical axis [m]."""
    return z * math.cos(_PITCH) - (y - _EYE) * math.sin(_PITCH)


def warped(card: Array, corners: npt.ArrayLike) -> Array:
    """A card (h, w, c) with its corners (4, 3) in the world, as a pinhole sees it (H, W, c)."""
    height, width = card.shape[:2]
    flat = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = project(corners).astype(np.float32) * _FINE
    matrix = cv2.getPerspectiveTransform(flat, seen)
    fine = cv2.warpPerspective(card, matrix, (WIDTH * _FINE, HEIGHT * _FINE))
    return np.asarray(cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), np.float32)


def disc(diameter: float) -> Array:
    """A disc of a diameter [px] with soft pixels at its edge; its sum is 1."""
    reach = math.ceil(diameter / 2 + 0.5)
    at = np.arange(-reach, reach + 1)
    away = np.hypot(*np.meshgrid(at, at))
    kernel = np.clip(diameter / 2 + 0.5 - away, 0, 1) if diameter > 1 else (away == 0) * 1.0
    return np.asarray(kernel / kernel.sum(), np.float32)


def blurred(picture: Array, diameter: float) -> Array:
    """A picture (H, W, c) behind a lens that gives it one circle of confusion [px]."""
    return np.asarray(
        cv2.filter2D(picture, -1, disc(abs(diameter)), borderType=cv2.BORDER_REPLICATE)
    )


def over(layer: Array, below: Array) -> Array:
    """A premultiplied layer (H, W, 4) over a picture (H, W, 3)."""
    return np.asarray(layer[..., :3] + (1 - layer[..., 3:]) * below, np.float32)


@dataclass(frozen=True, slots=True)
class Walker:
    """A figure on its way: from and to (x, z) [m], its look, its first and last frame."""

    look: Look
    start: tuple[float, float]
    end: tuple[float, float]
    frames: tuple[float, float]

    def at(self, moment: float) -> tuple[float, float] | None:
        """Its place on the ground at a frame, None where it is not there."""
        first, last = self.frames
        share = (moment - first) / (last - first)
        if not 0 <= share <= 1:
            return None
        x, z = ((1 - share) * a + share * b for a, b in zip(self.start, self.end, strict=True))
        return x, z


class Clip:
    """A clip of a seed: what stands and walks where, and the lens."""

    def __init__(self, seed: int, frames: int) -> None:
        draw = np.random.default_rng(seed)
        self.draw, self.frames = draw, frames
        self.kind = KINDS[seed % len(KINDS)]
        self.place = float(draw.uniform(-0.6, 0.6)), float(draw.uniform(6.0, 7.0))
        self.focus = self.place[1] * float(draw.choice([0.75, 1.0, 1.0, 1.5]))
        self.infinity = float(draw.uniform(2.0, 9.0))
        self.sun = float(draw.uniform(-0.7, 0.7)), float(draw.uniform(-0.5, 0.7))
        self.shade = float(draw.choice([0.0, 0.3, 0.5, 0.6]))
        self.grain = float(draw.uniform(0.5, 2.5))
        self.drift = float(draw.choice([0.0, 0.06, -0.12]))
        self.walkers = [self._walker(kind) for kind in (
            ("before", "behind") if self.kind == "both" else (self.kind,)
        )]  # fmt: skip
        self.ground = self._background()
        card = draw_object(draw)
        width, height = OBJECT_SIZE
        x, z = self.place
        self.object = warped(card, _standing(x, z, width, height))
        self.object_depth = axis_depth(height / 2, z)
        self.object_seen = blurred(self.object, self.coc(self.object_depth))

    def coc(self, depth: float) -> float:
        """Signed circle of confusion of a depth [px]."""
        return self.infinity * (self.focus / depth - 1)

    def _walker(self, kind: str) -> Walker:
        draw, (x, z) = self.draw, self.place
        side = float(draw.choice([-1, 1]))
        near, far = z * float(draw.uniform(0.68, 0.85)), z * float(draw.uniform(1.2, 1.6))
        start, end = {"before": (near, near), "behind": (far, far), "past": (far, near)}[kind]
        reach = 1.3 if kind == "past" else 2.2
        length = self.frames
        times = float(draw.uniform(0.02, 0.15)) * length, float(draw.uniform(0.8, 0.97)) * length
        return Walker(Look.drawn(draw), (x - side * reach, start), (x + side * reach, end), times)

    def _background(self) -> Array:
        """The still scene in focus by depth, in linear light (H, W, 3)."""
        draw = self.draw
        floor = _texture(draw, (1800, 2400))
        wall = _texture(draw, (600, 2400))
        far = [(-12, 0, _WALL), (12, 0, _WALL), (12, 0, 2.2), (-12, 0, 2.2)]
        ground = warped(floor, far)
        upright = warped(wall, [(-12, 6, _WALL), (12, 6, _WALL), (12, 0, _WALL), (-12, 0, _WALL)])
        _, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT) + 0.5)
        foot = project([(0, 0, _WALL)])[0, 1]
        picture = np.where((rows < foot)[..., None], upright, ground)
        down = _PITCH + np.arctan((rows - HEIGHT / 2) / _FOCAL)
        along = _EYE / np.maximum(np.tan(down), 1e-3)
        z = np.where(rows < foot, _WALL, along)
        depth = z * math.cos(_PITCH) + np.where(rows < foot, 0, _EYE) * math.sin(_PITCH)
        coc = np.abs(self.infinity * (self.focus / depth - 1))
        levels = np.arange(0.0, coc.max() + 1.0, 0.75)
        stack = [blurred(picture, level) for level in levels]
        at = np.clip(coc / 0.75, 0, len(levels) - 1.001)
        out = np.zeros_like(picture)
        for number, level in enumerate(stack):
            out += np.clip(1 - np.abs(at - number), 0, 1)[..., None] * level
        return out.astype(np.float32)

    def frame(self, index: int) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        """Plate and composite (H, W, 3) in linear light, coverage before the object, order."""
        plate = self.ground.copy()
        layers: list[tuple[float, Array]] = []
        facts = []
        for walker in self.walkers:
            if walker.at(index) is None:
                continue
            seen, shade, z = self._smeared(walker, index)
            plate *= 1 - self.shade * shade
            depth = axis_depth(0.9, z)
            layer = blurred(seen, self.coc(depth))
            layers.append((z, layer))
            meets = float((layer[..., 3] * self.object_seen[..., 3]).sum())
            facts.append({"before": z < self.place[1], "depth_m": z, "meets_px": meets})
        composite = plate.copy()
        in_front = np.zeros((HEIGHT, WIDTH), np.float32)
        objects = [*layers, (self.place[1], self.object_seen)]
        for z, layer in sorted(objects, key=lambda one: -one[0]):
            composite = over(layer, composite)
            if layer is not self.object_seen:
                plate = over(layer, plate)
            if z < self.place[1]:
                in_front = 1 - (1 - in_front) * (1 - layer[..., 3])
        gain = 1 + self.drift * math.sin(math.pi * index / self.frames)
        return plate * np.float32(gain), composite * np.float32(gain), in_front, facts

    def _smeared(self, walker: Walker, index: int) -> tuple[Array, Array, float]:
        seen = np.zeros((HEIGHT, WIDTH, 4), np.float32)
        shade = np.zeros((HEIGHT, WIDTH, 1), np.float32)
        places = [walker.at(index + moment) or walker.at(index) for moment in _SMEAR]
        for place in places:
            assert place is not None
            (x, z), look = place, walker.look
            stride = math.dist(walker.start, (x, z)) / 0.75
            card = draw_figure(look, stride, facing=np.sign(walker.end[0] - walker.start[0]))
            height, width = (length / PX_PER_M for length in card.shape[:2])
            seen += warped(card, _standing(x, z, width, height)) / len(_SMEAR)
            lean_x, lean_z = self.sun[0] * height, self.sun[1] * height
            left, right = x - width / 2, x + width / 2
            fallen = [(left + lean_x, 0, z + lean_z), (right + lean_x, 0, z + lean_z),
                      (right, 0, z), (left, 0, z)]  # fmt: skip
            cast = warped(np.ascontiguousarray(card[..., 3]), fallen)
            shade[..., 0] += cv2.GaussianBlur(cast, (0, 0), 1.5) / len(_SMEAR)
        return seen, shade, float(np.mean([place[1] for place in places if place]))


def _standing(x: float, z: float, width: float, height: float) -> list[tuple[float, ...]]:
    left, right = x - width / 2, x + width / 2
    return [(left, height, z), (right, height, z), (right, 0, z), (left, 0, z)]


def _texture(draw: np.random.Generator, shape: tuple[int, int]) -> Array:
    """A surface of noise of several sizes, slabs with joints, and a few marks (h, w, 3)."""
    picture = np.zeros(shape, np.float32)
    for size in (2, 6, 20, 80, 300):
        coarse = draw.normal(size=(shape[0] // size + 2, shape[1] // size + 2)).astype(np.float32)
        part = cv2.resize(coarse, None, fx=size, fy=size, interpolation=cv2.INTER_CUBIC)
        picture += part[: shape[0], : shape[1]] * float(draw.uniform(0.03, 0.14))
    slab = int(draw.integers(60, 160))
    picture[::slab] -= 0.5
    picture[:, ::slab] -= 0.5
    tint = draw.uniform(0.7, 1.3, 3).astype(np.float32) * np.float32(draw.uniform(0.14, 0.4))
    marked = np.clip(np.exp2(picture), 0.1, 4)[..., None] * tint
    for _ in range(25):
        middle = draw.integers(0, shape[1]), draw.integers(0, shape[0])
        size = int(draw.integers(15, 70))
        colour = draw.uniform(0.03, 0.8, 3).tolist()
        cv2.ellipse(marked, [int(at) for at in middle], (size, size // 2), 0, 0, 360, colour, -1)
    return np.ascontiguousarray(marked, np.float32)


def write_clip(folder: Path, clip: Clip) -> None:
    """Write what `evaluate occlusion` reads."""
    for name in ("object", "gt_patch", "front"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    facts: list[dict[str, Any]] = []
    made: list[tuple[npt.NDArray[np.float16], ...]] = []
    card = clip.object
    depth = np.where(card[..., 3] > 0, np.float32(clip.object_depth), np.float32(1e10))
    channels = {name: np.ascontiguousarray(card[..., at]) for at, name in enumerate("RGBA")}
    reach = (clip.object_seen[..., 3] > 1e-3).astype(np.uint8) * 255
    with av.open(str(folder / "bg.mp4"), "w") as container:
        stream: Any = container.add_stream("libx264", RATE, options={"crf": "20", "threads": "1"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.colorspace, stream.color_range = 1, 1
        for index in range(clip.frames):
            plate, composite, in_front, walkers = clip.frame(index)
            grain = clip.draw.normal(0, clip.grain / 255, plate.shape).astype(np.float32)
            codes = np.clip(_CODED(plate) + grain, 0, 1)
            frame = av.VideoFrame.from_ndarray(np.uint8(255 * codes + 0.5), "rgb24")
            frame = frame.reformat(
                format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            container.mux(stream.encode(frame))
            made.append(tuple(one.astype(np.float16) for one in (plate, composite, in_front)))
            cv2.imwrite(str(folder / f"front/{index:04d}.png"), np.uint8(255 * in_front + 0.5))
            write_layers(folder / f"object/{index:04d}.exr", {**channels, "Z": depth})
            facts.append({"focus_distance_m": clip.focus, "coc_at_infinity_px": clip.infinity,
                          "walkers": walkers})  # fmt: skip
        container.mux(stream.encode())
    for index, (seen, (plate, composite, in_front)) in enumerate(
        zip(_decoded(folder / "bg.mp4"), made, strict=True)
    ):
        shown = 1 - clip.object_seen[..., 3:] * (1 - in_front[..., None].astype(np.float32))
        light = composite + shown * (seen - plate)
        truth = np.uint8(255 * np.clip(_CODED(light), 0, 1) + 0.5)
        cv2.imwrite(str(folder / f"gt_patch/{index:04d}.png"), np.dstack([truth[..., ::-1], reach]))
    write_glb(folder / "object.glb", clip)
    described = {"resolution": [WIDTH, HEIGHT], "fps": RATE, "kind": clip.kind, "frames": facts}
    (folder / "params.json").write_text(json.dumps(described, indent=1))


def _decoded(path: Path) -> Iterator[Array]:
    """The plate's frames as a composite gets them, in linear light (H, W, 3)."""
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            codes = frame.to_ndarray(
                format="rgb24", src_colorspace="ITU709", src_color_range="MPEG"
            )
            yield np.asarray(_LINEAR(codes.astype(np.float32) / 255), np.float32)


def write_glb(path: Path, clip: Clip) -> None:
    """The object as a box, and the camera."""
    writer = GlbWriter()
    (x, z), (width, height) = clip.place, OBJECT_SIZE
    corners = [(x + a * width / 2, b * height, -z + c * 0.1)
               for a in (-1, 1) for b in (0, 1) for c in (-1, 1)]  # fmt: skip
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
             (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip
    mesh = writer.add("meshes", {"primitives": [{
        "attributes": {"POSITION": writer.accessor(np.array(corners, np.float32))},
        "indices": writer.accessor(np.array(faces, np.uint32).ravel()),
    }]})  # fmt: skip
    lens = {"yfov": 2 * math.atan(HEIGHT / 2 / _FOCAL), "znear": 0.1}
    camera = writer.add("cameras", {"type": "perspective", "perspective": lens})
    turn = [-math.sin(_PITCH / 2), 0.0, 0.0, math.cos(_PITCH / 2)]
    nodes: list[dict[str, Any]] = [{"mesh": mesh}]
    nodes.append({"camera": camera, "translation": [0, _EYE, 0], "rotation": turn})
    for node in nodes:
        writer.node(**node)
    writer.write(path)


def main() -> None:
    """Write the clips."""
    parser = argparse.ArgumentParser(prog="truth.walkers", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--clips", type=int, default=14)
    parser.add_argument("--first", type=int, default=0, help="seed of the first clip")
    parser.add_argument("--frames", type=int, default=60)
    given = parser.parse_args()
    for seed in range(given.first, given.first + given.clips):
        clip = Clip(seed, given.frames)
        write_clip(given.out / f"{seed:02d}_{clip.kind}", clip)


if __name__ == "__main__":
    main()
