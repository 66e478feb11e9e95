"""Measures grain: the plate's noise by level and channel, its spatial and temporal correlation.

A single picture, or a moving camera, shows noise less certainly than a still camera does, so the
threshold is higher.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlens_video.core.layers import Bool, Float32, Float64, Picture, clips_at
from nlens_video.effects.camera.grain import GrainModel
from nlens_video.effects.camera.grain_code import SDR, GrainCode
from nlens_video.effects.camera.plate_noise import (
    LEAST_PIXELS,
    PlateNoise,
    noise_in_space,
    noise_over_time,
)
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.plate_pictures import PlatePictures

EFFECT = "grain"
THRESHOLD = 0.6  # 8-bit levels: what remains visible after rounding to them
_SINGLE_FACTOR = 2.5  # on the threshold, for a single picture
_SLOPE = 1.01  # change of the light over which the slope of a code is taken [1]
_REACHES = (3, 9)  # of the spatial correlation, each way: of grain as a rule, of coarse grain [px]
_ALIKE = 0.15  # correlation at the reach, beyond which grain is coarse
_OUTLIER = 4.0  # deviations beyond which a change is no noise
_COST_MS_PER_MEGAPIXEL = 90.0  # measured, of the object's box
_BOX_SHARE = 0.15  # of the frame, that an object's box is taken to cover


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on a shot's first pictures, at least one."""
    plate = PlatePictures.of(pictures)
    still, same = plate.still()
    code, end, peak = SDR, 1.0, plate[0].peak
    if peak > 1.0:
        lights = [np.maximum(light, 0.0) for light in plate.light_of_still()]
        clip = clips_at(lights[0], peak)
        code = GrainCode.of(peak, clip)
        end = float(code.to_code(np.array(min(clip, code.top), np.float32)))
        still = [code.to_code(light) for light in lights]
    if len(still) > 1:
        noise = noise_over_time(still, same, end)
        threshold, evidence = THRESHOLD, f"noise between {len(still)} pictures of a still camera"
    else:
        noise = noise_in_space(still[0], end)
        threshold = THRESHOLD * _SINGLE_FACTOR
        evidence = "noise in the smoothest parts of one picture"
    model = None
    value = 0.0
    if noise is not None:
        model = _model(noise, code)
        value = 255.0 * float(np.sqrt(np.mean(np.square(_in_srgb(model)))))
    else:
        evidence += ": none to be seen"
    height, width = pictures[0].height, pictures[0].width
    return Measurement(
        effect=EFFECT, value=value, threshold=threshold, unit="8-bit levels", evidence=evidence,
        model=model, cost_ms=_COST_MS_PER_MEGAPIXEL * _BOX_SHARE * width * height / 1e6,
    )  # fmt: skip


def _in_srgb(model: GrainModel) -> Float32:
    """Deviation at levels up to white (B, 3) [sRGB code]."""
    if model.code is SDR:
        return model.deviation
    light = SDR.to_linear(_levels(SDR).astype(np.float32))
    at, change = model.code.to_code(light), np.float32(_SLOPE)
    spans = [
        code.to_code(light * change) - code.to_code(light / change) for code in (SDR, model.code)
    ]
    own = [np.interp(at, model.levels, model.deviation[:, c]) for c in range(3)]
    return np.asarray(np.stack(own, axis=1) * (spans[0] / spans[1])[:, None], np.float32)


def _levels(code: GrainCode) -> Float64:
    """Code values at which a deviation is measured (B,)."""
    count = round(code.per_unit * code.end)
    return (np.arange(count) + 0.5) / count * code.end


def _model(noise: PlateNoise, code: GrainCode) -> GrainModel:
    """Deviation by level, mixing of the channels and correlation."""
    middles = _levels(code)
    squares = np.square(noise.few)
    limit = _OUTLIER * np.sqrt(squares.mean(axis=(1, 2), dtype=np.float64)) + 1e-6
    inside = (np.abs(noise.few) < limit[:, None, None]).all(axis=0).astype(np.float32)
    counts, sums = inside.sum(axis=0), (squares * inside).sum(axis=1)
    deviation = np.stack(
        [_by_level(sums[c], counts, noise.levels[c], middles, code.end) for c in range(3)], axis=1
    )
    used = noise.part_used & (np.abs(noise.part) < limit[:, None, None]).all(axis=0)
    at = [np.interp(noise.part_levels[c], middles, deviation[:, c]) for c in range(3)]
    unit = np.where(used, noise.part / np.maximum(np.stack(at), 1e-6), 0.0)
    flat = unit.reshape(3, -1)
    weights, axes = np.linalg.eigh(flat @ flat.T / max(1, int(used.sum())))
    parts = axes.T.astype(np.float32) @ flat.astype(np.float32)
    kernels = [_kernel(one) for one in _covariances(parts.reshape(unit.shape), used)]
    return GrainModel(
        levels=middles.astype(np.float32),
        deviation=deviation.astype(np.float32),
        mixing=(axes * np.sqrt(np.maximum(weights, 0.0))).astype(np.float32),
        kernels=np.stack(kernels).astype(np.float32),
        persistence=noise.persistence,
        code=code,
    )


def _by_level(
    squares: Float32, counts: Float32, level: Float32, middles: Float64, end: float
) -> Float64:
    """Deviation at some levels (B,), interpolated where the picture has few pixels.

    Args:
        squares: of each pixel's noise, summed over the pictures (N,).
        counts: of the pictures in these sums (N,).
        level: of each pixel (N,).
        middles: of the levels (B,).
        end: of the code.
    """
    bins = np.minimum((level * (len(middles) / end)).astype(np.intp), len(middles) - 1)
    total = np.bincount(bins, counts, minlength=len(middles))
    known = total >= min(LEAST_PIXELS, total.max())
    sums = np.bincount(bins, squares, minlength=len(middles))
    deviations = np.sqrt(sums[known] / total[known])
    return np.asarray(np.interp(middles, middles[known], deviations))


def _covariances(noise: Float32, used: Bool) -> Float64:
    """Covariance of neighbours by channel (3, 2 R + 1, 2 R + 1), as far as grain reaches [px].

    `noise` (3, H, W) is 0 where it is not used.
    """
    for reach in _REACHES:
        found = _covariances_up_to(noise, used, reach)
        ends = np.maximum(found[:, reach, -1], found[:, -1, reach])
        if (ends <= _ALIKE * found[:, reach, reach]).all():
            break
    return found


def _covariances_up_to(noise: Float32, used: Bool, reach: int) -> Float64:
    width = 2 * reach + 1
    covariance = np.zeros((len(noise), width, width))
    height, columns = used.shape
    for down in range(reach + 1):
        for across in range(-reach, reach + 1):
            one = np.s_[: height - down, max(0, -across) : columns - max(0, across)]
            other = np.s_[down:, max(0, across) : columns - max(0, -across)]
            count = max(1, np.count_nonzero(used[one] & used[other]))
            sums = np.einsum("chw,chw->c", noise[:, *one], noise[:, *other])
            covariance[:, reach + down, reach + across] = sums / count
            covariance[:, reach - down, reach - across] = sums / count
    return covariance


def _kernel(covariance: Float64) -> Float64:
    """A kernel of unit energy that gives white noise this correlation, both (2 R + 1, 2 R + 1)."""
    width = len(covariance)
    reach, grid = width // 2, 4 * (width - 1)
    padded = np.zeros((grid, grid))
    padded[:width, :width] = covariance
    spectrum = np.fft.fft2(np.roll(padded, (-reach, -reach), axis=(0, 1))).real
    kernel = np.fft.ifft2(np.sqrt(np.maximum(spectrum, 0.0))).real
    kernel = np.roll(kernel, (reach, reach), axis=(0, 1))[:width, :width]
    energy = float(np.sqrt(np.square(kernel).sum()))
    if not energy > 0.0:
        kernel, energy = np.zeros((width, width)), 1.0
        kernel[reach, reach] = 1.0
    return np.asarray(kernel / energy)
