"""The ground of a training scene: texture, tiles, paths, and stains as dark as shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from models.sun.shapes import Floats, Rng

Float32 = npt.NDArray[np.float32]
TILE = 256
"""Edge of a texture [texel]."""


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A texture that repeats, at ever coarser levels.

    Attributes:
        levels: (N, N, 3), (N / 2, N / 2, 3) and so on; mean 1.
    """

    levels: tuple[Float32, ...]

    @classmethod
    def of(cls, picture: Float32) -> Texture:
        """From a picture (TILE, TILE, 3), scene-linear; mirrored, so that it repeats."""
        picture = picture / np.maximum(picture.mean(axis=(0, 1)), 1e-4)
        whole = np.concatenate([picture, picture[:, ::-1]], axis=1)
        levels = [np.float32(np.concatenate([whole, whole[::-1]], axis=0))]
        while len(levels[-1]) > 1:
            half = len(levels[-1]) // 2
            levels.append(levels[-1].reshape(half, 2, half, 2, 3).mean(axis=(1, 3)))
        return cls(tuple(levels))

    def at(self, places: Floats, texel: Floats) -> Float32:
        """Values (P, 3) at places (P, 2) [tile], where a pixel covers so much (P,) [tile]."""
        count = len(self.levels[0])
        level = np.clip(np.log2(np.maximum(texel * count, 1e-6)) + 0.5, 0.0, len(self.levels) - 1)
        which = level.astype(np.int64)
        out = np.empty((len(places), 3), np.float32)
        for k in np.unique(which):
            here = which == k
            side = len(self.levels[k])
            column, row = (np.floor(places[here] * side).astype(np.int64) % side).T
            out[here] = self.levels[k][row, column]
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Reflectance of the ground.

    Attributes:
        base: (3,).
        texture: of it.
        scale: tiles of the texture by a camera height.
        contrast: exponent of the texture.
        turn: of the texture [rad].
        marks: map of factors (N, N, 3) over `reach` camera heights, before the camera.
        reach: extent of the marks.
    """

    base: Floats
    texture: Texture
    scale: float
    contrast: float
    turn: float
    marks: Float32
    reach: float

    def at(self, x: Floats, z: Floats, footprint: Floats) -> Float32:
        """Reflectance (P, 3) at places, where a pixel covers so much (P,)."""
        cosine, sine = math.cos(self.turn), math.sin(self.turn)
        places = self.scale * np.stack([cosine * x + sine * z, cosine * z - sine * x], axis=1)
        found = self.texture.at(places, self.scale * footprint) ** np.float32(self.contrast)
        side = len(self.marks)
        column = np.clip((x / self.reach + 0.5) * side, 0, side - 1).astype(np.int64)
        row = np.clip(-z / self.reach * side, 0, side - 1).astype(np.int64)
        return np.asarray(self.base * found * self.marks[row, column], np.float32)


def draw_color(rng: Rng) -> Floats:
    """Reflectance (3,), often nearly grey."""
    grey = math.exp(rng.uniform(math.log(0.04), math.log(0.75)))
    return np.asarray(
        np.clip(grey * np.exp(rng.normal(0.0, rng.choice([0.05, 0.3]), 3)), 0.02, 0.85)
    )


def draw_ground(rng: Rng, textures: list[Texture]) -> Ground:
    """A ground."""
    reach = math.exp(rng.uniform(math.log(4.0), math.log(40.0)))
    return Ground(
        base=draw_color(rng),
        texture=textures[int(rng.integers(len(textures)))],
        scale=math.exp(rng.uniform(math.log(0.1), math.log(4.0))),
        contrast=float(rng.choice([rng.uniform(0.0, 0.3), rng.uniform(0.2, 1.0)])),
        turn=rng.uniform(0.0, 2.0 * math.pi),
        marks=_marks(rng),
        reach=reach,
    )


def _marks(rng: Rng, side: int = 384) -> Float32:
    marks = np.ones((side, side, 3), np.float32)
    if rng.random() < 0.25:
        _tile(rng, marks)
    for _ in range(int(rng.choice([0, 0, 1, 1, 2, 4]))):
        factor = _factor(rng)
        kind = rng.random()
        if kind < 0.35:  # a path
            a, b = rng.uniform(-0.3, 1.3, (2, 2)) * side
            width = max(2, int(side * math.exp(rng.uniform(math.log(0.01), math.log(0.4)))))
            mask = np.zeros((side, side), np.uint8)
            cv2.line(mask, tuple(map(int, a)), tuple(map(int, b)), 1, width)
        elif kind < 0.65:  # rugs, puddles, patches
            mask = np.zeros((side, side), np.uint8)
            for _ in range(int(rng.integers(1, 9))):
                middle, size = rng.uniform(0.0, side, 2), side * rng.uniform(0.01, 0.15, 2)
                turn = rng.uniform(0.0, 360.0)
                if rng.random() < 0.5:
                    cv2.ellipse(mask, (tuple(middle), tuple(2.0 * size), turn), 1, -1)
                else:
                    corners = cv2.boxPoints((tuple(middle), tuple(2.0 * size), turn))
                    cv2.fillPoly(mask, [corners.astype(np.int32)], 1)
        else:  # stains and growth
            smooth = cv2.GaussianBlur(
                rng.standard_normal((side, side), dtype=np.float32), (0, 0),
                side * math.exp(rng.uniform(math.log(0.008), math.log(0.1))),
            )  # fmt: skip
            mask = smooth > np.quantile(smooth, rng.uniform(0.5, 0.95))
        soft = np.asarray(mask, np.float32)
        if rng.random() < 0.4:
            soft = cv2.GaussianBlur(soft, (0, 0), rng.uniform(0.5, 6.0))
        marks *= 1.0 + soft[..., None] * (factor - 1.0)
    return marks


def _factor(rng: Rng) -> Float32:
    """Of another material, or of the same, as dark as in a shadow."""
    if rng.random() < 0.4:
        return np.float32(2.0 ** rng.uniform(-2.0, -0.3) * np.ones(3))
    return np.float32(np.clip(np.exp(rng.normal(0.0, 0.6) + rng.normal(0.0, 0.15, 3)), 0.1, 3.0))


def _tile(rng: Rng, marks: Float32) -> None:
    """Tiles, planks or bricks with joints, some of another shade."""
    side = len(marks)
    turn = rng.uniform(0.0, math.pi)
    wide, long = (
        side
        / math.exp(rng.uniform(math.log(6.0), math.log(60.0)))
        * np.array([1.0, math.exp(rng.uniform(0.0, 2.0))])
    )
    y, x = np.mgrid[:side, :side].astype(np.float32)
    u = (math.cos(turn) * x + math.sin(turn) * y) / wide
    v = (math.cos(turn) * y - math.sin(turn) * x) / long
    if rng.random() < 0.5:
        v = v + 0.5 * (np.floor(u) % 2)
    column, row = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    shades = np.float32(np.exp(rng.normal(0.0, rng.choice([0.03, 0.25]), 997)))
    if rng.random() < 0.2:
        shade = np.where(
            (column + row) % 2 == 0, np.float32(1.0), np.float32(rng.uniform(0.15, 0.7))
        )
    else:
        shade = shades[(column * 31 + row * 101) % 997]
    joint = rng.uniform(0.02, 0.08)
    shade = np.where((u - column < joint) | (v - row < joint), rng.uniform(0.4, 1.2), shade)
    marks *= np.float32(shade)[..., None]


def load_textures(rng: Rng, pictures: list[npt.NDArray[np.uint8]], count: int) -> list[Texture]:
    """Crops of photographs (RGB) and noise."""
    made = []
    for k in range(count):
        if k % 2 and pictures:
            picture = pictures[int(rng.integers(len(pictures)))]
            side = int(min(picture.shape[:2]) * rng.uniform(0.25, 0.9))
            y, x = (int(rng.integers(0, size - side + 1)) for size in picture.shape[:2])
            crop = cv2.resize(
                picture[y : y + side, x : x + side], (TILE, TILE), interpolation=cv2.INTER_AREA
            )
            light = (crop.astype(np.float32) / 255.0) ** np.float32(2.2)
            coarse = cv2.GaussianBlur(light, (0, 0), 40.0)
            light = (light + 0.01) / (coarse + 0.01)
        else:
            light = _noise(rng)
        made.append(Texture.of(np.clip(light, 0.02, 8.0)))
    return made


def _noise(rng: Rng) -> Float32:
    """Grain of any coarseness, sometimes drawn out to one side."""
    fy, fx = np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None]
    stretch = math.exp(rng.uniform(0.0, 2.5)) if rng.random() < 0.4 else 1.0
    radius = np.sqrt((stretch * fx) ** 2 + fy**2) + 0.5 / TILE
    white = np.fft.rfft2(rng.standard_normal((TILE, TILE)))
    white[0, 0] = 0.0
    field = np.fft.irfft2(white * radius ** -rng.uniform(0.2, 1.6), (TILE, TILE))
    shade = np.exp(rng.uniform(0.1, 0.6) * field / field.std())
    tint = np.exp(rng.normal(0.0, 0.1, 3) * (field / field.std())[..., None])
    return np.float32(shade[..., None] * tint)
