"""Samples of a picture, as upright views, and how their codes stand for light."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import av
import av.video.plane
import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.color import (
    TRANSFERS,
    ColorTags,
    luma,
    primaries_from_bt709,
    rgb_from_yuv,
    transfer,
)
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float32, Float64
from nlens_video.video.pixels.orientation import UPRIGHT, Orientation
from nlens_video.video.pixels.pixel_formats import PixelLayout, layout

Plane = npt.NDArray[Any]
"""Samples (H, W) of one component: uint8, uint16 or float32, any strides."""
FIRST_OCTAVE = -40
OCTAVES = 72
STEPS_BITS = 7
"""Tables have 2**7 linear pieces per octave, from 2**-40 to 2**32, and one from 0 up to them."""


class Axis(Struct, frozen=True):
    """Subsampling of the second and third component along one axis.

    Chroma sample k covers the pixels from `k * step - phase`, `step` of them, cut by the frame; its
    filter starts at `k * step - phase + first` and covers at least those.

    Attributes:
        step: pixels per chroma sample [px].
        phase: pixels by which the frame cuts the first cell, as in a mirrored odd width [px].
        first: start of the filter, relative to the cell [px].
        weights: filter taps, they sum to 1 [1].
    """

    step: int = 1
    phase: int = 0
    first: int = 0
    weights: tuple[float, ...] = (1.0,)


class Coding(Struct, frozen=True):
    """Relation of codes and light.

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
        """Largest code, 0 for float samples."""
        return float((1 << self.bits) - 1) if self.bits else 0.0

    @property
    def rgb_from_codes(self) -> Float64:
        """Affine map (3, 4) from the codes of a pixel to its transfer-coded RGB in [0, 1]."""
        matrix, scale, offset = np.eye(3), np.ones(3) / (self.peak or 1.0), np.zeros(3)
        if self.family == "yuv":
            matrix = rgb_from_yuv(self.tags.matrix)
            offset = np.array([0.0, 0.5, 0.5]) * (self.peak + 1.0 if self.bits else 0.0)
            if not self.tags.full_range and self.bits:
                unit = float(1 << (self.bits - 8))
                scale = 1.0 / (unit * np.array([219.0, 224.0, 224.0]))
                offset[0] = 16.0 * unit
        elif self.family == "gray":
            matrix = np.array([[1.0, 0.0, 0.0]] * 3)
        linear = matrix * scale
        return np.concatenate([linear, -(linear @ offset)[:, None]], axis=1)

    @property
    def codes_from_rgb(self) -> Float64:
        """Linear part (3, 3) of the inverse: a change of coded RGB to a change of the codes."""
        if self.family == "gray":
            weights = np.zeros((3, 3))
            weights[0] = luma("bt709") * (self.peak or 1.0)
            return weights
        return np.asarray(np.linalg.inv(self.rgb_from_codes[:, :3]))


class Samples(Struct, frozen=True, eq=False):
    """The samples of one picture, upright.

    Attributes:
        planes: three components; the first and the second and third may differ in size.
        alpha: alpha (H, W), or None.
        across: subsampling along a row.
        down: subsampling along a column.
        coding: meaning of the codes.
        associated: whether the components are premultiplied by alpha, as in OpenEXR; the codes
            are then linear light.
    """

    planes: tuple[Plane, Plane, Plane]
    alpha: Plane | None
    across: Axis
    down: Axis
    coding: Coding
    associated: bool = False


class Tables(Struct, frozen=True, eq=False):
    """A coding in the form that the compiled kernels take.

    Attributes:
        to_linear: transfer function, tabulated.
        to_coded: its inverse at the same abscissae.
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


@lru_cache(maxsize=64)
def tables(coding: Coding) -> Tables:
    """Tables and matrices of a coding."""
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


def display_tables() -> tuple[Float32, Float32]:
    """Tables from sRGB codes to linear light, and back."""
    return _curve_tables("iec61966-2-1")


@lru_cache(maxsize=64)
def _curve_tables(name: str) -> tuple[Float32, Float32]:
    """A transfer function and its inverse at 0 and at 2**STEPS_BITS values per octave."""
    steps = 1 << STEPS_BITS
    octave, step = np.divmod(np.arange(OCTAVES * steps + 1), steps)
    grid = np.concatenate([[0.0], np.ldexp(1.0 + step / steps, octave + FIRST_OCTAVE)])
    limit = np.finfo(np.float32).max / 4
    pair = (transfer(name).decode(grid), transfer(name).encode(grid))
    linear, coded = (np.minimum(values, limit).astype(np.float32) for values in pair)
    return linear, coded


def frame_tags(frame: av.VideoFrame, *, assumed: int = 0, given: str | None = None) -> ColorTags:
    """Colour tags of a frame; missing ones are assumed.

    Args:
        frame: in a working format.
        assumed: FFmpeg's number of the transfer function for a frame without that tag.
        given: name of a transfer function that overrides the tag.

    Raises:
        InputError: a tag is not supported.
    """
    kind = _layout(frame)
    curve = frame.color_trc if frame.color_trc not in (0, 2) else assumed
    if given is not None:
        curve = next(number for number, name in TRANSFERS.items() if name == given)
    return ColorTags.resolve(
        kind.family, (frame.width, frame.height), matrix=frame.colorspace,
        transfer=curve, primaries=frame.color_primaries,
        range_=2 if kind.full_range else frame.color_range,
    )  # fmt: skip


def frame_samples(
    frame: av.VideoFrame, tags: ColorTags, orientation: Orientation = UPRIGHT, *,
    chroma_siting: str = "",
) -> Samples:  # fmt: skip
    """Views of a frame in a working format, as it is displayed.

    `chroma_siting` is FFmpeg's name of where chroma at half the width or height lies; empty: left.
    """
    kind = _layout(frame)
    views = [
        plane_rows(frame.planes[plane], kind)[:, place :: kind.channels]
        for plane, place in kind.components
    ]
    return _upright(views, kind, tags, _axes(kind, chroma_siting), orientation)


def memory_samples(
    views: list[Plane], kind: PixelLayout, tags: ColorTags, *, centred_chroma: bool = False
) -> Samples:
    """Samples of a picture whose components are at hand as views (H, W), alpha as the last one."""
    return _upright(views, kind, tags, _axes(kind, "center" if centred_chroma else ""))


@lru_cache(maxsize=64)
def _axes(kind: PixelLayout, chroma_siting: str) -> tuple[Axis, Axis]:
    """Subsampling across and down; chroma lies on the first of two luma samples, or between."""
    across, down = (Axis(step, 0, 0, (1.0 / step,) * step) for step in (kind.step_x, kind.step_y))
    on_first = Axis(2, 0, -1, (0.25, 0.5, 0.25))
    if kind.step_x == 2 and chroma_siting not in ("center", "top"):
        across = on_first
    if kind.step_y == 2 and chroma_siting in ("topleft", "top"):
        down = on_first
    return across, down


def plane_rows(plane: av.video.plane.VideoPlane, kind: PixelLayout) -> Plane:
    """View of the samples of a plane (h, w * channels), without the padding of its rows."""
    flat: Plane = np.frombuffer(memoryview(plane), np.dtype(kind.dtype))
    rows = flat.reshape(plane.height, plane.line_size // flat.itemsize)
    return rows[:, : plane.width * kind.channels]


def array_samples(
    array: Plane, order: str, tags: ColorTags, *, associated: bool = False
) -> Samples:
    """Views of an array (H, W), (H, W, 3) or (H, W, 4) whose channels lie in `order`.

    Alpha is straight, or with `associated` the colours are premultiplied by it.

    Raises:
        InputError: a shape or a type that no picture has.
    """
    bits = {"uint8": 8, "uint16": 16, "float32": 0}.get(array.dtype.name)
    channels = array.shape[2] if array.ndim == 3 else 1
    if bits is None or array.ndim not in (2, 3) or channels not in (1, 3, 4) or not array.size:
        raise InputError(
            f"a picture of shape {array.shape}, {array.dtype}; expected (H, W), (H, W, 3) or "
            "(H, W, 4) of uint8, uint16 or float32"
        )
    places = {"rgb": (0, 1, 2), "bgr": (2, 1, 0)}[order]
    views = [array[..., place] for place in (*places, 3)[:channels]] if channels > 1 else [
        array.reshape(array.shape[:2])
    ]  # fmt: skip
    kind = PixelLayout(
        family="rgb" if channels > 1 else "gray", bits=bits, components=((0, 0),) * channels,
        alpha=channels == 4,
    )  # fmt: skip
    return replace(_upright(views, kind, tags, (Axis(), Axis())), associated=associated)


def _upright(
    views: list[Plane], kind: PixelLayout, tags: ColorTags, axes: tuple[Axis, Axis],
    orientation: Orientation = UPRIGHT,
) -> Samples:  # fmt: skip
    """Samples as displayed, from views as stored and their subsampling across and down."""
    height, width = views[0].shape
    views = [orientation.shown(view) for view in views]
    alpha = views.pop() if kind.alpha else None
    if grey := len(views) == 1:  # unused chroma of the shape that the kernels expect
        views += [np.zeros_like(views[0]), np.zeros_like(views[0])]
    for _ in range(orientation.turns):
        axes = axes[1], _mirrored(axes[0], width)
        height, width = width, height
    if orientation.mirrored:
        axes = _mirrored(axes[0], width), axes[1]
    family = "gray" if grey else "rgb" if tags.matrix == "gbr" else "yuv"
    return Samples((views[0], views[1], views[2]), alpha, *axes, Coding(family, tags, kind.bits))


def _layout(frame: av.VideoFrame) -> PixelLayout:
    kind = layout(frame.format.name)
    if kind is None:
        raise ValueError(f"{frame.format.name} is not a working format")
    return kind


def _mirrored(axis: Axis, length: int) -> Axis:
    """The same subsampling seen from the other end of `length` pixels."""
    return replace(
        axis,
        phase=-(length + axis.phase) % axis.step,
        first=axis.step - axis.first - len(axis.weights),
        weights=axis.weights[::-1],
    )
