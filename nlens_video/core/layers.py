"""The data between stages: boxes, pictures, CoC maps and object layers.

Conventions: `docs/architecture.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.box import Box as Box
from nlens_video.core.box import Float32 as Float32
from nlens_video.core.box import Float64 as Float64
from nlens_video.core.box import Int64 as Int64

Bool = npt.NDArray[np.bool_]
UInt8 = npt.NDArray[np.uint8]
MOST_PIXELS = 200_000_000
"""Limit of a plate, a layer or a map; larger ones are refused before memory is allocated."""


_BEYOND_WHITE = 1.1  # light that no picture reaches which ends at white: codecs overshoot [1]


def clips_at(light: Float32, peak: float) -> float:
    """Light beyond which a picture does not tell how bright it is; at most the `peak` of its codes.

    One that shows nothing beyond white was made to end there, whatever its codes can hold.
    """
    return peak if peak > 1.0 and float(np.max(light)) > _BEYOND_WHITE else 1.0


def too_large(name: str, width: int, height: int) -> str:
    """Error message for a picture of more than `MOST_PIXELS`."""
    most = MOST_PIXELS // 10**6
    return f"{name}: {width}x{height} pixels, at most {most} megapixels are read; make it smaller"


class Picture(Protocol):
    """One picture of the plate in its own samples, seen upright (display orientation)."""

    @property
    def width(self) -> int:
        """Columns as displayed [px]."""
        ...

    @property
    def height(self) -> int:
        """Rows as displayed [px]."""
        ...

    @property
    def peak(self) -> float:
        """Light at which its codes end: 1 of SDR, more of PQ and HLG, infinite of light itself."""
        ...

    def srgb(self) -> Float32:
        """The whole picture, display-coded sRGB in [0, 1], (H, W, 3), for estimators."""
        ...

    def shown(self) -> Float32:
        """The whole picture as players show it, in [0, 1] (H, W, 3), for people.

        Codes of SDR stay as they are, since no player converts between the curves of video and of
        sRGB; HDR and linear light become sRGB.
        """
        ...

    def linear(self, box: Box) -> Float32:
        """Scene-linear RGB (h, w, 3) of a box that lies inside the frame; 1.0 is diffuse white."""
        ...

    def green_patches(self, corners: Sequence[tuple[int, int]], side: int) -> Float32:
        """Scene-linear green (N, side, side) of squares that lie inside the frame.

        Args:
            corners: column and row of the top left pixel of each [px].
            side: columns and rows [px].
        """
        ...

    def downsample(self, width: int, height: int) -> Float32:
        """Scene-linear RGB (height, width, 3) of means of the codes."""
        ...

    def composite_over(self, box: Box, rgba: Float32, *, of_plate: bool = False) -> None:
        """Composite a premultiplied scene-linear layer (h, w, 4) over a box inside the frame.

        With `of_plate` its colours are multiples of the plate's own light. Samples on which the
        layer has neither alpha nor colour keep their exact values.
        """
        ...

    def copy(self) -> Picture:
        """A deep copy."""
        ...

    def crossfade(self, other: Picture, weight: float) -> None:
        """Mix the codes, in place, with `weight` (0 to 1) of another picture of the same form.

        Samples that are the same in both keep their exact values.
        """
        ...


class CocPrior(Struct, frozen=True, kw_only=True):
    """Distribution of CoC in an estimator's training pictures, roughly log-normal.

    Attributes:
        mean: of log(1 + CoC diameter [px that the estimator sees]) [1].
        deviation: of it, > 0 [1].
        scale: pixels of the frame by those that the estimator sees, > 0 [1].
    """

    mean: float
    deviation: float
    scale: float = 1.0


class CocMap(Struct, frozen=True, kw_only=True):
    """Unsigned CoC of the plate and its expected error.

    Attributes:
        coc_px: CoC diameter (H, W), >= 0, without sign [px of the frame].
        sigma_px: expected absolute error of it (H, W), > 0 [px of the frame].
        frames: pictures of the plate that were averaged for it [1].
        prior: training prior towards which uncertain estimates shrink, None without one.
        luma: of the picture that was read, at the size at which it was (h, w), display-coded, None
            where it is not at hand [code value, 0 to 1].
        cells: means over squares of 16 px of that picture of log(1 + CoC), of its square and of
            log(sigma / (1 + CoC)), CoC and sigma in its pixels (rows, columns, 3), perhaps with a
            margin below and on the right; None where they are not at hand.
    """

    coc_px: Float32
    sigma_px: Float32
    frames: int = 1
    prior: CocPrior | None = None
    luma: Float32 | None = None
    cells: Float32 | None = None

    def __post_init__(self) -> None:
        if self.coc_px.ndim != 2 or self.coc_px.shape != self.sigma_px.shape:
            raise ValueError(f"{self.coc_px.shape = } and {self.sigma_px.shape = } must be (H, W)")


def _check_shapes(shape: tuple[int, int], **arrays: Float32) -> None:
    """Check that arrays cover a layer's rows and columns, `rgba` ones with four channels."""
    for name, array in arrays.items():
        expected = (*shape, 4) if name.endswith("rgba") else shape
        if array.shape != expected:
            raise ValueError(f"{name} has the shape {array.shape}, expected {expected}")


class ObjectLayer(Struct, frozen=True, kw_only=True, weakref=True):
    """The sharp rendered object on a box of the frame.

    Attributes:
        box: where the arrays lie in the frame; may reach beyond it.
        rgba: premultiplied scene-linear colour and alpha (h, w, 4), float32; colour may exceed 1.
        depth: camera-space depth along the optical axis (h, w), +inf where nothing is [scene unit].
    """

    box: Box
    rgba: Float32
    depth: Float32

    def __post_init__(self) -> None:
        _check_shapes(self.box.shape, rgba=self.rgba, depth=self.depth)


class BehindLayer(Struct, frozen=True, kw_only=True):
    """What the object's nearest surfaces hide, on a part of its picture.

    Attributes:
        hidden: the nearest surface behind them.
        front_rgba: what they alone give to each pixel (h, w, 4), without what lies behind them
            in an antialiased pixel.
    """

    hidden: ObjectLayer
    front_rgba: Float32

    def __post_init__(self) -> None:
        _check_shapes(self.hidden.box.shape, front_rgba=self.front_rgba)


class HiddenLayer(Struct, frozen=True, kw_only=True):
    """What the object's nearest surfaces hide, as the lens blurs it.

    Attributes:
        box: where the arrays lie in the frame; empty where nothing is hidden.
        rgba: the nearest surface behind them, premultiplied scene-linear (h, w, 4).
        coc_px: its signed CoC diameter (h, w), 0 where it is not [px of the frame].
        front_rgba: what they alone give to each pixel (h, w, 4).
    """

    box: Box
    rgba: Float32
    coc_px: Float32
    front_rgba: Float32

    def __post_init__(self) -> None:
        _check_shapes(
            self.box.shape, rgba=self.rgba, coc_px=self.coc_px, front_rgba=self.front_rgba
        )

    @classmethod
    def nothing(cls) -> HiddenLayer:
        """The empty layer: nothing is hidden."""
        none = np.zeros((0, 0, 4), np.float32)
        return cls(box=Box(0, 0, 0, 0), rgba=none, coc_px=none[..., 0], front_rgba=none)


def _largest(values: Float32, where: Bool) -> float:
    """The largest size of some values, 0 for none; quicker than to pick them out first."""
    kept = np.where(where, values, np.float32(0.0))
    return float(max(kept.max(initial=0.0), -kept.min(initial=0.0)))


class DefocusedLayer(Struct, frozen=True, kw_only=True, dict=True):  # to keep values
    """A sharp layer and the CoC that the lens gives each of its pixels.

    Attributes:
        layer: the sharp object.
        coc_px: signed CoC diameter (h, w), finite wherever the layer has alpha [px of the frame].
        behind: what its nearest surfaces hide, None where that is unknown.
    """

    layer: ObjectLayer
    coc_px: Float32
    behind: HiddenLayer | None = None

    def __post_init__(self) -> None:
        _check_shapes(self.layer.box.shape, coc_px=self.coc_px)

    @cached_property
    def largest_coc_px(self) -> float:
        """Largest CoC diameter of a pixel that has alpha, 0 for an empty layer [px]."""
        covered = self.layer.rgba[..., 3] > 0
        return _largest(self.coc_px, covered)

    @property
    def largest_step_px(self) -> float:
        """Largest difference of the CoC between neighbours that both have alpha [px]."""
        covered = self.layer.rgba[..., 3] > 0
        down, across = covered[1:] & covered[:-1], covered[:, 1:] & covered[:, :-1]
        coc = self.coc_px
        steps = (coc[1:] - coc[:-1], down), (coc[:, 1:] - coc[:, :-1], across)
        return max(_largest(step, both) for step, both in steps)


class BlurredLayer(Struct, frozen=True, kw_only=True):
    """The object as the lens sees it.

    Attributes:
        box: where the array lies in the frame; inside it.
        rgba: premultiplied scene-linear colour and alpha (h, w, 4), float32.
    """

    box: Box
    rgba: Float32

    def __post_init__(self) -> None:
        _check_shapes(self.box.shape, rgba=self.rgba)

    @classmethod
    def nothing(cls) -> BlurredLayer:
        """The empty layer."""
        return cls(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))


class Matte(Struct, frozen=True, eq=False):
    """Coverage by foreground, from a matte.

    Attributes:
        coverage: share of each pixel (H, W) that it covers, 0 to 1 [1].
    """

    coverage: Float32


class DepthMap(Struct, frozen=True, eq=False):
    """Depth of the filmed scene, without defocus.

    Attributes:
        depth: camera-space depth along the optical axis (H, W), > 0, +inf where none is known
            [scene unit].
    """

    depth: Float32
