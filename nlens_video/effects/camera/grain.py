"""Grain: the plate's noise, synthesised on the object.

The plate's own noise shows through a partly transparent object; the rest is added, at the level of
the composite.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from nlens_video.core.color import transfer
from nlens_video.core.layers import BlurredLayer, Float32, Picture
from nlens_video.native import kernels

LAGS = 3  # reach of the spatial correlation, each way [px]
_PERSISTENT = 0.03  # share of a past picture's noise that is neglected
_MOST_PAST = 12  # past pictures in the noise
_SEED = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class GrainModel:
    """A plate's noise in display-coded values.

    Attributes:
        levels: code values at which `deviation` is known, increasing (B,) [sRGB code].
        deviation: of red, green and blue (B, 3) [sRGB code].
        mixing: of three independent parts into the channels (3, 3), noise = mixing @ parts.
        kernels: spatial correlation of each part, of unit energy (3, 2 LAGS + 1, 2 LAGS + 1).
        persistence: correlation with the next picture, in [0, 1) [1].
    """

    levels: Float32
    deviation: Float32
    mixing: Float32
    kernels: Float32
    persistence: float


@dataclass(frozen=True, slots=True)
class AddGrain:
    """Adds grain to the object's layer, so that its composite is as noisy as the plate."""

    model: GrainModel

    def __call__(self, picture: Picture, blurred: BlurredLayer, index: int) -> BlurredLayer:
        """Grain one frame; the noise depends on its index. `picture` is the plate, unchanged."""
        if blurred.box.empty:
            return blurred
        plate = picture.linear(blurred.box)
        noise = self.unit_noise(blurred, index)
        return BlurredLayer(
            box=blurred.box, rgba=regrain(blurred.rgba, plate, noise, self._curve())
        )

    def unit_noise(self, blurred: BlurredLayer, index: int) -> Float32:
        """Noise (h, w, 3) of unit deviation at every level, on the layer's box."""
        box = blurred.box.expanded(LAGS)
        size = (box.height, box.width)
        shares = past_shares(self.model.persistence)
        parts = []
        for part, kernel in enumerate(self.model.kernels):
            white = np.zeros(size, np.float32)
            for back, share in enumerate(shares):
                field = white_noise((box.y0, box.x0), size, index - back, _SEED + part)
                white += np.float32(share) * field
            parts.append(cv2.filter2D(white, -1, kernel)[LAGS:-LAGS, LAGS:-LAGS])
        return np.asarray(cv2.transform(cv2.merge(parts), self.model.mixing), np.float32)

    def _curve(self) -> Float32:
        """Deviation at 256 levels (256, 3) [sRGB code]."""
        levels = np.linspace(0.0, 1.0, 256)
        model = self.model
        return np.stack(
            [np.interp(levels, model.levels, model.deviation[:, c]) for c in range(3)], axis=1
        ).astype(np.float32)


def past_shares(persistence: float) -> tuple[float, ...]:
    """Weights of the white noise of this and past pictures in this one's grain.

    An autoregressive process written as a sum, so that a frame depends on no other; the squares of
    the weights sum to 1. `persistence` is the correlation from picture to picture, in [0, 1) [1].
    """
    shares = [1.0]
    while len(shares) < _MOST_PAST and shares[-1] * persistence > _PERSISTENT:
        shares.append(shares[-1] * persistence)
    energy = sum(share * share for share in shares) ** 0.5
    return tuple(share / energy for share in shares)


_STEPS = 4096
_SRGB = transfer("iec61966-2-1")


def to_code(linear: Float32) -> Float32:
    """Display-coded sRGB of scene-linear light."""
    return _SRGB.to_coded(linear.astype(np.float64)).astype(np.float32)


def to_linear(code: Float32) -> Float32:
    """Scene-linear light of display-coded sRGB."""
    return _SRGB.to_linear(code.astype(np.float64)).astype(np.float32)


@lru_cache(maxsize=1)
def _tables() -> tuple[Float32, Float32]:
    """Codes by the root of the light, light by code, each over [0, 1]."""
    at = np.linspace(0.0, 1.0, _STEPS + 1)
    return to_code((at * at).astype(np.float32)), to_linear(at.astype(np.float32))


def regrain(rgba: Float32, plate: Float32, noise: Float32, deviation: Float32) -> Float32:
    """Add noise to a layer, so that its composite is as noisy as the plate.

    A plate that shows through by t = 1 - alpha brings t of its noise; the rest has the deviation
    sqrt(1 - t^2) times the plate's at the composite's level. Light beyond white is unchanged.

    Args:
        rgba: premultiplied scene-linear layer (h, w, 4).
        plate: scene-linear light below it (h, w, 3).
        noise: of unit deviation (h, w, 3).
        deviation: of the plate at 256 levels from black to white (256, 3) [sRGB code].

    Returns:
        The layer with its noise (h, w, 4); colour may be a little below 0. Pixels without alpha
        stay as they are.
    """
    out = np.array(rgba, np.float32, order="C")
    codes, lights = _tables()
    kernels.regrain(
        out, np.ascontiguousarray(plate), np.ascontiguousarray(noise, np.float32),
        np.ascontiguousarray(deviation), codes, lights,
    )  # fmt: skip
    return out


def regrain_reference(rgba: Float32, plate: Float32, noise: Float32, deviation: Float32) -> Float32:
    """NumPy reference of `regrain`."""
    alpha = np.minimum(rgba[..., 3:], 1.0)
    light = rgba[..., :3] + (1.0 - alpha) * plate
    code = to_code(np.maximum(light, 0.0))
    levels = np.linspace(0.0, 1.0, 256)
    spread = np.stack([np.interp(code[..., c], levels, deviation[:, c]) for c in range(3)], axis=2)
    missing = np.sqrt(1.0 - (1.0 - alpha) ** 2)
    grained = np.clip(code + missing * spread * noise, 0.0, 1.0).astype(np.float32)
    change = to_linear(grained) - np.maximum(light, 0.0)
    changed = (alpha > 0.0) & (light < 1.0)
    return np.concatenate(
        [rgba[..., :3] + np.where(changed, change, 0.0), rgba[..., 3:]], axis=2
    ).astype(np.float32)


# The sum of the four bytes of a number, each uniform, is near to normal (Irwin-Hall), within 4
# deviations; its deviation:
_BYTES_DEVIATION = 2.0 * ((256.0**2 - 1.0) / 12.0) ** 0.5


def white_noise(corner: tuple[int, int], size: tuple[int, int], moment: int, seed: int) -> Float32:
    """Noise of mean 0 and deviation 1 on a box of the frame.

    Args:
        corner: row and column of its first pixel, from -2^15 on [px].
        size: rows and columns [px].
        moment: number of the frame.
        seed: another seed is another noise.

    Returns:
        Values (h, w), independent of each other.
    """
    out = np.empty(size, np.float32)
    moment, seed = moment & 0xFFFFFFFF, seed & 0xFFFFFFFF
    kernels.white_noise(out, corner, moment, seed, 1.0 / _BYTES_DEVIATION)
    return out


def white_noise_reference(
    corner: tuple[int, int], size: tuple[int, int], moment: int, seed: int
) -> Float32:
    """Python reference of `white_noise`."""

    def mixed(value: int) -> int:
        value ^= value >> 16
        value = value * 0x7FEB352D & 0xFFFFFFFF
        value ^= value >> 15
        value = value * 0x846CA68B & 0xFFFFFFFF
        return value ^ value >> 16

    start = mixed(seed & 0xFFFFFFFF ^ mixed((moment + 0x9E3779B9) & 0xFFFFFFFF))
    out = np.empty(size, np.float32)
    for i, j in np.ndindex(size):
        of_row = mixed(start ^ (corner[0] + i) & 0xFFFFFFFF)
        bits = mixed((of_row + (corner[1] + j) * 0x9E3779B1) & 0xFFFFFFFF)
        out[i, j] = (sum(bits.to_bytes(4, "little")) - 510.0) / _BYTES_DEVIATION
    return out
