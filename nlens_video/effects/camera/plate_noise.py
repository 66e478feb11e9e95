"""The plate's noise, without what the scene shows.

With a still camera the noise is the difference between pictures, less what lamps and the exposure
change. Differences over one and two pictures give its temporal correlation r (compression freezes
noise): var(difference over 2) / var(difference over 1) = 1 + r. A single picture, or a moving
camera, leaves the smoothest blocks, whose residual is noise or fine texture; so they must agree
with each other as noise does.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Bool, Float32, Int64

LEAST_PIXELS = 600  # of a level, for its deviation to count
_FEW = np.s_[::2, ::2]  # pixels that tell the deviation
_KERNEL_SIDE_PX = 400  # of the middle part on which spatial correlation is measured
_CLIPPED = 3.0 / 255  # nearer to black or white, noise is cut off
_CUT_OFF = 0.5 / 255  # nearer to black or white, a single picture is cut off
_CELL_PX, _CELLS = 8, 5  # of the windows in which the light changes alike: side of a cell [px of
# every second column and row], cells along a side
_TELLING = 0.1  # share of a window's pixels that must count for its mean to tell of the light
_SAME_LIGHT = 0.25 / 255  # change of a window's mean that adds nothing to the noise
_FLAT = 1.0 / 255  # deviation of levels below which a window shows no slope
_MOST_PERSISTENCE = 0.9
_BLOCK_PX = 12
_SMOOTHEST = 0.06  # share of the blocks that counts as smooth
_AGREEMENT = 2.2  # ratio of variances within that share that noise alone does not reach
_WITHIN = 1.35  # times the mean variance: a block of noise alone seldom exceeds it
_ROUNDS = 8
_TEXTURE = 0.65  # correlation of neighbours beyond which a residual is texture


class PlateNoise(Struct, frozen=True, kw_only=True):
    """Noise of a plate.

    Attributes:
        few: by channel, picture and pixel (3, D, N), of every second column and row.
        levels: the light behind it (3, N).
        part: by channel (3, h, w), of all pixels of a part of the picture.
        part_levels: the light behind it (3, h, w).
        part_used: pixels (h, w) of the part that count.
        persistence: temporal correlation [1].
    """

    few: Float32
    levels: Float32
    part: Float32
    part_levels: Float32
    part_used: Bool
    persistence: float = 0.0


def noise_over_time(still: Sequence[Float32], same: Bool, end: float = 1.0) -> PlateNoise | None:
    """Noise of still pictures, None where there is none.

    Args:
        still: code values of each (H, W, 3).
        same: pixels (H, W) on which nothing moves.
        end: code value at which the plate clips.
    """
    mean = still[0] + still[1]
    least, most = np.minimum(still[0], still[1]), np.maximum(still[0], still[1])
    for code in still[2:]:
        mean += code
        np.minimum(least, code, out=least)
        np.maximum(most, code, out=most)
    mean /= np.float32(len(still))
    used = same & _between(_CLIPPED, mean, mean, end) & _between(_CUT_OFF, least, most, end)
    pairs = list(pairwise(still))
    if len(pairs) * used.sum() < LEAST_PIXELS or not any(
        _any_of(after != before, used) for before, after in pairs
    ):
        return None
    still = _in_one_light(still, mean, used)
    counted = np.flatnonzero(used[_FEW])
    codes = _by_channel(np.stack([_picked(code, counted) for code in still]))
    once, twice = (codes[:, lag:] - codes[:, :-lag] for lag in (1, 2))
    persistence = 0.0
    if len(still) > 2 and counted.size:
        ratio = np.square(twice).mean() / max(np.square(once).mean(), 1e-12)
        persistence = float(np.clip(ratio - 1.0, 0.0, _MOST_PERSISTENCE))
    # the variance of a difference is twice that of the noise, less the correlated part
    scale = np.float32(1.0 / np.sqrt(2.0 * (1.0 - persistence)))
    # the differences lie on top of each other
    part = _middle(np.concatenate([used] * len(pairs)))
    before, after, part_levels, part_used = (
        _stacked_part(pictures, part)
        for pictures in (still[:-1], still[1:], [mean] * len(pairs), [used] * len(pairs))
    )
    return PlateNoise(
        few=scale * once,
        levels=_by_channel(_picked(mean, counted)),
        part=_by_channel(scale * (after - before)),
        part_levels=_by_channel(part_levels),
        part_used=part_used,
        persistence=persistence,
    )


def _between(margin: float, least: Float32, most: Float32, end: float) -> Bool:
    """Pixels (H, W) that keep a margin to black and to the end of the code in all channels."""
    darkest = np.minimum(np.minimum(least[..., 0], least[..., 1]), least[..., 2])
    brightest = np.maximum(np.maximum(most[..., 0], most[..., 1]), most[..., 2])
    return np.asarray((darkest > margin) & (brightest < end - margin))


def _in_one_light(still: Sequence[Float32], mean: Float32, used: Bool) -> list[Float32]:
    """Pictures (H, W, 3) in the light of the mean of all, their noise unchanged.

    A change of the light varies slowly over the picture, and in display code it is nearly linear in
    the level. So the least-squares line of change against level, in windows far larger than grain,
    is the light, and what it leaves is noise. A picture in the light of the mean stays as it is.

    Args:
        still: the pictures.
        mean: of all.
        used: pixels (H, W) that count.
    """
    counted = np.repeat(used[_FEW][..., None], 3, axis=2).astype(np.float32)
    share = np.maximum(_over_windows(counted), np.float32(1e-6))
    few_mean = np.ascontiguousarray(mean[_FEW])
    counted_mean = counted * few_mean
    level = _over_windows(counted_mean) / share
    spread = _over_windows(counted_mean * few_mean) / share - level * level + np.float32(_FLAT**2)
    size = mean.shape[1], mean.shape[0]
    found = []
    for code in still:
        change = code[_FEW] - few_mean
        shift = _over_windows(counted * change) / share
        if np.abs(shift[share > _TELLING]).max(initial=0.0) < _SAME_LIGHT:
            found.append(code)
            continue
        slope = (_over_windows(counted_mean * change) / share - level * shift) / spread
        offset = shift - slope * level
        light = cv2.resize(slope, size) * mean + cv2.resize(offset, size)
        found.append(np.asarray(code - light, np.float32))
    return found


def _over_windows(values: Float32) -> Float32:
    """Means (h, w, 3) over windows round the cells of a picture (H, W, 3)."""
    height, width, _ = values.shape
    cells = max(1, width // _CELL_PX), max(1, height // _CELL_PX)
    small = cv2.resize(values, cells, interpolation=cv2.INTER_AREA)
    means = cv2.blur(small, (_CELLS, _CELLS), borderType=cv2.BORDER_REFLECT)
    return np.asarray(means, np.float32)


def _picked(pixels: Float32, at: Int64) -> Float32:
    """Some (N, 3) of every second column and row of a picture, by flat index among these."""
    return pixels[_FEW].reshape(-1, 3).take(at, axis=0)


def _by_channel(pixels: Float32) -> Float32:
    """Channels (3, ...) of pixels (..., 3), each contiguous, on which NumPy is much faster."""
    return np.ascontiguousarray(np.moveaxis(pixels, -1, 0))


def _stacked_part(
    pictures: Sequence[npt.NDArray[Any]], part: tuple[slice, slice]
) -> npt.NDArray[Any]:
    """A part of pictures (H, W, ...) that lie on top of each other."""
    rows, columns = part
    tops = range(0, len(pictures) * len(pictures[0]), len(pictures[0]))
    return np.concatenate([
        picture[max(0, rows.start - top) : max(0, rows.stop - top), columns]
        for top, picture in zip(tops, pictures, strict=True)
    ])  # fmt: skip


def _any_of(marked: Bool, used: Bool) -> bool:
    """Whether any channel of the pixels (H, W, 3) that are used is marked."""
    return any(bool((marked[..., c] & used).any()) for c in range(3))


def noise_in_space(code: Float32, end: float = 1.0) -> PlateNoise | None:
    """Noise of the smoothest blocks of one picture, None where there is none.

    Args:
        code: its code values (H, W, 3).
        end: code value at which the plate clips.
    """
    size = _BLOCK_PX
    rows, columns = (side // size for side in code.shape[:2])
    tiles = code[: rows * size, : columns * size].reshape(rows, size, columns, size, 3)
    blocks = np.ascontiguousarray(tiles.transpose(0, 2, 4, 1, 3))
    blocks = blocks.reshape(rows, columns, 3, size**2)
    level = blocks.mean(axis=3, keepdims=True)
    # less what rises along the columns, the rows or both, which are orthogonal to each other
    ramp = np.linspace(-1.0, 1.0, size, dtype=np.float32)
    ramp /= np.sqrt(np.mean(np.square(ramp)))
    flat = np.ones_like(ramp)
    slopes = np.stack(
        [np.outer(*pair).ravel() for pair in ((ramp, flat), (flat, ramp), (ramp, ramp))]
    )
    rest = (blocks - level).reshape(-1, size**2)
    rest = (rest - (rest @ slopes.T / np.float32(size**2)) @ slopes).reshape(blocks.shape)
    used = _smoothest(level[..., 0], rest, end)
    if used.sum() * size**2 < LEAST_PIXELS or not (rest[used] != 0.0).any():
        return None
    residual, levels = (
        part.reshape(rows, columns, 3, size, size).transpose(2, 0, 3, 1, 4)
        .reshape(3, rows * size, columns * size)
        for part in (rest, np.broadcast_to(level, rest.shape))
    )  # fmt: skip
    pixels = np.repeat(np.repeat(used, size, axis=0), size, axis=1)
    few, few_levels = (part[:, *_FEW][:, pixels[_FEW]] for part in (residual, levels))
    middle = _middle(pixels)
    return PlateNoise(
        few=few[:, None],
        levels=few_levels,
        part=residual[:, *middle],
        part_levels=levels[:, *middle],
        part_used=pixels[middle],
    )


def _smoothest(level: Float32, rest: Float32, end: float) -> Bool:
    """The blocks (R, C) of a picture that show nothing but noise, if any.

    Args:
        level: of each channel of each block (R, C, 3).
        rest: what is left of its pixels (R, C, 3, P).
        end: code value at which the plate clips.
    """
    unclipped = (level > _CLIPPED) & (level < end - _CLIPPED)
    free, partly = unclipped.all(axis=2), unclipped.any(axis=2)
    used = np.zeros(free.shape, np.bool_)
    if free.any():
        total = np.square(rest).mean(axis=3).sum(axis=2)
        # where a channel is clipped nearly everywhere, as in a saturated sky, the few other blocks
        # are not the picture's smoothest
        share = min(1.0, _SMOOTHEST * partly.sum() / free.sum())
        low, high = np.quantile(total[free], [0.25 * share, share])
        if high < _AGREEMENT * low:
            used = free & (total <= _ceiling(total[free], high))
            if _smoothness(rest[used].reshape(-1, _BLOCK_PX, _BLOCK_PX)) > _TEXTURE:
                used[:] = False
    return used


def _smoothness(blocks: Float32) -> float:
    """Correlation of neighbouring pixels (N, h, w), which is small for noise."""
    energy = float(np.square(blocks).mean())
    if not energy > 0.0:
        return 1.0
    beside = (blocks[..., 1:] * blocks[..., :-1]).mean()
    below = (blocks[:, 1:] * blocks[:, :-1]).mean()
    return float(0.5 * (beside + below)) / energy


def _ceiling(variances: Float32, start: float) -> float:
    """Largest variance of smooth blocks; the smoothest alone would underestimate the noise."""
    ceiling = start
    for _ in range(_ROUNDS):
        ceiling = _WITHIN * float(variances[variances <= ceiling].mean())
    return ceiling


def _middle(used: Bool) -> tuple[slice, slice]:
    """The part of a map round the middle of what is used."""
    parts = []
    for axis in (0, 1):
        counts = np.cumsum(used.sum(axis=1 - axis))
        centre = int(np.searchsorted(counts, 0.5 * counts[-1]))
        start = max(0, min(centre - _KERNEL_SIDE_PX // 2, used.shape[axis] - _KERNEL_SIDE_PX))
        parts.append(slice(start, start + _KERNEL_SIDE_PX))
    return parts[0], parts[1]
