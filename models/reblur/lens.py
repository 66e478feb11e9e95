"""The truth: flat, textured shapes seen through a lens whose aperture is sampled point by point.

A flat shape is a plane in space, so its signed CoC is affine in the pinhole picture,
coc(p) = c + g . p. From the point u of the aperture, |u| <= 1, its point p appears at
q = p + coc(p) / 2 * u, which is solved for p exactly; the nearest shape hides the others. The mean
over the aperture is the blur, with all that parts of the object hide from each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]
UInt8 = npt.NDArray[np.uint8]

FINE = 3  # mask samples a pixel
SUB_PIXELS = 4  # samples a pixel of the pinhole picture, each way
GRID = 176  # edge of the pinhole picture [px]
CROP = 128  # edge of its middle, where the truth is known [px]
LARGEST_COC_PX = 40.0  # so that a disc reaches no farther than (GRID - CROP) / 2 and a bit


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A flat, textured shape.

    Attributes:
        mask: where it is, > 0, FINE samples a pixel (FINE * GRID, FINE * GRID).
        texture: scene-linear RGB (GRID, GRID, 3).
        coc_px: signed CoC diameter at column 0, row 0 [px].
        slope: its change along a column and along a row [px / px].
    """

    mask: UInt8
    texture: Float32
    coc_px: float
    slope: tuple[float, float]


# Of every shape: mask, texture, CoC at the corner with its slope (n, 3), and the bounds of what can
# be seen of it (n, 4) [px].
Packed = tuple[UInt8, Float32, Float64, Float64]


@njit(cache=True)
def _sample(
    shapes: Packed, active: npt.NDArray[np.int64], count: int, q: Float64, u: Float64, rgb: Float64
) -> float:
    """Colour of the nearest shape at q seen from u; its CoC, or -inf where there is none."""
    masks, textures, planes, _ = shapes
    grid = textures.shape[1]
    best, at, bx, by = -np.inf, -1, 0.0, 0.0
    for k in range(count):
        i = active[k]
        c0, gx, gy = planes[i]
        ax, ay = q[0] - 0.5 * u[0] * c0, q[1] - 0.5 * u[1] * c0
        shared = 0.5 * (gx * ax + gy * ay) / (1.0 + 0.5 * (u[0] * gx + u[1] * gy))
        px, py = ax - u[0] * shared, ay - u[1] * shared
        if px < 0.0 or py < 0.0 or px >= grid or py >= grid:
            continue
        coc = c0 + gx * px + gy * py
        if coc > best and masks[i, int(py * FINE), int(px * FINE)] > 0:
            best, at, bx, by = coc, i, px, py
    if at < 0:
        return best
    x, y = min(max(bx - 0.5, 0.0), grid - 1.001), min(max(by - 0.5, 0.0), grid - 1.001)
    i, j = int(x), int(y)
    x -= i
    y -= j
    for c in range(3):
        above = textures[at, j, i, c] * (1 - x) + textures[at, j, i + 1, c] * x
        below = textures[at, j + 1, i, c] * (1 - x) + textures[at, j + 1, i + 1, c] * x
        rgb[c] = above * (1 - y) + below * y
    return best


@njit(cache=True)
def _seen_near(boxes: Float64, x: int, y: int, active: npt.NDArray[np.int64]) -> int:
    """List the shapes that some point of the aperture sees at a pixel; how many."""
    count = 0
    for i in range(boxes.shape[0]):
        x0, y0, x1, y1 = boxes[i]
        if x0 <= x <= x1 and y0 <= y <= y1:
            active[count] = i
            count += 1
    return count


@njit(cache=True)
def _render(shapes: Packed, views: Float64, corner: int, out: Float64, coc: Float64) -> None:
    rgb, q = np.zeros(3), np.zeros(2)
    active = np.zeros(shapes[0].shape[0], np.int64)
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            cx, cy = x + corner, y + corner
            count = _seen_near(shapes[3], cx, cy, active)
            if count == 0:
                continue
            nearest = -np.inf
            for k in range(views.shape[0]):
                q[0], q[1] = cx + views[k, 2], cy + views[k, 3]
                found = _sample(shapes, active, count, q, views[k], rgb)
                if found > -np.inf:
                    nearest = max(nearest, found)
                    for c in range(3):
                        out[y, x, c] += rgb[c]
                    out[y, x, 3] += 1.0
            if nearest > -np.inf:
                coc[y, x] = nearest
    out /= views.shape[0]


def _packed(shapes: Sequence[Shape], views: Float64) -> Packed:
    planes = np.array([(s.coc_px, *s.slope) for s in shapes], np.float64)
    reach = 0.5 * LARGEST_COC_PX * float(np.abs(views[:, :2]).max()) + 1
    boxes = np.empty((len(shapes), 4))
    for box, shape in zip(boxes, shapes, strict=True):
        rows, columns = (np.flatnonzero(shape.mask.any(axis)) for axis in (1, 0))
        ends = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1) if rows.size else (1, 1, 0, 0)
        box[:] = np.array(ends) / FINE + np.array([-reach, -reach, reach, reach])
    masks = np.stack([s.mask for s in shapes])
    return masks, np.stack([s.texture for s in shapes]), planes, boxes


def pinhole(shapes: Sequence[Shape]) -> tuple[Float32, Float32]:
    """The sharp layer (GRID, GRID, 4), antialiased, and the CoC of its nearest surface [px]."""
    steps = (np.arange(SUB_PIXELS) + 0.5) / SUB_PIXELS
    views = np.array([(0.0, 0.0, x, y) for y in steps for x in steps])
    out, coc = np.zeros((GRID, GRID, 4)), np.zeros((GRID, GRID))
    _render(_packed(shapes, views), views, 0, out, coc)
    return out.astype(np.float32), coc.astype(np.float32)


def through_lens(shapes: Sequence[Shape], views: int) -> Float32:
    """The middle (CROP, CROP, 4) of the layer as the whole aperture sees it.

    Args:
        shapes: the object.
        views: points of the aperture, a spiral of equal areas, each with its own sub-pixel shift.
    """
    k = np.arange(views)
    turn, radius = k * math.pi * (3.0 - math.sqrt(5.0)), np.sqrt((k + 0.5) / views)
    shifts = (0.5 + k * 0.7548776662) % 1.0, (0.5 + k * 0.5698402910) % 1.0
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), *shifts], 1)
    out = np.zeros((CROP, CROP, 4))
    _render(_packed(shapes, points), points, (GRID - CROP) // 2, out, np.zeros((CROP, CROP)))
    return out.astype(np.float32)
