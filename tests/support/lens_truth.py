"""What a real lens sees of tilted, textured slabs: the aperture sampled point by point.

A slab is a plane in space, so its signed CoC is affine in the pinhole picture: coc(p) = c0 + g . p.
From the point u of the aperture (|u| <= 1) the slab's point p appears at q = p + coc(p) / 2 * u,
which is solved for p exactly. The mean over the aperture is the blur, self-occlusion included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit


@dataclass(frozen=True, slots=True, kw_only=True)
class Slab:
    """A textured rectangle.

    Attributes:
        corners: x0, y0, x1, y1 in the pinhole picture [px].
        coc_px: signed CoC diameter at column 0, row 0 [px].
        slope: its change along a column step and a row step [px / px].
        seed: shifts the texture.
    """

    corners: tuple[float, float, float, float]
    coc_px: float
    slope: tuple[float, float] = (0.0, 0.0)
    seed: float = 0.0

    def row(self):
        return (*self.corners, self.coc_px, *self.slope, self.seed)


@njit
def _texture(x, y, seed, rgb):
    """Stripes, a checkerboard of 9 px askew to the pixels, a gradient: scene-linear, 0 to 1."""
    across, along = 0.104 * x + 0.038 * y, 0.104 * y - 0.038 * x
    check = 1.0 if (math.floor(across + seed) + math.floor(along)) % 2 else 0.0
    wave = 0.5 + 0.5 * math.sin(0.9 * x + 0.4 * y + seed)
    slow = 0.5 + 0.5 * math.sin(0.05 * x - 0.07 * y + 2.0 * seed)
    rgb[0] = 0.05 + 0.5 * check + 0.3 * slow
    rgb[1] = 0.04 + 0.3 * wave + 0.4 * slow * check
    rgb[2] = 0.1 + 0.6 * (1.0 - check) * wave + 0.2 * slow


@njit
def _nearest(slabs, qx, qy, ux, uy, rgb):
    """Colour of the nearest slab at q seen from u; its CoC, or -inf where there is none."""
    best = -np.inf
    for i in range(slabs.shape[0]):
        x0, y0, x1, y1, c0, gx, gy, seed = slabs[i]
        ax, ay = qx - 0.5 * ux * c0, qy - 0.5 * uy * c0
        shared = 0.5 * (gx * ax + gy * ay) / (1.0 + 0.5 * (ux * gx + uy * gy))
        px, py = ax - ux * shared, ay - uy * shared
        coc = c0 + gx * px + gy * py
        if x0 <= px < x1 and y0 <= py < y1 and coc > best:
            best = coc
            _texture(px, py, seed, rgb)
    return best


@njit
def _render(slabs, views, grid, out, coc):
    rgb = np.zeros(3)
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            nearest = -np.inf
            for k in range(views.shape[0]):
                for j in range(grid * grid):
                    # Each view has its own sub-pixel shift, so that few samples a view suffice.
                    sx = ((j % grid) + (k * 0.7548776662) % 1.0) / grid
                    sy = ((j // grid) + (k * 0.5698402910) % 1.0) / grid
                    if views.shape[0] == 1:
                        sx, sy = (j % grid + 0.5) / grid, (j // grid + 0.5) / grid
                    found = _nearest(slabs, x + sx, y + sy, views[k, 0], views[k, 1], rgb)
                    if found > -np.inf:
                        nearest = max(nearest, found)
                        for c in range(3):
                            out[y, x, c] += rgb[c]
                        out[y, x, 3] += 1.0
            if nearest > -np.inf:
                coc[y, x] = nearest
    out /= views.shape[0] * grid * grid


def pinhole(slabs, shape):
    """The sharp layer with 4x4 antialiasing (h, w, 4) and its nearest surface's CoC (h, w)."""
    out, coc = np.zeros((*shape, 4)), np.zeros(shape)
    _render(np.array([s.row() for s in slabs]), np.zeros((1, 2)), 4, out, coc)
    return out.astype(np.float32), coc.astype(np.float32)


def lens(slabs, shape, views=400):
    """The layer through the whole aperture (h, w, 4): a spiral of equal areas, 2x2 each view."""
    turn = np.arange(views) * math.pi * (3.0 - math.sqrt(5.0))
    radius = np.sqrt((np.arange(views) + 0.5) / views)
    spiral = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    out = np.zeros((*shape, 4))
    _render(np.array([s.row() for s in slabs]), spiral, 2, out, np.zeros(shape))
    return out.astype(np.float32)


def srgb8(linear):
    """Scene-linear to 8-bit sRGB."""
    linear = np.clip(linear, 0.0, 1.0)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255.0 * coded)


def psnr_over_plate(layer, truth):
    """PSNR of 8-bit sRGB where the blurred object's box is, over a smooth plate [dB]."""
    rows, columns = truth.shape[:2]
    ramp = np.add.outer(np.linspace(0.1, 0.4, rows), np.linspace(0.0, 0.3, columns))
    plate = ramp[..., None] * np.array([0.9, 1.0, 0.7])
    box = np.argwhere(truth[..., 3] > 0.0)
    (y0, x0), (y1, x1) = box.min(axis=0), box.max(axis=0) + 1
    seen = [srgb8(p[..., :3] + (1.0 - p[..., 3:]) * plate)[y0:y1, x0:x1] for p in (layer, truth)]
    return float(10.0 * np.log10(255.0**2 / np.mean((seen[0] - seen[1]) ** 2)))
