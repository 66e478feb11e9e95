"""Patches of the ground: what F reads in each, and where on the ground it lies.

A patch is a square of the picture in which the ground's depth is about constant.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import CocMap, Float32, Float64
from nlens_video.scene.camera import Camera
from nlens_video.stages.texture.spectra import Part

CELL_PX = 16
"""Side of a cell, over which F's readings are averaged."""
PATCH_CELLS = 3
"""Cells along the side of a patch."""
PATCH_PX = CELL_PX * PATCH_CELLS
"""Side of a patch."""
READINGS = 3
"""Numbers that tell what F reads in a patch."""
PLACE = 6
"""Numbers that tell where a patch lies; see `places`."""
FARTHEST_SHARE = 0.02
"""Disparity, by the object's, below which ground is too far away to be read."""
_UNIT_PX = 256.0  # of places in the picture


class Patches(Struct, frozen=True, kw_only=True, eq=False):
    """Patches of the ground.

    Attributes:
        readings: mean and deviation of log(1 + CoC), mean of log(sigma / (1 + CoC)) (P, READINGS).
        places: where they lie (P, PLACE).
    """

    readings: Float32
    places: Float32


def ground_patches(
    cells: Float32, size: tuple[int, int], camera: Camera, ground_y: float, middle: float,
    part: Part | None = None,
) -> Patches:  # fmt: skip
    """The patches of a picture that show the ground plane.

    Args:
        cells: F's readings as of a `CocMap` (rows, columns, READINGS).
        size: columns and rows of the picture, without the margin of the cells [px].
        camera: of a picture of that size.
        ground_y: height of the ground [scene unit].
        middle: disparity of the ground where the object stands [1 / scene unit].
        part: in which their middles lie, None for the whole picture.
    """
    width, height = size
    readings = patch_readings(cells[: height // CELL_PX, : width // CELL_PX])
    x, y = patch_middles(width, height)
    disparity = camera.disparity_at(x, y, ground_y)
    seen = disparity > FARTHEST_SHARE * middle
    if part is not None:
        seen &= part(*np.meshgrid(x, y))
    ends = camera.disparity_at(np.array([0.0, 1.0]), np.array([0.0, 1.0]), ground_y)
    slant = float(np.hypot(ends[0, 1] - ends[0, 0], ends[1, 0] - ends[0, 0]))
    where = places(disparity / middle, slant / middle, x - 0.5 * width, y - 0.5 * height)
    return Patches(readings=readings[seen], places=where[seen])


def reading_cells(coc: CocMap, width: int) -> Float32 | None:
    """F's readings in cells of CELL_PX of a picture, as of a `CocMap`.

    Args:
        coc: of that picture, perhaps coarser.
        width: columns of the picture [px].

    Returns:
        None where a cell is no whole number of pixels of the maps.
    """
    rows, columns = coc.coc_px.shape
    side = CELL_PX * columns // width
    if side * width != CELL_PX * columns:
        return None
    used = np.s_[: rows // side * side, : columns // side * side]
    log_coc = np.log1p(coc.coc_px[used])
    log_scale = np.log(coc.sigma_px[used]) - log_coc
    values = np.stack([log_coc, np.square(log_coc), log_scale], axis=-1)
    cells = values.reshape(rows // side, side, columns // side, side, READINGS)
    return np.asarray(cells.mean(axis=(1, 3)), np.float32)


def patch_readings(cells: Float32) -> Float32:
    """Readings in the patches (rows, columns, READINGS) of the cells of a whole picture.

    The mean square of log(1 + CoC) becomes its deviation.
    """
    rows, columns = (count // PATCH_CELLS for count in cells.shape[:2])
    top, left = (
        (count - PATCH_CELLS * patches) // 2
        for count, patches in zip(cells.shape[:2], (rows, columns), strict=True)
    )
    used = cells[top : top + PATCH_CELLS * rows, left : left + PATCH_CELLS * columns]
    parts = used.reshape(rows, PATCH_CELLS, columns, PATCH_CELLS, READINGS)
    readings = np.asarray(parts.mean(axis=(1, 3)), np.float32)
    variance = readings[..., 1] - np.square(readings[..., 0])
    readings[..., 1] = np.sqrt(np.maximum(variance, 0.0))
    return readings


def patch_middles(width: int, height: int) -> tuple[Float64, Float64]:
    """Columns and rows of the middles of a picture's patches [px]."""
    columns, rows = (_middles(extent // CELL_PX) for extent in (width, height))
    return columns, rows


def _middles(cells: int) -> Float64:
    """Middles of the patches along a line of cells [px]."""
    count = cells // PATCH_CELLS
    first = CELL_PX * ((cells - PATCH_CELLS * count) // 2)
    return np.asarray(first + PATCH_PX * (np.arange(count) + 0.5))


def places(disparity: Float64, slant: float, x: Float64, y: Float64) -> Float32:
    """Where patches lie (rows, columns, PLACE), in units in which the object's disparity is 1.

    Args:
        disparity: of the ground plane at their middles (rows, columns) [1].
        slant: change of it from pixel to pixel along its gradient [1 / px].
        x: columns of their middles from the middle of the picture (columns,) [px].
        y: likewise rows (rows,) [px].
    """
    near = np.maximum(disparity, 1e-3)
    across, down = np.meshgrid(x / _UNIT_PX, y / _UNIT_PX)
    return np.stack(
        [
            np.log(near),
            np.minimum(near, 4.0),
            0.3 / np.maximum(near, 0.1),
            np.log(np.clip(slant * PATCH_PX / near, 1e-4, 10.0)),
            across,
            down,
        ],
        axis=-1,
    ).astype(np.float32)
