"""Sharp surfaces to be defocused: textures drawn by code and sharp crops of photographs.

All are scene-linear RGB (N, N, 3), float32, mostly in [0, 1]; every function draws from the given
generator only, so a seed names a picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

Float32 = npt.NDArray[np.float32]
Rng = np.random.Generator
TILE = 32
GRAINED_SHARE = 0.3
# smooth backgrounds that the measure of sharpness cannot tell from plain ones
DEFOCUSED = frozenset({"kodim04", "kodim07", "kodim23", "chelsea", "coffee"})
SHARP_RATIO = 0.7  # the photographs: 1.7 (median); after a CoC of 2 px: 0.9, of 3 px: 0.5


def to_linear(code: Float32) -> Float32:
    """Scene-linear light of display-coded sRGB."""
    low = code <= 0.04045
    return np.where(low, code / 12.92, ((np.maximum(code, 0.04045) + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


def noise(rng: Rng, size: int, slope: float, stretch: float = 1.0, angle: float = 0.0) -> Float32:
    """Gaussian noise of zero mean and unit deviation whose amplitude falls as frequency^-slope.

    Args:
        rng: source of chance.
        size: edge of the square [px].
        slope: exponent of the amplitude spectrum: 0 white, 1 as natural pictures, 2 smooth.
        stretch: how much longer the grain is along `angle` than across it, >= 1.
        angle: direction of the grain [rad].
    """
    fy, fx = (
        np.float32(axis) for axis in (fft.fftfreq(size)[:, None], fft.rfftfreq(size)[None, :])
    )
    cosine, sine = math.cos(angle), math.sin(angle)
    along, across = fx * cosine + fy * sine, fy * cosine - fx * sine
    radius = np.sqrt((along * float(stretch)) ** 2 + across**2) + 1.0 / size
    spectrum = fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    spectrum *= radius ** -float(slope)
    spectrum[0, 0] = 0
    field = fft.irfft2(spectrum, (size, size), overwrite_x=True)
    return (field / (field.std() + 1e-9)).astype(np.float32)


def _colour(rng: Rng) -> Float32:
    """A surface colour, often nearly grey, dark as often as bright (code values)."""
    grey = rng.uniform(0.04, 0.95)
    tint = rng.normal(0, rng.choice([0.02, 0.08, 0.25]), 3)
    return np.clip(grey + tint, 0.01, 0.99).astype(np.float32)


def _contrast(rng: Rng) -> float:
    """A contrast in code values, log-uniform from barely there to strong."""
    return float(np.exp(rng.uniform(np.log(0.006), np.log(0.35))))


def _grain(rng: Rng, size: int) -> Float32:
    """Noise of any slope, often whiter than a photograph's 1/f, as asphalt, carpet and gravel are.

    With one slope only the network would read the blur off the slope, and under-read it on these.
    """
    slope = rng.choice([rng.uniform(-0.3, 0.3), rng.uniform(0.2, 0.9), rng.uniform(0.7, 1.5)])
    stretch = 1.0 if rng.random() < 0.6 else float(np.exp(rng.uniform(0, np.log(12))))
    field = noise(rng, size, float(slope), stretch, rng.uniform(0, np.pi))
    if rng.random() < 0.3:  # speckle: few strong grains, as asphalt, terrazzo and sand have
        field = np.sign(field) * np.abs(field) ** rng.uniform(1.5, 3.0) * 0.6
    return field


def grained(rng: Rng, linear: Float32) -> Float32:
    """A surface with fine relief on top, (N, N, 3) in and out."""
    depth = np.exp(rng.uniform(np.log(0.008), np.log(0.35)))
    return np.maximum(linear * (1 + depth * _grain(rng, linear.shape[0]))[..., None], 0)


def fractal(rng: Rng, size: int) -> Float32:
    """Stone, plaster, cloth, asphalt: noise of any slope, contrast and direction."""
    base = _colour(rng)[None, None] + _contrast(rng) * _grain(rng, size)[..., None]
    if rng.random() < 0.5:
        base = base + _contrast(rng) * _grain(rng, size)[..., None] * rng.normal(0, 1, 3)
    return np.float32(base)


def wood(rng: Rng, size: int) -> Float32:
    """Planks: warped rings, long streaks and short dark pores, often of very low contrast."""
    angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
    y, x = np.mgrid[0:size, 0:size].astype(np.float32)
    across = y * np.cos(angle) - x * np.sin(angle)
    warp = noise(rng, size, 2.0, rng.uniform(2, 6), angle) * rng.uniform(2, 20)
    rings = np.sin(2 * np.pi * (across + warp) / rng.uniform(6, 60))
    streaks = noise(rng, size, rng.uniform(0.2, 0.9), rng.uniform(8, 40), angle)
    pores = np.minimum(0, noise(rng, size, 0.3, rng.uniform(4, 12), angle) + rng.uniform(0.5, 2))
    low = rng.choice([0.25, 1.0])
    field = low * (rng.uniform(0, 0.08) * rings + _contrast(rng) * 0.4 * streaks)
    field = field + rng.uniform(0, 0.1) * pores
    plank = _colour(rng)[None, None] * (1 + field[..., None] * rng.uniform(0.5, 1.5, 3))
    if rng.random() < 0.5:
        seam = np.abs((across + 1e4) % rng.uniform(30, 150)) < rng.uniform(0.7, 2.5)
        plank = np.where(seam[..., None], plank * rng.uniform(0.3, 0.8), plank)
    return np.float32(plank)


def stripes(rng: Rng, size: int) -> Float32:
    """Stripes, plaids, tiles and bricks with joints, over a little grain."""
    y, x = np.mgrid[0:size, 0:size].astype(np.float32)
    angle = rng.choice([0.0, rng.uniform(0, np.pi)])
    u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    pu, pv = np.exp(rng.uniform(np.log(3), np.log(70), 2))
    duty = rng.uniform(0.06, 0.6)
    kind = rng.integers(4)
    shift = np.floor(v / pv) * 0.5 * pu if kind == 3 else 0.0
    bars = ((u + shift) / pu) % 1 < duty
    cross = (v / pv) % 1 < duty * (pu / pv if kind == 3 else 1.0)
    mask = [bars, bars ^ cross, bars | cross, bars | cross][kind]
    first, second = _colour(rng), _colour(rng)
    if rng.random() < 0.35:
        second = first + rng.normal(0, 0.05, 3).astype(np.float32)
    grain = _contrast(rng) * _grain(rng, size)[..., None]
    return np.float32(np.where(mask[..., None], first, second) + 0.5 * grain)


def glyphs(rng: Rng, size: int) -> Float32:
    """Print: lines of letters in a few sizes on paper, a wall or a box."""
    canvas = np.float32(np.ones((size, size, 3)) * _colour(rng))
    canvas += _contrast(rng) * 0.3 * _grain(rng, size)[..., None]
    letters = list("ABCDEFGHIKLMNOPRSTUVWXYZabcdefghiklmnoprstuvwxyz0123456789&%#=+-/")
    for _ in range(int(rng.integers(1, 3))):
        mask = np.zeros((size, size), np.uint8)
        y = 0
        while y < size:
            scale = float(np.exp(rng.uniform(np.log(0.25), np.log(3.0))))
            thickness = max(1, int(scale * rng.uniform(0.8, 3)))
            for _ in range(int(rng.integers(1, 5))):
                y += int(26 * scale) + 3
                text = "".join(rng.choice(letters, int(rng.integers(3, 40))))
                origin = (int(rng.integers(-40, size // 2)), y)
                face = int(rng.choice([0, 2, 3, 4, 6]))
                cv2.putText(mask, text, origin, face, scale, 255, thickness, cv2.LINE_AA)
        canvas += (_colour(rng) - canvas) * (np.float32(mask) / 255)[..., None]
    return canvas


def dead_leaves(rng: Rng, size: int) -> Float32:
    """Overlapping shapes of power-law size, the standard model of natural occlusion statistics."""
    canvas = np.float32(np.ones((size, size, 3)) * _colour(rng))
    low = rng.uniform(1.5, 6)
    palette = [_colour(rng) for _ in range(int(rng.integers(2, 14)))]
    spread = rng.choice([1.0, rng.uniform(0.03, 0.5)])
    base = palette[0]
    for _ in range(int(rng.integers(60, 500))):
        radius = min(size / 3, low * rng.random() ** -rng.uniform(0.4, 0.9))
        colour = base + spread * (palette[rng.integers(len(palette))] - base)
        centre = rng.uniform(0, size, 2)
        corners = int(rng.integers(3, 9))
        angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
        if rng.random() < 0.4:
            angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        ring = np.stack([np.cos(angles), np.sin(angles) * rng.uniform(0.3, 1)], -1) * radius
        points = np.int32((centre + ring) * 16)
        cv2.fillPoly(canvas, [points], np.clip(colour, 0, 1).tolist(), cv2.LINE_AA, 4)
    return np.float32(canvas + 0.3 * _contrast(rng) * _grain(rng, size)[..., None])


def flat(rng: Rng, size: int) -> Float32:
    """Nothing to see: a constant, a gradient, a smooth shade, sometimes with the faintest grain."""
    y, x = (np.mgrid[0:size, 0:size] / size).astype(np.float32)
    ramp = rng.normal(0, 0.3) * x + rng.normal(0, 0.3) * y
    canvas = _colour(rng) * (1 + ramp[..., None] * rng.choice([0, 1]))
    if rng.random() < 0.4:
        canvas = canvas + 0.05 * noise(rng, size, 2.5)[..., None]
    if rng.random() < 0.3:
        canvas = canvas + 0.003 * _grain(rng, size)[..., None]
    return np.float32(canvas)


DRAWN: tuple[tuple[Callable[[Rng, int], Float32], float], ...] = (
    (fractal, 0.30),
    (wood, 0.16),
    (stripes, 0.17),
    (glyphs, 0.10),
    (dead_leaves, 0.19),
    (flat, 0.08),
)


def drawn(rng: Rng, size: int) -> Float32:
    """One drawn surface, or two joined along a ragged border."""
    draws = [draw for draw, _ in DRAWN]
    weights = [weight for _, weight in DRAWN]
    picks = rng.choice(len(draws), 2, p=weights)
    code = draws[picks[0]](rng, size)
    if rng.random() < 0.3:
        mask = noise(rng, size, rng.uniform(1.3, 2.5)) > rng.normal(0, 0.7)
        code = np.where(mask[..., None], draws[picks[1]](rng, size), code)
    return to_linear(np.clip(code, 0.002, 1.0).astype(np.float32))


@dataclass(frozen=True, slots=True)
class Photos:
    """Photographs, reduced so that their sharp parts are sharp to the pixel.

    Attributes:
        pictures: display-coded pictures, uint8 (H, W, 3).
        sharp: for each, tiles of TILE px: 1 sharp, 0 soft, -1 with too little texture to tell.
    """

    pictures: tuple[npt.NDArray[np.uint8], ...]
    sharp: tuple[npt.NDArray[np.int8], ...]

    @classmethod
    def load(cls, folder: Path, *, held_out: bool) -> Photos:
        """Read the training photographs, or the held-out sixth of them.

        Raises:
            FileNotFoundError: no picture in the sub-folders kodak, sharp, lowtexture, misc.
        """
        paths = [
            path
            for part in ("kodak", "lowtexture", "misc", "sharp")
            for path in sorted((folder / part).glob("*"))
            if path.suffix in (".png", ".jpg")
        ]
        if not paths:
            raise FileNotFoundError(
                f"{folder}: no photographs in kodak/, lowtexture/, misc/, sharp/"
            )
        chosen = [
            path
            for i, path in enumerate(paths)
            if (i % 6 == 5) == held_out and path.stem not in DEFOCUSED
        ]
        pictures, sharp = [], []
        for path in chosen:
            full = cv2.imread(str(path))[..., ::-1]
            for factor in (1.5, 2.0) if max(full.shape) < 1000 else (2.0, 2.6, 3.2):
                size = (int(full.shape[1] / factor), int(full.shape[0] / factor))
                picture = cv2.resize(full, size, interpolation=cv2.INTER_AREA)
                pictures.append(picture)
                sharp.append(sharp_tiles(picture))
        return cls(tuple(pictures), tuple(sharp))

    def crop(self, rng: Rng, size: int) -> Float32:
        """A sharp square, scene-linear (size, size, 3), mirrored where the picture is short."""
        for _ in range(20):
            index = int(rng.integers(len(self.pictures)))
            picture, tiles = self.pictures[index], self.sharp[index]
            height, width = picture.shape[:2]
            y, x = (int(rng.integers(max(1, n - size + 1))) for n in (height, width))
            seen = tiles[y // TILE : (y + size) // TILE, x // TILE : (x + size) // TILE]
            if (seen == 0).sum() <= 0.08 * max(1, (seen >= 0).sum()):
                break
        cut = picture[y : y + size, x : x + size]
        below, right = size - cut.shape[0], size - cut.shape[1]
        if below or right:
            cut = cv2.copyMakeBorder(cut, 0, below, 0, right, cv2.BORDER_REFLECT_101)
        turned = np.rot90(cut, int(rng.integers(4)))
        if rng.random() < 0.5:
            turned = turned[:, ::-1]
        return to_linear(np.float32(turned) / 255)


def sharp_tiles(picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.int8]:
    """Which tiles are sharp to the pixel: the finest octave holds its share of the energy.

    Defocus of more than about a pixel takes the finest octave away and leaves the next.
    """
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    bands = [grey] + [cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in (0.8, 1.6)]
    rows, columns = grey.shape[0] // TILE, grey.shape[1] // TILE

    def energy(band: Float32) -> Float32:
        square = (band * band)[: rows * TILE, : columns * TILE]
        return square.reshape(rows, TILE, columns, TILE).mean((1, 3))

    fine, coarse = energy(bands[0] - bands[1]), energy(bands[1] - bands[2])
    result = np.where(fine > SHARP_RATIO * coarse, 1, 0)
    return np.where(coarse < 1.5, -1, result).astype(np.int8)


def surface(rng: Rng, size: int, photos: Photos, photo_share: float) -> Float32:
    """One sharp surface (size, size, 3), scene-linear."""
    sharp = photos.crop(rng, size) if rng.random() < photo_share else drawn(rng, size)
    return grained(rng, sharp) if rng.random() < GRAINED_SHARE else sharp
