"""NumPy references of the kernels for shadows on filmed things."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.effects.shadow.light_views import LightViews
from nlens_video.effects.shadow.shadow_maps import ShadowMaps


def places_reference(views: LightViews, points: Float32) -> tuple[Float64, Float64, Float64]:
    """Columns, rows [px] and nearness to the light of points (M, 3) in each view, each (N, M)."""
    homogeneous = np.column_stack([points.astype(np.float64), np.ones(len(points))])
    column, row, depth = np.moveaxis(homogeneous @ views.matrices.swapaxes(1, 2), -1, 0)
    if views.far:
        return column, row, depth
    before = np.maximum(depth, 1e-6)
    return np.where(depth > 0.0, column / before, -1e4), row / before, -depth


def first_surfaces_reference(views: LightViews, points: Float32) -> tuple[Float64, Float64]:
    """`LightViews.first` and `nearest` from points of the casters (P, 3)."""
    columns, rows, nears = places_reference(views, points)
    _, high, wide = views.first.shape
    found = np.empty(views.first.shape)
    for number, side in enumerate(views.sides):
        near, own = nears[number], np.full((high, wide), -np.inf)
        for column, row, value in zip(columns[number], rows[number], near, strict=True):
            y = int(np.clip(row / side, 0, high - 1))
            x = int(np.clip(column / side, 0, wide - 1))
            own[y, x] = max(own[y, x], value)
        for y, x in np.ndindex(high, wide):
            around = own[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
            found[number, y, x] = max(around.max(), near.min())
    return found, nears.max(axis=1)


def may_block_reference(views: LightViews, points: Float32) -> Bool:
    """`LightViews.may_block`."""
    column, row, near = places_reference(views, points)
    width, height = views.sizes.T[..., None]
    inside = (column >= 0.0) & (row >= 0.0) & (column <= width) & (row <= height)
    return np.asarray((inside & (near < views.nearest[:, None])).any(axis=0))


def blocked_reference(
    maps: ShadowMaps, points: Float32, weights: tuple[Float32, Float32] | None
) -> Float64:
    """`blocked` for one of the maps (2, M)."""
    views = maps.views
    columns, rows, nears = places_reference(views, points)
    out = np.zeros((2, len(points)))
    for number, which in enumerate(views.numbers):
        weight = np.ones(len(points))
        if weights is not None:
            weight = np.maximum(weights[0].astype(np.float64) @ weights[1][which], 0.0)
        column = np.floor(columns[number] - views.at[number, 0] + 0.5).astype(int)
        row = np.floor(rows[number] - views.at[number, 1] + 0.5).astype(int)
        width, height = views.sizes[number]
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        x, y, side = column[inside], row[inside], views.sides[number]
        share = ((maps.bits[y, x] >> number) & 1).astype(np.float64)
        if len(maps.taken):
            share = np.where(share > 0.0, share, maps.taken[number, y, x])
        share *= nears[number][inside] < views.first[number, y // side, x // side]
        out[0, inside] += share * weight[inside]
        out[1] += weight
    return out


def best_slopes_reference(across: Float64, down: Float64, left: Float64, reach: int) -> Float64:
    """Slopes (h, w, 2) of the windows (h, w) around each pixel that leave least."""
    height, width = left.shape
    rows, columns = np.arange(height), np.arange(width)
    best, slopes = left, np.stack([across, down], axis=-1)
    for move_y in (0, -reach, reach):
        for move_x in (0, -reach, reach):
            at = np.ix_((rows + move_y).clip(0, height - 1), (columns + move_x).clip(0, width - 1))
            better = left[at] < best
            best = np.where(better, left[at], best)
            moved = np.stack([across[at], down[at]], axis=-1)
            slopes = np.where(better[..., None], moved, slopes)
    return slopes


def lost_light_reference(shares: Float32, given: Float64) -> Float64:
    """The loss (M, 3) of shares of light (n, M), by what each gives (n, M, 3)."""
    total = given.sum(axis=0)
    lost = (shares[..., None] * given).sum(axis=0)
    return np.asarray(np.divide(lost, total, out=np.zeros_like(total), where=total > 0.0))
