"""Grain: the plate's noise, synthesised on the object.

The plate's own noise shows through a partly transparent object; the rest is added, at the level of
the composite.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import BlurredLayer, Box, Float32, Picture
from nlens_video.effects.camera.grain_code import SDR, GrainCode
from nlens_video.kernels.thread_pool import Band, parallel_for, picture_bands
from nlens_video.native import kernels

_PERSISTENT = 0.03  # share of a past picture's noise that is neglected
_MOST_PAST = 12  # past pictures in the noise
_SEED = 20
_WORD = 0xFFFFFFFF  # 32 bits
TILE_PX = 512
"""Side of the noise that is laid on each frame from another place [px]."""


class GrainModel(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """A plate's noise in code values.

    Attributes:
        levels: code values at which `deviation` is known, increasing (B,) [code].
        deviation: of red, green and blue (B, 3) [code].
        mixing: of three independent parts into the channels (3, 3), noise = mixing @ parts.
        kernels: spatial correlation of each part, of unit energy (3, 2 R + 1, 2 R + 1).
        persistence: correlation with the next picture, in [0, 1) [1].
        code: in which the noise is measured: display-coded sRGB, in HDR another.
    """

    levels: Float32
    deviation: Float32
    mixing: Float32
    kernels: Float32
    persistence: float
    code: GrainCode = SDR

    @cached_property
    def tile(self) -> Float32:
        """Noise of unit deviation (TILE_PX, TILE_PX, 3) that goes on beyond each edge."""
        parts = []
        reach = self.kernels.shape[1] // 2
        for part, kernel in enumerate(self.kernels):
            white = white_noise((0, 0), (TILE_PX, TILE_PX), 0, _SEED + part)
            around = np.pad(white, reach, mode="wrap")
            parts.append(cv2.filter2D(around, -1, kernel)[reach:-reach, reach:-reach])
        return np.asarray(cv2.transform(cv2.merge(parts), self.mixing), np.float32)

    @cached_property
    def curve(self) -> Float32:
        """Deviation at 256 levels from black to the end of the code (256, 3) [code]."""
        at = np.linspace(0.0, self.code.end, 256)
        return np.stack(
            [np.interp(at, self.levels, self.deviation[:, c]) for c in range(3)], axis=1
        ).astype(np.float32)

    def unit_noise(self, box: Box, index: int, draw: int = 0) -> Float32:
        """Noise (h, w, 3) of unit deviation at every level, on a box of a frame.

        Args:
            box: of the frame [px].
            index: of the frame.
            draw: number among the layers of a frame, whose noise is independent.
        """
        shares = past_shares(self.persistence)
        places = [place_on_tile(index - back, draw) for back in range(len(shares))]
        return tiled(self.tile, box, places, shares)


class AddGrain(Struct, frozen=True, eq=False):
    """Adds grain to a layer, so that its composite is as noisy as the plate.

    Attributes:
        model: of the plate.
        draw: number among the layers of a frame, whose noise is independent.
    """

    model: GrainModel
    draw: int = 0

    def __call__(self, picture: Picture, blurred: BlurredLayer, index: int) -> BlurredLayer:
        """Grain one frame; the noise depends on its index. `picture` is the plate, unchanged."""
        if blurred.box.empty:
            return blurred
        plate = picture.linear(blurred.box)
        noise = self.model.unit_noise(blurred.box, index, self.draw)
        rgba = regrain(blurred.rgba, plate, noise, self.model.curve, self.model.code)
        return BlurredLayer(box=blurred.box, rgba=rgba)


def place_on_tile(index: int, draw: int = 0) -> tuple[int, int]:
    """Row and column of the tile at the frame's first pixel, at random for each layer [px].

    Args:
        index: of the frame.
        draw: number among its layers.
    """
    bits = _mixed(_mixed(index & _WORD) ^ (_SEED + draw))
    return bits % TILE_PX, bits // TILE_PX % TILE_PX


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


def to_code(linear: Float32) -> Float32:
    """Display-coded sRGB of scene-linear light."""
    return SDR.to_code(linear)


def to_linear(code: Float32) -> Float32:
    """Scene-linear light of display-coded sRGB."""
    return SDR.to_linear(code)


def regrain(
    rgba: Float32, plate: Float32, noise: Float32, deviation: Float32, code: GrainCode = SDR
) -> Float32:
    """Add noise to a layer, so that its composite is as noisy as the plate.

    A plate that shows through by t = 1 - alpha brings t of its noise; the rest has the deviation
    sqrt(1 - t^2) times the plate's at the composite's level. Light beyond the code is unchanged.

    Args:
        rgba: premultiplied scene-linear layer (h, w, 4).
        plate: scene-linear light below it (h, w, 3).
        noise: of unit deviation (h, w, 3).
        deviation: of the plate at 256 levels from black to the end of the code (256, 3) [code].
        code: of these levels.

    Returns:
        The layer with its noise (h, w, 4); colour may be a little below 0. Pixels without alpha
        stay as they are.
    """
    out = np.array(rgba, np.float32, order="C")
    codes, lights = code.tables
    if code.top != 1.0:
        out[..., :3] /= np.float32(code.top)
    plate = np.ascontiguousarray(code.normalised(plate))
    noise = np.ascontiguousarray(noise, np.float32)
    curve = np.ascontiguousarray(deviation.T / np.float32(code.end))

    def add(band: Band) -> None:
        part = slice(*band)
        kernels.regrain(out[part], plate[part], noise[part], curve, codes, lights)

    parallel_for(add, picture_bands(*out.shape[:2]))
    if code.top != 1.0:
        out[..., :3] *= np.float32(code.top)
    return out


def regrain_reference(
    rgba: Float32, plate: Float32, noise: Float32, deviation: Float32, code: GrainCode = SDR
) -> Float32:
    """NumPy reference of `regrain`."""
    alpha = np.minimum(rgba[..., 3:], 1.0)
    light = rgba[..., :3] + (1.0 - alpha) * plate
    coded = code.to_code(np.maximum(light, 0.0))
    levels = np.linspace(0.0, code.end, 256)
    spread = np.stack([np.interp(coded[..., c], levels, deviation[:, c]) for c in range(3)], axis=2)
    missing = np.sqrt(1.0 - (1.0 - alpha) ** 2)
    grained = np.clip(coded + missing * spread * noise, 0.0, code.end).astype(np.float32)
    change = code.to_linear(grained) - np.maximum(light, 0.0)
    changed = (alpha > 0.0) & (light < code.top)
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
    moment, seed = moment & _WORD, seed & _WORD
    kernels.white_noise(out, corner, moment, seed, 1.0 / _BYTES_DEVIATION)
    return out


def white_noise_reference(
    corner: tuple[int, int], size: tuple[int, int], moment: int, seed: int
) -> Float32:
    """Python reference of `white_noise`."""
    start = _mixed(seed & _WORD ^ _mixed((moment + 0x9E3779B9) & _WORD))
    out = np.empty(size, np.float32)
    for i, j in np.ndindex(size):
        of_row = _mixed(start ^ (corner[0] + i) & _WORD)
        bits = _mixed((of_row + (corner[1] + j) * 0x9E3779B1) & _WORD)
        out[i, j] = (sum(bits.to_bytes(4, "little")) - 510.0) / _BYTES_DEVIATION
    return out


def _mixed(value: int) -> int:
    """A number of 32 bits that all depend on all bits of another (the finaliser `lowbias32`)."""
    value ^= value >> 16
    value = value * 0x7FEB352D & _WORD
    value ^= value >> 15
    value = value * 0x846CA68B & _WORD
    return value ^ value >> 16


def tiled(
    tile: Float32, box: Box, places: Sequence[tuple[int, int]], shares: Sequence[float]
) -> Float32:
    """A weighted sum of a tile laid on the frame again and again from several places.

    Args:
        tile: (size, size, 3).
        box: of the frame (h, w) [px].
        places: row and column of the tile at the frame's first pixel, once for each share [px].
        shares: weights [1].

    Returns:
        The sum on the box (h, w, 3).
    """
    out = np.empty((box.height, box.width, 3), np.float32)
    corners = np.array(places, np.int64) + (box.y0, box.x0)
    kernels.add_tiles(out, tile, corners, np.array(shares, np.float32))
    return out


def tiled_reference(
    tile: Float32, box: Box, places: Sequence[tuple[int, int]], shares: Sequence[float]
) -> Float32:
    """NumPy reference of `tiled`, as precise as the tile."""
    size = len(tile)
    out = np.zeros((box.height, box.width, 3), tile.dtype)
    for (row, column), share in zip(places, shares, strict=True):
        rows = (row + np.arange(box.y0, box.y1)) % size
        columns = (column + np.arange(box.x0, box.x1)) % size
        out += share * tile[np.ix_(rows, columns)]
    return out
