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

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from nlens_video.core.color import transfer
from nlens_video.evaluate.bench.glb_writer import GlbWriter
from nlens_video.video.exr import write_layers
from truth.box_glb import add_box, add_lens
from truth.clip_file import read_clip_file, write_clip_file
from truth.figures import OBJECT_SIZE, PX_PER_M, Look, draw_figure, draw_object

Array = npt.NDArray[np.float32]
WIDTH, HEIGHT, RATE = 640, 360, 25
_CODED = transfer("iec61966-2-1").to_coded
_LINEAR = transfer("iec61966-2-1").to_linear
KINDS = ("before", "behind", "past", "before", "behind", "both", "past")
FOCAL, _EYE = WIDTH / 2 / math.tan(math.radians(30)), 1.6
_PITCH, WALL = math.radians(12), 14.0
_FINE = 2  # samples of a pixel, each way
_SMEAR = np.array([-0.25, -0.08, 0.08, 0.25])  # moments of the open shutter [frame]


@dataclass(frozen=True, slots=True)
class Pose:
    """A camera: where it stands [m], how far it turns right, looks down and leans right [rad]."""

    eye: tuple[float, float, float] = (0.0, _EYE, 0.0)
    yaw: float = 0.0
    pitch: float = _PITCH
    roll: float = 0.0

    @property
    def axes(self) -> npt.NDArray[np.float64]:
        """Its directions right, up and ahead (3, 3), as rows; x right, y up, z away."""
        sine, cosine = math.sin(self.yaw), math.cos(self.yaw)
        down, level = math.sin(self.pitch), math.cos(self.pitch)
        right = np.array([cosine, 0.0, -sine])
        up = np.array([sine * down, level, cosine * down])
        ahead = np.array([sine * level, -down, cosine * level])
        across, along = math.cos(self.roll), math.sin(self.roll)
        return np.stack([across * right - along * up, across * up + along * right, ahead])

    def seen(self, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Points (n, 3) by those directions (n, 3) [m]."""
        return np.asarray((np.asarray(points, float) - self.eye) @ self.axes.T)

    def depth(self, x: float, y: float, z: float) -> float:
        """Depth of a point along the optical axis [m]."""
        return float(self.seen([(x, y, z)])[0, 2])


STILL = Pose()


def project(points: npt.ArrayLike, pose: Pose) -> npt.NDArray[np.float64]:
    """Columns and rows (n, 2) of points (n, 3): x right, y up, z away from the camera [m]."""
    x, y, depth = pose.seen(points).T
    return np.stack([WIDTH / 2 + FOCAL * x / depth, HEIGHT / 2 - FOCAL * y / depth], axis=1)


def warped(card: Array, corners: npt.ArrayLike, pose: Pose) -> Array:
    """A card (h, w, c) with its corners (4, 3) in the world, as a pinhole sees it (H, W, c)."""
    height, width = card.shape[:2]
    flat = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = project(corners, pose).astype(np.float32) * _FINE
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


@dataclass(frozen=True, slots=True)
class View:
    """What a camera sees without the walkers.

    The scene behind the lens (H, W, 3); the object's card, premultiplied (H, W, 4), its depth [m],
    and the card behind the lens.
    """

    ground: Array
    card: Array
    depth: float
    blurred: Array


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
        self.floor, self.wall = _texture(draw, (1800, 2400)), _texture(draw, (600, 2400))
        self.card = draw_object(draw)
        self.still = self.view(STILL)

    def pose(self, index: float) -> Pose:
        """The camera of a frame."""
        return STILL

    def seen(self, index: int) -> View:
        """What a frame shows without the walkers."""
        return self.still

    def view(self, pose: Pose) -> View:
        """What a camera sees without the walkers."""
        width, height = OBJECT_SIZE
        x, z = self.place
        card = warped(self.card, _standing(x, z, width, height), pose)
        depth = pose.depth(x, height / 2, z)
        return View(self._background(pose), card, depth, blurred(card, self.coc(depth)))

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

    def sharp(self, pose: Pose) -> tuple[Array, Array]:
        """The scene of a still camera without its lens, in linear light (H, W, 3); its depth."""
        far = [(-12, 0, WALL), (12, 0, WALL), (12, 0, 2.2), (-12, 0, 2.2)]
        ground = warped(self.floor, far, pose)
        upright = [(-12, 6, WALL), (12, 6, WALL), (12, 0, WALL), (-12, 0, WALL)]
        _, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT) + 0.5)
        foot = project([(0, 0, WALL)], pose)[0, 1]
        above = warped(self.wall, upright, pose)
        picture = np.where((rows < foot)[..., None], above, ground)
        down = _PITCH + np.arctan((rows - HEIGHT / 2) / FOCAL)
        along = _EYE / np.maximum(np.tan(down), 1e-3)
        z = np.where(rows < foot, WALL, along)
        depth = z * math.cos(_PITCH) + np.where(rows < foot, 0, _EYE) * math.sin(_PITCH)
        return picture, np.asarray(depth, np.float32)

    def _background(self, pose: Pose) -> Array:
        """The still scene in focus by depth, in linear light (H, W, 3)."""
        picture, depth = self.sharp(pose)
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
        pose, seen = self.pose(index), self.seen(index)
        plate = seen.ground.copy()
        layers: list[tuple[float, Array]] = []
        facts = []
        for walker in self.walkers:
            if walker.at(index) is None:
                continue
            figure, shade, (x, z) = self._smeared(walker, index, pose)
            plate *= 1 - self.shade * shade
            layer = blurred(figure, self.coc(pose.depth(x, 0.9, z)))
            layers.append((z, layer))
            if walker.start == walker.end:  # it only stands there
                continue
            meets = float((layer[..., 3] * seen.blurred[..., 3]).sum())
            facts.append({"before": z < self.place[1], "depth_m": z, "meets_px": meets})
        composite = plate.copy()
        in_front = np.zeros((HEIGHT, WIDTH), np.float32)
        objects = [*layers, (self.place[1], seen.blurred)]
        for z, layer in sorted(objects, key=lambda one: -one[0]):
            composite = over(layer, composite)
            if layer is not seen.blurred:
                plate = over(layer, plate)
            if z < self.place[1]:
                in_front = 1 - (1 - in_front) * (1 - layer[..., 3])
        gain = 1 + self.drift * math.sin(math.pi * index / self.frames)
        return plate * np.float32(gain), composite * np.float32(gain), in_front, facts

    def _smeared(
        self, walker: Walker, index: int, pose: Pose
    ) -> tuple[Array, Array, tuple[float, float]]:
        seen = np.zeros((HEIGHT, WIDTH, 4), np.float32)
        shade = np.zeros((HEIGHT, WIDTH, 1), np.float32)
        places = [walker.at(index + moment) or walker.at(index) for moment in _SMEAR]
        for place in places:
            assert place is not None
            (x, z), look = place, walker.look
            stride = math.dist(walker.start, (x, z)) / 0.75
            card = draw_figure(look, stride, facing=np.sign(walker.end[0] - walker.start[0]))
            height, width = (length / PX_PER_M for length in card.shape[:2])
            seen += warped(card, _standing(x, z, width, height), pose) / len(_SMEAR)
            lean_x, lean_z = self.sun[0] * height, self.sun[1] * height
            left, right = x - width / 2, x + width / 2
            fallen = [(left + lean_x, 0, z + lean_z), (right + lean_x, 0, z + lean_z),
                      (right, 0, z), (left, 0, z)]  # fmt: skip
            cast = warped(np.ascontiguousarray(card[..., 3]), fallen, pose)
            shade[..., 0] += cv2.GaussianBlur(cast, (0, 0), 1.5) / len(_SMEAR)
        x, z = np.mean([place for place in places if place], axis=0)
        return seen, shade, (float(x), float(z))


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

    def plates() -> Iterator[Array]:
        for index in range(clip.frames):
            plate, composite, in_front, walkers = clip.frame(index)
            grain = clip.draw.normal(0, clip.grain / 255, plate.shape).astype(np.float32)
            made.append(tuple(one.astype(np.float16) for one in (plate, composite, in_front)))
            cv2.imwrite(str(folder / f"front/{index:04d}.png"), np.uint8(255 * in_front + 0.5))
            _write_layer(folder / f"object/{index:04d}.exr", clip.seen(index))
            facts.append({"focus_distance_m": clip.focus, "coc_at_infinity_px": clip.infinity,
                          "walkers": walkers})  # fmt: skip
            yield np.asarray(_CODED(plate) + grain)

    write_clip_file(folder / "bg.mp4", plates(), RATE, crf=20)
    for index, (codes, (plate, composite, in_front)) in enumerate(
        zip(read_clip_file(folder / "bg.mp4"), made, strict=True)
    ):
        seen = _LINEAR(codes)  # as a composite gets it
        covered = clip.seen(index).blurred[..., 3:]
        reach = (covered[..., 0] > 1e-3).astype(np.uint8) * 255
        shown = 1 - covered * (1 - in_front[..., None].astype(np.float32))
        light = composite + shown * (seen - plate)
        truth = np.uint8(255 * np.clip(_CODED(light), 0, 1) + 0.5)
        cv2.imwrite(str(folder / f"gt_patch/{index:04d}.png"), np.dstack([truth[..., ::-1], reach]))
    write_glb(folder / "object.glb", clip)
    described = {"resolution": [WIDTH, HEIGHT], "fps": RATE, "kind": clip.kind, "frames": facts}
    (folder / "params.json").write_text(json.dumps(described, indent=1))


def _write_layer(path: Path, seen: View) -> None:
    card = seen.card
    depth = np.where(card[..., 3] > 0, np.float32(seen.depth), np.float32(1e10))
    channels = {name: np.ascontiguousarray(card[..., at]) for at, name in enumerate("RGBA")}
    write_layers(path, {**channels, "Z": depth})


def write_glb(path: Path, clip: Clip) -> None:
    """The object as a box, and the camera."""
    writer = GlbWriter()
    add_box(writer, clip.place, (*OBJECT_SIZE, 0.2))
    camera = add_lens(writer, FOCAL, HEIGHT)
    poses = [clip.pose(index) for index in range(clip.frames)]
    eyes, turns = [_eye(one) for one in poses], [_turn(one) for one in poses]
    node = writer.node(camera=camera, translation=eyes[0], rotation=turns[0])
    if any(one != poses[0] for one in poses):
        times = np.arange(clip.frames) / RATE
        writer.animation(
            (node, "translation", times, eyes, "LINEAR"),
            (node, "rotation", times, turns, "LINEAR"),
        )
    writer.write(path)


def _eye(pose: Pose) -> list[float]:
    """Its place in glTF's axes [m]."""
    return [pose.eye[0], pose.eye[1], -pose.eye[2]]


def _turn(pose: Pose) -> list[float]:
    """Its direction in glTF's axes, as a quaternion."""
    right, up, ahead = pose.axes * (1, 1, -1)
    turn = Rotation.from_matrix(np.stack([right, up, -ahead], axis=1))
    return [float(part) for part in turn.as_quat()]


def clip_arguments(prog: str, about: str, clips: int) -> argparse.Namespace:
    """What the command line says: the folder, seeds and length of the clips."""
    parser = argparse.ArgumentParser(prog=prog, description=about)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--clips", type=int, default=clips)
    parser.add_argument("--first", type=int, default=0, help="seed of the first clip")
    parser.add_argument("--frames", type=int, default=60)
    return parser.parse_args()


def main() -> None:
    """Write the clips."""
    given = clip_arguments("truth.walkers", __doc__.splitlines()[0], clips=14)
    for seed in range(given.first, given.first + given.clips):
        clip = Clip(seed, given.frames)
        write_clip(given.out / f"{seed:02d}_{clip.kind}", clip)


if __name__ == "__main__":
    main()
