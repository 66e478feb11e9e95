"""What the blend kernels work on: a picture's samples and how they stand for light."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from nlens_video.core.color import (
    ColorTags,
    Transfer,
    luma,
    primaries_from_bt709,
    rgb_from_yuv,
    transfer,
)
from nlens_video.core.layers import Float32, Float64

Plane = npt.NDArray[Any]
"""Samples (H, W) of one component: uint8, uint16 or float32, any strides."""


@dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """How the second and third component are subsampled along one axis.

    Chroma sample k covers the pixels from `k * step - phase`, `step` of them, cut by the frame; the
    filter that makes it starts at `k * step - phase + first` and covers at least those.

    Attributes:
        step: pixels per chroma sample [px].
        phase: pixels by which the frame cuts the first cell, as in a mirrored odd width [px].
        first: where the filter starts, relative to the cell [px].
        weights: filter taps, they sum to 1 [1].
    """

    step: int = 1
    phase: int = 0
    first: int = 0
    weights: tuple[float, ...] = (1.0,)


@dataclass(frozen=True, slots=True)
class Coding:
    """How codes stand for light.

    Attributes:
        family: `yuv`, `rgb` or `gray`; the components are Y Cb Cr, R G B, or Y alone.
        tags: matrix, transfer, primaries and range.
        bits: of an integer sample; 0 for float samples.
    """

    family: str
    tags: ColorTags
    bits: int

    @property
    def peak(self) -> float:
        """Largest code, 0 where codes are floats."""
        return float((1 << self.bits) - 1) if self.bits else 0.0

    @property
    def rgb_from_codes(self) -> Float64:
        """Affine map (3, 4) from the codes of a pixel to its transfer-coded RGB in [0, 1]."""
        matrix, scale, offset = np.eye(3), np.ones(3), np.zeros(3)
        if self.family == "yuv":
            matrix = rgb_from_yuv(self.tags.matrix)
            offset = np.array([0.0, 0.5, 0.5]) * (self.peak + 1.0 if self.bits else 0.0)
            scale /= self.peak or 1.0
            if not self.tags.full_range and self.bits:
                unit = float(1 << (self.bits - 8))
                scale = 1.0 / (unit * np.array([219.0, 224.0, 224.0]))
                offset[0] = 16.0 * unit
        elif self.family == "gray":
            matrix = np.array([[1.0, 0.0, 0.0]] * 3)
            scale /= self.peak or 1.0
        else:
            scale /= self.peak or 1.0
        linear = matrix * scale
        return np.concatenate([linear, -(linear @ offset)[:, None]], axis=1)

    @property
    def codes_from_rgb(self) -> Float64:
        """Linear part (3, 3) of the way back: a change of coded RGB to a change of the codes."""
        if self.family == "gray":
            weights = np.zeros((3, 3))
            weights[0] = luma("bt709") * (self.peak or 1.0)
            return weights
        return np.asarray(np.linalg.inv(self.rgb_from_codes[:, :3]))


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The samples of one picture, upright.

    Attributes:
        planes: three components; the first and the second and third may differ in size.
        alpha: alpha (H, W), or None.
        across: subsampling along a row.
        down: subsampling along a column.
        coding: what the codes mean.
        associated: whether the components are premultiplied by alpha, as in OpenEXR; they must
            then stand for light linearly.
    """

    planes: tuple[Plane, Plane, Plane]
    alpha: Plane | None
    across: Axis
    down: Axis
    coding: Coding
    associated: bool = False


FIRST_OCTAVE = -40
OCTAVES = 72
STEPS_BITS = 7
"""Tables have 2**7 linear pieces per octave, from 2**-40 to 2**32, and one from 0 up to them."""


@dataclass(frozen=True, slots=True, eq=False)
class Tables:
    """A coding, ready for the fast kernels.

    Attributes:
        to_linear: transfer function on the grid of `table`.
        to_coded: its inverse on the same grid.
        rgb_from_codes: (3, 4), see `Coding`.
        codes_from_rgb: (3, 3), see `Coding`.
        from_bt709: linear BT.709 RGB to the plate's primaries (3, 3).
        to_bt709: its inverse (3, 3).
    """

    to_linear: Float32
    to_coded: Float32
    rgb_from_codes: Float32
    codes_from_rgb: Float32
    from_bt709: Float32
    to_bt709: Float32


def _grid() -> Float64:
    """Abscissae of a table: 0, then 2**STEPS_BITS values per octave."""
    steps = 1 << STEPS_BITS
    octave, step = np.divmod(np.arange(OCTAVES * steps + 1), steps)
    return np.concatenate([[0.0], np.ldexp(1.0 + step / steps, octave + FIRST_OCTAVE)])


@lru_cache(maxsize=64)
def _curve_tables(name: str) -> tuple[Float32, Float32]:
    curve: Transfer = transfer(name)
    grid = _grid()
    limit = np.finfo(np.float32).max / 4
    pair = (curve.decode(grid), curve.encode(grid))
    linear, coded = (np.minimum(values, limit).astype(np.float32) for values in pair)
    return linear, coded


@lru_cache(maxsize=64)
def tables(coding: Coding) -> Tables:
    """Tables and matrices in the form that the fast kernels take."""
    to_linear, to_coded = _curve_tables(coding.tags.transfer)
    gamut = primaries_from_bt709(coding.tags.primaries)
    return Tables(
        to_linear,
        to_coded,
        coding.rgb_from_codes.astype(np.float32),
        coding.codes_from_rgb.astype(np.float32),
        gamut.astype(np.float32),
        np.linalg.inv(gamut).astype(np.float32),
    )


def display_table() -> Float32:
    """Table from linear light to sRGB codes."""
    return _curve_tables("iec61966-2-1")[1]
