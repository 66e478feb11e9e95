"""Defocused pictures with known CoC, drawn without end into a reservoir on disk.

A scene is planes seen in perspective through a thin lens. On a plane disparity is affine in the
picture, so the signed CoC is too: `coc = c0 + A * (d - 1)` with `d` the disparity relative to the
middle of the picture. A ground plane runs to its vanishing line or into a wall; things stand on it
or hang before it, each scattered with its own CoC and laid over what lies behind.

    python -m models.coc.data --photos FOLDER --out /tmp/coc_data --count 30000
    python -m models.coc.data --photos FOLDER --sheet sheet.png
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.degrade import photographed
from models.coc.optics import (
    Aperture,
    cat_eye_aperture,
    polygon_aperture,
    round_aperture,
    scatter,
)
from models.coc.textures import Photos, drawn, noise, surface

Float32 = npt.NDArray[np.float32]
Rng = np.random.Generator
SIZE = 256  # edge of a finished picture [px]
MARGIN = 32  # what light can come from beyond the border [px]
LABEL_STEP = 4  # the network answers at a quarter of the size
MAX_COC_PX = 64.0
PHOTO_SHARE = 0.4


@dataclass(frozen=True, slots=True)
class Layout:
    """One lens and the plane (or ground and wall) that fills the picture.

    Attributes:
        disparity: of the surface in each pixel, 1 in the middle of the plane (N, N).
        slope: CoC per relative disparity [px].
        offset: signed CoC at relative disparity 1 [px].
        down: unit vector (x, y) in the picture along which the ground comes nearer.
    """

    disparity: Float32
    slope: float
    offset: float
    down: tuple[float, float]

    def coc(self, disparity: Float32 | float) -> Float32:
        """Signed CoC diameter, positive nearer than the focus [px]."""
        return np.clip(
            self.offset + self.slope * (np.float32(disparity) - 1), -MAX_COC_PX, MAX_COC_PX
        ).astype(np.float32)


def draw_aperture(rng: Rng) -> Aperture:
    """Round mostly, else five to nine blades or a disc cut by vignetting."""
    kind = rng.random()
    if kind < 0.75:
        return round_aperture()
    if kind < 0.9:
        return polygon_aperture(int(rng.integers(5, 10)), rng.uniform(0, np.pi))
    return cat_eye_aperture(rng.uniform(0.1, 0.6), rng.uniform(0, 2 * np.pi))


def draw_coc(rng: Rng) -> float:
    """An unsigned CoC: some in focus, most log-uniform to 45 px, a few to the limit."""
    kind = rng.random()
    if kind < 0.08:
        return rng.uniform(0, 1)
    top = MAX_COC_PX if kind > 0.93 else 45.0
    return float(np.exp(rng.uniform(np.log(1.3), np.log(top + 1))) - 1)


def draw_layout(rng: Rng) -> tuple[Layout, Float32 | None]:
    """A layout and, where a wall stands on the ground, its mask."""
    size = SIZE + 2 * MARGIN
    y, x = (np.mgrid[0:size, 0:size] - (size - 1) / 2).astype(np.float32)
    offset = draw_coc(rng) * rng.choice([-1.0, 1.0])
    angle = rng.normal(np.pi / 2, 0.12) if rng.random() < 0.65 else rng.uniform(0, 2 * np.pi)
    down = (float(np.cos(angle)), float(np.sin(angle)))
    if rng.random() < 0.15:
        return Layout(np.ones((size, size), np.float32), rng.uniform(2, 30), offset, down), None
    horizon = float(np.exp(rng.uniform(np.log(40), np.log(3000))))  # distance to it [px]
    change = float(np.exp(rng.uniform(np.log(1.0), np.log(45)))) / SIZE  # CoC per px
    plane = 1 + (x * down[0] + y * down[1]) / horizon
    wall_at = rng.uniform(1 - 100 / horizon, 1 + 90 / horizon) if rng.random() < 0.5 else 0.0
    wall_at = max(wall_at, 0.03)
    slope = min(change * horizon, 400.0)
    disparity = np.maximum(plane, wall_at)
    extreme = np.abs(offset + slope * (disparity - 1)).max()
    shrink = min(1.0, MAX_COC_PX / extreme)
    wall = np.float32(plane < wall_at) if (plane < wall_at).any() else None
    return Layout(disparity, slope * shrink, offset * shrink, down), wall


def in_perspective(rng: Rng, layout: Layout, photos: Photos) -> Float32:
    """The ground: a texture seen along the layout's plane, often with fine grain on top."""
    size = layout.disparity.shape[0]
    texture = surface(rng, 2 * size, photos, PHOTO_SHARE * 0.6)
    y, x = (np.mgrid[0:size, 0:size] - (size - 1) / 2).astype(np.float32)
    cosine, sine = layout.down
    along, across = x * cosine + y * sine, x * sine - y * cosine
    scale = np.exp(rng.uniform(np.log(0.5), np.log(2.0)))
    tilt = np.exp(rng.uniform(0, np.log(5)))
    turn = rng.uniform(0, 2 * np.pi)
    d = layout.disparity
    u, v = scale * across / d, scale * tilt * along / d
    u, v = u * np.cos(turn) - v * np.sin(turn) + size, u * np.sin(turn) + v * np.cos(turn) + size
    seen = cv2.remap(
        texture,
        np.float32(u),
        np.float32(v),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT_101,
    )
    if rng.random() < 0.6:
        depth = np.exp(rng.uniform(np.log(0.005), np.log(0.12)))
        seen = seen * (1 + depth * noise(rng, size, rng.uniform(0, 0.8)))[..., None]
    return np.maximum(seen, 0)


def lit(rng: Rng, linear: Float32) -> Float32:
    """Soft shadows, shading and points of light brighter than white."""
    size = linear.shape[0]
    if rng.random() < 0.35:
        mask = np.float32(noise(rng, size, rng.uniform(1.5, 2.5)) > rng.normal(0, 0.8))
        mask = cv2.GaussianBlur(mask, (0, 0), float(np.exp(rng.uniform(np.log(0.5), np.log(25)))))
        linear = linear * (1 - rng.uniform(0.1, 0.8) * mask)[..., None]
    if rng.random() < 0.25:
        linear = linear * np.exp(rng.uniform(0.1, 0.6) * noise(rng, size, 2.6))[..., None]
    if rng.random() < 0.14:
        linear = linear.copy()
        for _ in range(int(rng.integers(1, 30))):
            at = tuple(int(i) for i in rng.integers(0, size, 2))
            power = np.exp(rng.uniform(np.log(2), np.log(200)))
            colour = (power * np.exp(rng.normal(0, 0.3, 3))).tolist()
            cv2.circle(linear, at, int(rng.integers(0, 3)), colour, -1)
    return np.float32(linear)


def silhouette(rng: Rng, size: int, base: tuple[float, float], reach: float) -> Float32:
    """Coverage (size, size) of one thing that stands with its foot at `base` [px], `reach` tall."""
    mask = np.zeros((size, size), np.uint8)
    x, y = base
    kind = rng.integers(5)
    width = reach * rng.uniform(0.3, 1.5)
    if kind == 0:  # a box
        corners = np.array([[-width, 0], [width, 0], [width, -2 * reach], [-width, -2 * reach]])
        corners = corners / 2 + rng.normal(0, 0.06 * reach, (4, 2))
        cv2.fillPoly(mask, [np.int32((corners + base) * 16)], 255, cv2.LINE_AA, 4)
    elif kind == 1:  # a round thing
        centre, axes = np.int32([x * 16, (y - reach / 2) * 16]), np.int32([width * 8, reach * 8])
        angle = rng.uniform(-20, 20)
        cv2.ellipse(mask, centre.tolist(), axes.tolist(), angle, 0, 360, 255, -1, cv2.LINE_AA, 4)
    elif kind == 2:  # poles, legs, stems
        for _ in range(int(rng.integers(1, 5))):
            foot = np.array(base) + rng.normal(0, 0.4 * reach, 2) * (1, 0.1)
            head = foot + (rng.normal(0, 0.15 * reach), -1.5 * reach)
            points = [np.int32(point * 16).tolist() for point in (foot, head)]
            thick = int(rng.integers(1, 2 + int(reach / 8)))
            cv2.line(mask, points[0], points[1], 255, thick, cv2.LINE_AA, 4)
    elif kind == 3:  # a ragged outline
        angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        wobble = 1 + 0.35 * np.convolve(rng.normal(0, 1, 40), np.ones(5) / 3, "same")
        ring = np.stack([np.cos(angles) * width, np.sin(angles) * reach], -1) * wobble[:, None] / 2
        points = np.int32((ring + (x, y - reach / 2)) * 16)
        cv2.fillPoly(mask, [points], 255, cv2.LINE_AA, 4)
    else:  # leaves
        for _ in range(int(rng.integers(8, 50))):
            centre = (np.array([x, y - reach / 2]) + rng.normal(0, 0.35 * reach, 2)) * 16
            axes = np.int32(rng.uniform(0.02, 0.12, 2) * reach * 16 + 8)
            turn = rng.uniform(0, 180)
            cv2.ellipse(
                mask,
                np.int32(centre).tolist(),
                axes.tolist(),
                turn,
                0,
                360,
                255,
                -1,
                cv2.LINE_AA,
                4,
            )
    return np.float32(mask) / 255


def add_thing(
    scene: tuple[Float32, Float32],
    thing: tuple[Float32, Float32, Float32],
    aperture: Aperture,
) -> tuple[Float32, Float32]:
    """Lay one thing over the blurred picture, with true partial occlusion at its edge.

    Args:
        scene: blurred light (N, N, 3) and unsigned CoC (N, N) so far.
        thing: its sharp light (N, N, 3), coverage (N, N) and signed CoC (N, N).
        aperture: the lens.
    """
    light, coc = scene
    colour, alpha, thing_coc = thing
    rows, columns = np.nonzero(alpha.max(1) > 0)[0], np.nonzero(alpha.max(0) > 0)[0]
    if not len(rows):
        return scene
    pad = int(np.abs(thing_coc).max() / 2) + 3
    box = (
        slice(max(0, rows[0] - pad), rows[-1] + pad + 1),
        slice(max(0, columns[0] - pad), columns[-1] + pad + 1),
    )
    cover = alpha[box][..., None]
    layer = np.concatenate([colour[box] * cover, cover, np.ones_like(cover)], -1)
    spread = scatter(layer, thing_coc[box], aperture)
    spread = spread[..., :4] / np.maximum(spread[..., 4:], 0.5)
    light = light.copy()
    light[box] = light[box] * (1 - np.minimum(spread[..., 3:], 1)) + spread[..., :3]
    return light, np.where(alpha > 0.5, np.abs(thing_coc), coc)


def draw_things(rng: Rng, layout: Layout, photos: Photos) -> list[tuple[Float32, Float32, Float32]]:
    """Things on the ground and before it, farthest first: light, coverage, signed CoC."""
    size = layout.disparity.shape[0]
    count = int(rng.choice([0, 0, 1, 2, 3, 5], p=[0.2, 0.15, 0.2, 0.2, 0.15, 0.1]))
    placed = []
    for _ in range(count):
        base = rng.uniform(0.1 * size, 1.0 * size, 2)
        reach = float(np.exp(rng.uniform(np.log(14), np.log(200))))
        at = layout.disparity[int(min(base[1], size - 1)), int(min(base[0], size - 1))]
        if rng.random() < 0.35:
            at = at * rng.uniform(1.0, 1.6)
        placed.append((float(at), base, reach))
    things = []
    for at, base, reach in sorted(placed, key=lambda place: place[0]):
        alpha = silhouette(rng, size, (base[0], base[1]), reach)
        light = surface(rng, size, photos, PHOTO_SHARE)
        if rng.random() < 0.5:
            ramp = np.linspace(-1, 1, size, dtype=np.float32)
            light = light * np.clip(1 + rng.normal(0, 0.8) * ramp, 0.1, 2)[None, :, None]
        coc = np.broadcast_to(layout.coc(at), (size, size))
        if rng.random() < 0.3:  # a side that runs away from the camera
            coc = coc + rng.normal(0, 4) * np.linspace(-1, 1, size, dtype=np.float32)[None]
        things.append((np.float32(light), alpha, np.float32(np.clip(coc, -64, 64))))
    return things


def draw_scene(rng: Rng, photos: Photos) -> tuple[npt.NDArray[np.uint8], Float32]:
    """A finished picture uint8 (SIZE, SIZE, 3) and its unsigned CoC diameter (SIZE, SIZE) [px]."""
    layout, wall = draw_layout(rng)
    aperture = draw_aperture(rng)
    size = layout.disparity.shape[0]
    if rng.random() < 0.3:
        ground = photos.crop(rng, size) if rng.random() < 0.7 else drawn(rng, size)
    else:
        ground = in_perspective(rng, layout, photos)
    if wall is not None:
        ground = np.where(wall[..., None] > 0, surface(rng, size, photos, PHOTO_SHARE), ground)
    ground = lit(rng, ground)
    coc = layout.coc(layout.disparity)
    back = scatter(np.concatenate([ground, np.ones_like(ground[..., :1])], -1), coc, aperture)
    scene = (back[..., :3] / np.maximum(back[..., 3:], 1e-3), np.abs(coc))
    for thing in draw_things(rng, layout, photos):
        scene = add_thing(scene, thing, aperture)
    inner = slice(MARGIN, MARGIN + SIZE)
    return photographed(rng, scene[0])[inner, inner], scene[1][inner, inner]


def label(coc_px: Float32) -> Float32:
    """Unsigned CoC [px] at the network's output size: the mean over each cell, in log(1 + CoC)."""
    rows, columns = (n // LABEL_STEP for n in coc_px.shape)
    cells = np.log1p(coc_px).reshape(rows, LABEL_STEP, columns, LABEL_STEP)
    return np.expm1(cells.mean((1, 3))).astype(np.float32)


class Reservoir:
    """Pictures and labels in two memory-mapped files, a ring; readers see its count grow.

    Attributes:
        pictures: uint8 (capacity, SIZE, SIZE, 3).
        labels: CoC [px], float16 (capacity, SIZE / LABEL_STEP, SIZE / LABEL_STEP).
    """

    def __init__(self, folder: Path, capacity: int | None = None) -> None:
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


def contact_sheet(seed: int, photos: Photos, path: Path, columns: int = 8, rows: int = 4) -> None:
    """Write pictures above their CoC (blue 0, red 64 px) for a look by eye."""
    strips = []
    for row in range(rows):
        pairs = []
        for column in range(columns):
            rng = np.random.default_rng([seed, row * columns + column])
            picture, coc = draw_scene(rng, photos)
            shade = cv2.applyColorMap(np.uint8(np.minimum(coc * 4, 255)), cv2.COLORMAP_TURBO)
            pairs.append(np.vstack([picture[..., ::-1], cv2.resize(shade, None, fx=1, fy=0.5)]))
        strips.append(np.hstack(pairs))
    cv2.imwrite(str(path), np.vstack(strips))


def main() -> None:
    """Fill a reservoir, or write a contact sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=Path, required=True, help="folder with sharp/, kodak/, …")
    parser.add_argument("--held-out", action="store_true", help="use the held-out photographs")
    parser.add_argument("--out", type=Path, help="folder of the reservoir")
    parser.add_argument("--count", type=int, default=30000, help="pictures it holds")
    parser.add_argument("--endless", action="store_true", help="go on, replacing the oldest")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sheet", type=Path, help="write a contact sheet there and stop")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    photos = Photos.load(options.photos, held_out=options.held_out)
    if options.sheet:
        contact_sheet(options.seed, photos, options.sheet)
        return
    reservoir = Reservoir(options.out, options.count)
    start = time.time()
    for index in itertools.count(reservoir.drawn):
        if index >= options.count and not options.endless:
            break
        picture, coc = draw_scene(np.random.default_rng([options.seed, index]), photos)
        reservoir.append(picture, coc)
        if index % 500 == 0:
            print(f"{index} pictures, {time.time() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
