"""Surfaces on which blur is hard to read: fine, self-similar, nearly uniform or soft in themselves.

As `textures.py` they are drawn from a generator alone; here each stands for the ground of a whole
picture. What is soft in itself mostly carries a fine sharp grain, as paint on asphalt does: without
any the network would learn to take blur for a soft pattern.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.textures import Photos, dead_leaves, glyphs, noise, stripes, to_linear

Float32 = npt.NDArray[np.float32]
Rng = np.random.Generator
PHOTO_SHARE = 0.18


def _log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _colour(rng: Rng) -> Float32:
    """A surface's colour in code values: nearly white on a fifth, else any, mostly nearly grey."""
    grey = rng.uniform(0.82, 0.97) if rng.random() < 0.2 else rng.uniform(0.12, 0.85)
    return np.clip(grey + rng.normal(0, rng.choice([0.01, 0.04, 0.12]), 3), 0.03, 0.98)


def _stretched(rng: Rng, size: int, slope: float) -> Float32:
    """Noise of a spectral slope, along one direction on two fifths of the surfaces."""
    stretch = _log_uniform(rng, 1.5, 16) if rng.random() < 0.4 else 1.0
    return noise(rng, size, slope, stretch, rng.uniform(0, np.pi))


def _fine(rng: Rng, size: int) -> Float32:
    """Faint grain sharp to the pixel, in code values (size, size, 1)."""
    contrast = _log_uniform(rng, 0.005, 0.06)
    return contrast * noise(rng, size, rng.uniform(-0.2, 0.6))[..., None]


def self_similar(rng: Rng, size: int) -> Float32:
    """Concrete, plaster, earth: one slope over all octaves, from white to what looks soft."""
    field = _log_uniform(rng, 0.012, 0.3) * _stretched(rng, size, rng.uniform(0.1, 2.2))
    code = _colour(rng) + field[..., None] * (1 + rng.normal(0, 0.15, 3))
    return np.float32(code + _fine(rng, size) if rng.random() < 0.4 else code)


def relief(rng: Rng, size: int) -> Float32:
    """Snow, plaster, paint, leather: one colour, seen by the shade of its relief alone."""
    height = _stretched(rng, size, rng.uniform(0.9, 2.3))
    turn = rng.uniform(0, 2 * np.pi)
    down, across = np.gradient(height)
    shade = np.cos(turn) * across + np.sin(turn) * down
    shade = shade / (shade.std() + 1e-9) * _log_uniform(rng, 0.008, 0.2)
    return np.float32(_colour(rng) * (1 + shade[..., None]))


def sand(rng: Rng, size: int) -> Float32:
    """Sand, asphalt, carpet: grain of the pixel's own size, nearly white, sometimes in specks."""
    field = _stretched(rng, size, rng.uniform(-0.3, 0.6))
    if rng.random() < 0.5:
        field = np.sign(field) * np.abs(field) ** rng.uniform(1.3, 3.0) * 0.6
    return np.float32(_colour(rng) * (1 + _log_uniform(rng, 0.015, 0.4) * field[..., None]))


def _cells(rng: Rng, size: int, spacing: float) -> tuple[npt.NDArray[np.int32], Float32]:
    """Index of the nearest of many points, `spacing` px apart, and the distance to it [px]."""
    free = np.ones((size, size), np.uint8)
    count = max(4, int((size / spacing) ** 2))
    free[rng.integers(0, size, count), rng.integers(0, size, count)] = 0
    distance, index = cv2.distanceTransformWithLabels(
        free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    return np.asarray(index, np.int32), np.asarray(distance, np.float32)


def gravel(rng: Rng, size: int) -> Float32:
    """Gravel, cobbles, mosaic: stones of one size, each of its own shade, dark between them."""
    spacing = _log_uniform(rng, 2.5, 18)
    index, distance = _cells(rng, size, spacing)
    shade = rng.normal(0, _log_uniform(rng, 0.02, 0.3), (int(index.max()) + 1, 1))
    tint = rng.normal(0, rng.choice([0.0, 0.03]), (len(shade), 3))
    dark = rng.uniform(0, 0.6) * np.minimum(1, distance / (0.7 * spacing)) ** 2
    code = _colour(rng) * (1 + (shade + tint)[index]) * (1 - dark[..., None])
    return np.float32(code + _fine(rng, size) if rng.random() < 0.5 else code)


def terrazzo(rng: Rng, size: int) -> Float32:
    """Few chips of many colours in a plain ground."""
    index, _ = _cells(rng, size, _log_uniform(rng, 3, 14))
    chips = rng.random(int(index.max()) + 1) < rng.uniform(0.03, 0.3)
    base = _colour(rng)
    colours = base + rng.uniform(0.1, 1) * rng.normal(0, 0.25, (len(chips), 3))
    code = np.where(chips[index][..., None], colours[index], base)
    return np.float32(code + _fine(rng, size) if rng.random() < 0.5 else code)


def weave(rng: Rng, size: int) -> Float32:
    """Cloth and mats: threads over and under each other, not quite even."""
    y, x = np.mgrid[0:size, 0:size].astype(np.float32)
    turn, period = rng.uniform(0, np.pi), _log_uniform(rng, 2.5, 11)
    wander = rng.uniform(0, 0.5) * period
    u = (x * np.cos(turn) + y * np.sin(turn) + wander * noise(rng, size, 1.5)) / period
    v = (y * np.cos(turn) - x * np.sin(turn) + wander * noise(rng, size, 1.5)) / period
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    over = (i + j) % 2 == 0
    height = np.where(over, np.abs(np.sin(np.pi * u)), np.abs(np.sin(np.pi * v)))
    uneven = rng.normal(0, rng.uniform(0, 0.15), (2, 4099))
    thread = np.where(over, uneven[0][i % 4099], uneven[1][j % 4099])
    deep = rng.uniform(0.05, 0.5)
    second = _colour(rng) if rng.random() < 0.3 else None
    base = _colour(rng)
    tone = base if second is None else np.where(over[..., None], base, second)
    return np.float32(tone * ((1 - deep * (1 - height)) * (1 + thread))[..., None])


def blotches(rng: Rng, size: int) -> Float32:
    """Camouflage, lichen, stains: two tones in blotches of one size, with sharp or soft borders."""
    radius = _log_uniform(rng, 1.5, 30)
    field = cv2.GaussianBlur(
        noise(rng, size, rng.uniform(0, 1), rng.choice([1.0, 3.0])), (0, 0), radius
    )
    field = field - cv2.GaussianBlur(field, (0, 0), rng.uniform(1.5, 6) * radius)
    share = 0.5 + 0.5 * np.tanh(_log_uniform(rng, 1, 20) * (field / (field.std() + 1e-9)))
    return np.float32(_colour(rng) + share[..., None] * (_colour(rng) - _colour(rng)))


def soft_pattern(rng: Rng, size: int) -> Float32:
    """Painted, printed or worn softly: a pattern without sharp borders on mostly sharp grain."""
    pattern = SOFTENED[rng.integers(len(SOFTENED))](rng, size)
    soft = cv2.GaussianBlur(pattern, (0, 0), _log_uniform(rng, 1.0, 7.0))
    if rng.random() < 0.85:
        soft = soft + _fine(rng, size)
    return np.asarray(soft, np.float32)


SOFTENED = (stripes, dead_leaves, glyphs, gravel, terrazzo, blotches, blotches)
"""What `soft_pattern` softens, each as often as it stands here."""


def smooth_wood(rng: Rng, size: int) -> Float32:
    """Planed, varnished wood: soft rings and long soft streaks under faint sharp pores."""
    angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
    y, x = np.mgrid[0:size, 0:size].astype(np.float32)
    across = y * np.cos(angle) - x * np.sin(angle)
    warp = rng.uniform(4, 40) * noise(rng, size, 2.2, rng.uniform(2, 8), angle)
    rings = np.sin(2 * np.pi * (across + warp) / _log_uniform(rng, 8, 90))
    streaks = noise(rng, size, rng.uniform(1.0, 2.0), rng.uniform(8, 40), angle)
    pores = noise(rng, size, rng.uniform(0, 0.5), rng.uniform(3, 12), angle)
    field = rng.uniform(0, 0.12) * rings + _log_uniform(rng, 0.01, 0.15) * streaks
    field = field + _log_uniform(rng, 0.002, 0.025) * pores
    brown = rng.uniform(0.15, 0.9) * np.array([1.0, rng.uniform(0.7, 0.95), rng.uniform(0.4, 0.9)])
    return np.float32(brown * (1 + field[..., None] * rng.uniform(0.7, 1.3, 3)))


GROUNDS: tuple[tuple[Callable[[Rng, int], Float32], float], ...] = (
    (self_similar, 0.18),
    (sand, 0.16),
    (gravel, 0.15),
    (relief, 0.14),
    (soft_pattern, 0.13),
    (smooth_wood, 0.08),
    (weave, 0.07),
    (terrazzo, 0.05),
    (blotches, 0.04),
)


def ground_surface(rng: Rng, size: int, photos: Photos) -> Float32:
    """One such surface (size, size, 3), scene-linear; a photograph on some."""
    if rng.random() < PHOTO_SHARE:
        return photos.crop(rng, size)
    draws, weights = zip(*GROUNDS, strict=True)
    code = draws[rng.choice(len(draws), p=weights)](rng, size)
    return to_linear(np.clip(code, 0.002, 1.0).astype(np.float32))
