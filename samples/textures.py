"""Textures painted with numpy; grounds are linear colour (N, N, 3) and height (N, N), tileable."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def spectral_noise(size: int, falloff: float, seed: int) -> Floats:
    """Tileable noise (size, size), zero mean, unit deviation, amplitude ~ frequency^-falloff."""
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :]
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((size, size))) * frequency**-falloff
    noise = np.fft.irfft2(spectrum, s=(size, size))
    return np.asarray((noise - noise.mean()) / noise.std())


def _smooth(distance: Floats, width: float) -> Floats:
    """1 where distance < 0, 0 where it is > width."""
    t = np.clip(1.0 - distance / width, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _paint(colour: Floats, mask: Floats, paint: tuple[float, float, float]) -> None:
    colour += mask[..., None] * (np.array(paint) - colour)


def encaustic_tiles(size: int, tiles: int, seed: int) -> tuple[Floats, Floats]:
    """Worn patterned cement tiles, `tiles` a side."""
    rng = np.random.default_rng(seed)
    axis = (np.arange(size) + 0.5) / size * tiles
    u = np.broadcast_to(2.0 * (axis % 1.0)[None, :] - 1.0, (size, size))
    v = u.T
    index = axis.astype(int)
    corner = np.hypot(1.0 - np.abs(u), 1.0 - np.abs(v))
    radius = np.hypot(u, v)
    square, diamond = np.maximum(abs(u), abs(v)), (abs(u) + abs(v)) / np.sqrt(2.0)
    soft = 6.0 * tiles / size
    cream, blue, red, ochre = (
        (0.60, 0.50, 0.35),
        (0.030, 0.085, 0.19),
        (0.33, 0.075, 0.035),
        (
            0.52,
            0.27,
            0.06,
        ),
    )
    colour = np.empty((size, size, 3))
    colour[:] = cream
    for mask, paint in (
        (_smooth(abs(corner - 0.66) - 0.12, soft), blue),
        (_smooth(abs(corner - 0.86) - 0.020, soft), red),
        (_smooth(abs(corner - 0.47) - 0.015, soft), red),
        (_smooth(corner - 0.34, soft), ochre),
        (_smooth(corner - 0.24, soft), cream),
        (_smooth(corner - 0.15, soft), blue),
        (_smooth(np.minimum(square, diamond) - 0.30, soft), red),
        (_smooth(np.minimum(square, diamond) - 0.23, soft), cream),
        (_smooth(radius - 0.17, soft), blue),
        (_smooth(radius - 0.075, soft), ochre),
    ):
        _paint(colour, mask, paint)
    tone = rng.uniform(0.80, 1.12, (tiles, tiles, 1)) * rng.uniform(0.95, 1.05, (tiles, tiles, 3))
    colour *= tone[index[:, None], index[None, :]]
    wear, speckle = spectral_noise(size, 1.3, seed + 1), spectral_noise(size, 0.45, seed + 2)
    colour *= np.clip(1.0 + 0.13 * wear + 0.10 * speckle, 0.3, 1.5)[..., None]
    stains = spectral_noise(size, 1.8, seed + 3)
    _paint(colour, 0.45 * _smooth(1.1 - stains, 0.8), (0.20, 0.15, 0.10))
    chips = spectral_noise(size, 0.8, seed + 4)
    _paint(colour, 0.7 * _smooth(2.35 - chips, 0.15), (0.46, 0.42, 0.36))
    rim = 1.0 - square + 0.004 * spectral_noise(size, 0.9, seed + 5)
    grout = _smooth(rim - 0.020, 0.012)
    _paint(colour, grout, (0.16, 0.13, 0.10))
    height = -1.0 * grout + 0.10 * wear + 0.10 * speckle - 0.5 * _smooth(2.35 - chips, 0.15)
    return np.clip(colour, 0.01, 0.9), height


def herringbone_bricks(size: int, cells: int, seed: int) -> tuple[Floats, Floats]:
    """Clay pavers in herringbone bond; `cells` half bricks a side, a multiple of 4."""
    rng = np.random.default_rng(seed)
    axis = (np.arange(size) + 0.5) / size * cells
    cell, part = axis.astype(int), axis % 1.0
    i, j = (
        np.broadcast_to(cell[None, :], (size, size)),
        np.broadcast_to(cell[:, None], (size, size)),
    )
    u, v = (
        np.broadcast_to(part[None, :], (size, size)),
        np.broadcast_to(part[:, None], (size, size)),
    )
    code = (i - j) % 4
    edge_u, edge_v = np.minimum(u, 1.0 - u), np.minimum(v, 1.0 - v)
    edge_u = np.where(code == 0, u, np.where(code == 1, 1.0 - u, edge_u))
    edge_v = np.where(code == 3, v, np.where(code == 2, 1.0 - v, edge_v))
    first_i = np.where(code == 1, i - 1, i) % cells
    first_j = np.where(code == 2, j - 1, j) % cells
    rough = spectral_noise(size, 1.0, seed + 1)
    edge = np.minimum(edge_u, edge_v) + 0.012 * rough
    palette = np.array(
        [
            (0.36, 0.13, 0.07),
            (0.43, 0.20, 0.11),
            (0.22, 0.085, 0.06),
            (0.47, 0.30, 0.19),
            (0.17, 0.13, 0.12),
        ]
    )
    bricks = palette[rng.integers(0, len(palette), (cells, cells))]
    bricks = bricks * rng.uniform(0.75, 1.2, (cells, cells, 1))
    colour = bricks[first_j, first_i]
    speckle, wear = spectral_noise(size, 0.35, seed + 2), spectral_noise(size, 1.4, seed + 3)
    colour *= np.clip(1.0 + 0.22 * speckle + 0.15 * wear, 0.25, 1.8)[..., None]
    grit = spectral_noise(size, 0.6, seed + 4)
    _paint(colour, 0.75 * _smooth(1.9 - grit, 0.3), (0.55, 0.47, 0.37))
    _paint(colour, 0.75 * _smooth(1.9 + grit, 0.3), (0.06, 0.05, 0.045))
    joint = _smooth(edge - 0.055, 0.035)
    moss = _smooth(0.4 - spectral_noise(size, 1.2, seed + 5), 0.5)[..., None]
    sand = np.array((0.11, 0.085, 0.06)) * (1.0 - moss) + np.array((0.075, 0.115, 0.03)) * moss
    colour += joint[..., None] * (sand * (1.0 + 0.3 * speckle[..., None]) - colour)
    height = -1.3 * joint + 0.15 * rough + 0.12 * speckle
    return np.clip(colour, 0.01, 0.9), height


def put(picture: Floats, distance: Floats, colour: tuple[float, float, float], soft: float) -> None:
    """Paint over (H, W, 3) where a signed distance is negative, with a soft edge."""
    mask = np.clip(0.5 - distance / soft, 0.0, 1.0)[..., None]
    picture += mask * (np.array(colour) - picture)
