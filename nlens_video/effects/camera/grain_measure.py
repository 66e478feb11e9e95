"""Measures grain: the plate's noise by level and channel, its spatial and temporal correlation.

With a still camera the noise is the difference between pictures. Differences over one and two
pictures give its temporal correlation r (compression freezes noise): var(difference over 2) /
var(difference over 1) = 1 + r. A single picture, or a moving camera, leaves the smoothest blocks,
whose residual is noise or fine texture; so they must agree with each other as noise does, and the
threshold is higher.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlens_video.core.layers import Bool, Float32, Float64, Picture
from nlens_video.effects.camera.grain import LAGS, GrainModel
from nlens_video.effects.measurement import Measurement, middle_codes
from nlens_video.stages.f_coc import still_run

EFFECT = "grain"
THRESHOLD = 0.6  # 8-bit levels: what remains visible after rounding to them
_SINGLE_FACTOR = 2.5  # on the threshold, for a single picture
_LEVELS = 12
_LEAST_PIXELS = 600  # of a level, for its deviation to count
_PICTURES = 5
_KERNEL_SIDE_PX = 400  # of the middle part on which spatial correlation is measured
_CLIPPED = 3.0 / 255  # nearer to black or white, noise is cut off
_OUTLIER = 4.0  # deviations beyond which a change is no noise
_MOST_PERSISTENCE = 0.9
_BLOCK_PX = 12
_SMOOTHEST = 0.06  # share of the blocks that counts as smooth
_AGREEMENT = 2.2  # ratio of variances within that share that noise alone does not reach
_WITHIN = 1.35  # times the mean variance: a block of noise alone seldom exceeds it
_ROUNDS = 8
_TEXTURE = 0.65  # correlation of neighbours beyond which a residual is texture
_COST_MS_PER_MEGAPIXEL = 90.0  # measured, of the object's box
_BOX_SHARE = 0.15  # of the frame, that an object's box is taken to cover


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on a shot's first pictures, at least one."""
    codes = [middle_codes(picture) for picture in pictures[:_PICTURES]]
    still, same = still_run(codes)
    if len(still) > 1:
        residual, levels, used, persistence = _over_time(still, same)
        threshold, evidence = THRESHOLD, f"noise between {len(still)} pictures of a still camera"
    else:
        residual, levels, used, persistence = _in_space(codes[0])
        threshold = THRESHOLD * _SINGLE_FACTOR
        evidence = "noise in the smoothest parts of one picture"
    model = None
    value = 0.0
    if used.sum() >= _LEAST_PIXELS and _any_of(residual, used):
        model = _model(residual, levels, used, persistence)
        value = 255.0 * float(np.sqrt(np.mean(np.square(model.deviation))))
    else:
        evidence += ": none to be seen"
    height, width = pictures[0].height, pictures[0].width
    return Measurement(
        effect=EFFECT, value=value, threshold=threshold, unit="8-bit levels", evidence=evidence,
        model=model, cost_ms=_COST_MS_PER_MEGAPIXEL * _BOX_SHARE * width * height / 1e6,
    )  # fmt: skip


def _over_time(still: Sequence[Float32], same: Bool) -> tuple[Float32, Float32, Bool, float]:
    """Noise of still pictures, its level, the pixels that count, and the temporal correlation."""
    mean = still[0] + still[1]
    for code in still[2:]:
        mean += code
    mean /= np.float32(len(still))
    red, green, blue = mean[..., 0], mean[..., 1], mean[..., 2]
    used = same & (np.minimum(np.minimum(red, green), blue) > _CLIPPED)
    used &= np.maximum(np.maximum(red, green), blue) < 1.0 - _CLIPPED
    first = [after - before for before, after in zip(still[:-1], still[1:], strict=True)]
    persistence = 0.0
    if len(still) > 2 and used[::2, ::2].any():
        few = np.s_[::2, ::2]
        counted, codes = used[few], [code[few] for code in still]
        second = [after - before for before, after in zip(codes[:-2], codes[2:], strict=True)]
        once, twice = (
            np.mean([np.square(d[counted]).mean() for d in ds])
            for ds in ([difference[few] for difference in first], second)
        )
        persistence = float(np.clip(twice / max(once, 1e-12) - 1.0, 0.0, _MOST_PERSISTENCE))
    # the variance of a difference is twice that of the noise, less the correlated part
    scale = np.float32(1.0 / np.sqrt(2.0 * (1.0 - persistence)))
    residual = np.concatenate([scale * difference for difference in first])
    count = len(first)
    return residual, np.concatenate([mean] * count), np.concatenate([used] * count), persistence


def _any_of(residual: Float32, used: Bool) -> bool:
    """Whether any of the pixels (H, W, 3) that are used is not 0."""
    return any(bool((residual[..., c].astype(np.bool_) & used).any()) for c in range(3))


def _below(residual: Float32, limit: Float32) -> Bool:
    """Where all channels (..., 3) are smaller than a limit (3,); one by one, which is quicker."""
    red, green, blue = (np.abs(residual[..., c]) < limit[c] for c in range(3))
    return np.asarray(red & green & blue)


def _in_space(code: Float32) -> tuple[Float32, Float32, Bool, float]:
    """The same from the smoothest blocks of one picture."""
    size = _BLOCK_PX
    height, width = (side // size * size for side in code.shape[:2])
    part = code[:height, :width]
    blocks = part.reshape(height // size, size, width // size, size, 3)
    blocks = blocks.transpose(0, 2, 1, 3, 4)
    level = blocks.mean(axis=(2, 3), keepdims=True)
    ramp = np.linspace(-1.0, 1.0, size, dtype=np.float32)
    ramp /= np.sqrt(np.mean(np.square(ramp)))
    rest = blocks - level
    for slope in (ramp[:, None, None], ramp[None, :, None], (ramp[:, None] * ramp)[..., None]):
        rest = rest - slope * (rest * slope).mean(axis=(2, 3), keepdims=True)
    variance = np.square(rest).mean(axis=(2, 3))
    unclipped = (level > _CLIPPED) & (level < 1.0 - _CLIPPED)
    free, partly = unclipped.all(axis=(2, 3, 4)), unclipped.any(axis=(2, 3, 4))
    used = np.zeros(free.shape, np.bool_)
    if free.any():
        total = variance.sum(axis=2)
        # where a channel is clipped nearly everywhere, as in a saturated sky, the few other blocks
        # are not the picture's smoothest
        share = min(1.0, _SMOOTHEST * partly.sum() / free.sum())
        low, high = np.quantile(total[free], [0.25 * share, share])
        if high < _AGREEMENT * low:
            used = free & (total <= _ceiling(total[free], high))
            if _smoothness(rest[used]) > _TEXTURE:
                used[:] = False
    shape = (height, width)
    spread = np.broadcast_to(used[:, :, None, None], blocks.shape[:4])
    back = (0, 2, 1, 3)
    levels = np.broadcast_to(level, blocks.shape)
    return (
        rest.transpose(*back, 4).reshape(*shape, 3),
        np.ascontiguousarray(levels.transpose(*back, 4)).reshape(*shape, 3),
        np.ascontiguousarray(spread.transpose(back)).reshape(shape),
        0.0,
    )


def _smoothness(blocks: Float32) -> float:
    """Correlation of neighbouring pixels (N, h, w, 3), which is small for noise."""
    energy = float(np.square(blocks).mean())
    if not energy > 0.0:
        return 1.0
    beside = (blocks[:, :, 1:] * blocks[:, :, :-1]).mean()
    below = (blocks[:, 1:] * blocks[:, :-1]).mean()
    return float(0.5 * (beside + below)) / energy


def _ceiling(variances: Float32, start: float) -> float:
    """Largest variance of smooth blocks; the smoothest alone would underestimate the noise."""
    ceiling = start
    for _ in range(_ROUNDS):
        ceiling = _WITHIN * float(variances[variances <= ceiling].mean())
    return ceiling


def _model(residual: Float32, levels: Float32, used: Bool, persistence: float) -> GrainModel:
    """Deviation by level, mixing of the channels and correlation of a residual (H, W, 3)."""
    middles = (np.arange(_LEVELS) + 0.5) / _LEVELS
    few = used[::2, ::2]
    noise, level = residual[::2, ::2][few], levels[::2, ::2][few]
    limit = _OUTLIER * np.sqrt(np.square(noise).mean(axis=0)) + 1e-6
    inside = _below(noise, limit)
    noise, level = noise[inside], level[inside]
    deviation = np.stack([_by_level(noise[:, c], level[:, c], middles) for c in range(3)], axis=1)
    middle = _middle(used)
    residual, levels, used = residual[middle], levels[middle], used[middle]
    used = used & _below(residual, limit)
    at = [np.interp(levels[..., c], middles, deviation[:, c]) for c in range(3)]
    unit = np.where(used[..., None], residual / np.maximum(np.stack(at, axis=2), 1e-6), 0.0)
    covariance = unit[used].T @ unit[used] / max(1, int(used.sum()))
    weights, axes = np.linalg.eigh(covariance)
    parts = unit.astype(np.float32) @ axes.astype(np.float32)
    kernels = np.stack([_kernel(parts[..., c], used) for c in range(3)])
    return GrainModel(
        levels=middles.astype(np.float32),
        deviation=deviation.astype(np.float32),
        mixing=(axes * np.sqrt(np.maximum(weights, 0.0))).astype(np.float32),
        kernels=kernels.astype(np.float32),
        persistence=persistence,
    )


def _middle(used: Bool) -> tuple[slice, slice]:
    """The part of a map round the middle of what is used."""
    parts = []
    for axis in (0, 1):
        counts = np.cumsum(used.sum(axis=1 - axis))
        centre = int(np.searchsorted(counts, 0.5 * counts[-1]))
        start = max(0, min(centre - _KERNEL_SIDE_PX // 2, used.shape[axis] - _KERNEL_SIDE_PX))
        parts.append(slice(start, start + _KERNEL_SIDE_PX))
    return parts[0], parts[1]


def _by_level(residual: Float32, level: Float32, middles: Float64) -> Float64:
    """Deviation at some levels (B,), interpolated where the picture has few pixels."""
    bins = np.minimum((level * len(middles)).astype(np.intp), len(middles) - 1)
    counts = np.bincount(bins, minlength=len(middles))
    squares = np.bincount(bins, np.square(residual, dtype=np.float64), minlength=len(middles))
    known = counts >= min(_LEAST_PIXELS, counts.max())
    deviations = np.sqrt(squares[known] / counts[known])
    return np.asarray(np.interp(middles, middles[known], deviations))


def _kernel(noise: Float32, used: Bool) -> Float64:
    """A kernel (2 LAGS + 1, 2 LAGS + 1) of unit energy that gives white noise this correlation."""
    width = 2 * LAGS + 1
    covariance = np.zeros((width, width))
    height, columns = noise.shape
    for down in range(LAGS + 1):
        for across in range(-LAGS, LAGS + 1):
            rows = (slice(0, height - down), slice(down, height))
            left = slice(max(0, -across), columns - max(0, across))
            right = slice(max(0, across), columns - max(0, -across))
            both = used[rows[0], left] & used[rows[1], right]
            product = noise[rows[0], left] * noise[rows[1], right]
            mean = float(product[both].mean()) if both.any() else 0.0
            covariance[LAGS + down, LAGS + across] = mean
            covariance[LAGS - down, LAGS - across] = mean
    grid = 8 * LAGS
    padded = np.zeros((grid, grid))
    padded[:width, :width] = covariance
    spectrum = np.fft.fft2(np.roll(padded, (-LAGS, -LAGS), axis=(0, 1))).real
    kernel = np.fft.ifft2(np.sqrt(np.maximum(spectrum, 0.0))).real
    kernel = np.roll(kernel, (LAGS, LAGS), axis=(0, 1))[:width, :width]
    energy = float(np.sqrt(np.square(kernel).sum()))
    if not energy > 0.0:
        kernel, energy = np.zeros((width, width)), 1.0
        kernel[LAGS, LAGS] = 1.0
    return np.asarray(kernel / energy)
