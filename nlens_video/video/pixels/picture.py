"""Pictures that are composited on in their own samples: FFmpeg's frames and NumPy arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import av
import numpy as np

from nlens_video.core.color import ColorTags, primaries_from_bt709, transfer
from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.video.pixels import blend
from nlens_video.video.pixels.conversion import converted, copied, unpacked
from nlens_video.video.pixels.orientation import Orientation, frame_orientation
from nlens_video.video.pixels.samples import (
    Plane,
    Samples,
    array_samples,
    frame_samples,
    frame_tags,
)

SRGB = ColorTags(matrix="gbr", transfer="iec61966-2-1", primaries="bt709", full_range=True)
"""Tags of an array that carries none: display-coded sRGB."""
_SRGB_TRC = 13


class SamplesPicture:
    """A `Picture` that is defined by its samples."""

    def samples(self) -> Samples:
        """Upright views of the samples."""
        raise NotImplementedError

    def _make_writable(self) -> None:
        """Prepare the samples for writing."""

    @property
    def peak(self) -> float:
        """Light at which its codes end, infinite where float samples hold light itself."""
        samples = self.samples()
        curve = samples.coding.tags.transfer
        if curve == "linear" and not samples.coding.bits:
            return math.inf
        return float(transfer(curve).to_linear(np.array(1.0)))

    def srgb(self) -> Float32:
        """The whole picture, display-coded sRGB in [0, 1], (H, W, 3)."""
        return blend.srgb(self.samples())

    def shown(self) -> Float32:
        """The whole picture as players show it, in [0, 1] (H, W, 3)."""
        return blend.shown(self.samples())

    def linear(self, box: Box) -> Float32:
        """Scene-linear BT.709 RGB (h, w, 3) of a box that lies inside the frame."""
        samples = self.samples()
        _check(samples, box)
        return blend.linear(samples, box)

    def green_patches(self, corners: Sequence[tuple[int, int]], side: int) -> Float32:
        """Scene-linear BT.709 green (N, side, side) of squares that lie inside the frame."""
        samples = self.samples()
        for x, y in corners:
            _check(samples, Box(x, y, x + side, y + side))
        return blend.green_patches(samples, corners, side)

    def downsample(self, width: int, height: int) -> Float32:
        """Scene-linear BT.709 RGB (height, width, 3) of means of nine codes."""
        return blend.downsample(self.samples(), width, height)

    def composite_over(self, box: Box, rgba: Float32, *, of_plate: bool = False) -> None:
        """Composite a premultiplied scene-linear layer (h, w, 4) over a box inside the frame."""
        self._make_writable()
        samples = self.samples()
        _check(samples, box, rgba)
        blend.composite_over(samples, box, rgba, of_plate=of_plate)

    def crossfade(self, other: Picture, weight: float) -> None:
        """Mix the codes, in place, with `weight` (0 to 1) of another picture of the same form."""
        if not isinstance(other, SamplesPicture):
            raise TypeError(f"{type(other).__name__} has no samples")
        self._make_writable()
        mine, theirs = self.samples(), other.samples()
        for own, its in zip(
            (*mine.planes, mine.alpha), (*theirs.planes, theirs.alpha), strict=True
        ):
            if own is None or its is None:
                continue
            change = np.float32(weight) * (its.astype(np.float32) - own)
            if own.dtype.kind == "u":
                change = np.rint(change)
            own[...] = (own + change).astype(own.dtype)


class AvPicture(SamplesPicture):
    """One of FFmpeg's frames, seen upright.

    A frame in another format than a working format is unpacked; `frame` is then that copy. It is
    made writable only for compositing.

    Args:
        frame: the frame; composited in place.
        tags: colour tags; default: those of the frame.
        orientation: how it is displayed; default: by the frame's display matrix.
        chroma_siting: FFmpeg's name of where chroma lies; empty for `left`, as in most video.

    Raises:
        InputError: the pixel format is not supported; a colour tag, once `tags` are asked for.
    """

    def __init__(
        self, frame: av.VideoFrame, tags: ColorTags | None = None, *,
        orientation: Orientation | None = None, chroma_siting: str = "",
    ) -> None:  # fmt: skip
        self.frame = unpacked(frame)
        self._tags = tags
        self.orientation = frame_orientation(frame) if orientation is None else orientation
        self.chroma_siting = chroma_siting

    @property
    def tags(self) -> ColorTags:
        """Colour tags of the samples."""
        return frame_tags(self.frame) if self._tags is None else self._tags

    @property
    def width(self) -> int:
        """Columns as displayed [px]."""
        return self.frame.height if self.orientation.sideways else self.frame.width

    @property
    def height(self) -> int:
        """Rows as displayed [px]."""
        return self.frame.width if self.orientation.sideways else self.frame.height

    def samples(self) -> Samples:
        """Upright views of the frame's samples."""
        return frame_samples(
            self.frame, self.tags, self.orientation, chroma_siting=self.chroma_siting
        )

    def _make_writable(self) -> None:
        # the decoder predicts later frames from this buffer: writing to it would damage them
        self.frame.make_writable()

    def copy(self) -> AvPicture:
        """The same picture with samples of its own."""
        return AvPicture(
            copied(self.frame), self._tags, orientation=self.orientation,
            chroma_siting=self.chroma_siting,
        )  # fmt: skip


class ArrayPicture(SamplesPicture):
    """A NumPy picture, as in OpenCV or an image loop; composited in place.

    Args:
        array: (H, W), (H, W, 3) or (H, W, 4) of uint8, uint16 or float32.
        order: order of the channels.
        tags: transfer function and primaries; default: display-coded sRGB.
        associated: whether the colours are premultiplied by alpha; default: alpha is straight.

    Raises:
        InputError: a shape or a type that no picture has.
        ValueError: associated alpha with a transfer function that is not linear.
    """

    def __init__(
        self, array: Plane, order: Literal["bgr", "rgb"] = "bgr", tags: ColorTags = SRGB,
        *, associated: bool = False,
    ) -> None:  # fmt: skip
        if associated and tags.transfer != "linear":
            raise ValueError(f"associated alpha needs linear light, not {tags.transfer}")
        self.array = array
        self.order = order
        self.tags = tags
        self.associated = associated
        self._views = array_samples(array, order, tags, associated=associated)

    @property
    def width(self) -> int:
        """Columns [px]."""
        return int(self.array.shape[1])

    @property
    def height(self) -> int:
        """Rows [px]."""
        return int(self.array.shape[0])

    def samples(self) -> Samples:
        """Views of the array."""
        return self._views

    def copy(self) -> ArrayPicture:
        """The same picture with samples of its own."""
        return ArrayPicture(self.array.copy(), self.order, self.tags, associated=self.associated)


def _check(samples: Samples, box: Box, rgba: Float32 | None = None) -> None:
    """Refuse what the kernels, which do not check bounds, cannot process."""
    height, width = samples.planes[0].shape
    if box.intersection(Box(0, 0, width, height)) != box and not box.empty:
        raise ValueError(f"{box} does not lie inside the frame of {width}x{height}")
    if rgba is not None and rgba.shape != (box.height, box.width, 4):
        raise ValueError(f"{rgba.shape = } does not fit {box}")
    if rgba is not None and not _finite(rgba):
        raise ValueError("the layer holds values that are not finite")


def _finite(values: Float32) -> bool:
    """Whether all values are finite; their sum tells it sooner, unless it overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(values.sum()) or np.isfinite(values).all())


def picture_frame(picture: Picture, pixel_format: str, *, limited: bool = False) -> av.VideoFrame:
    """The picture as a stored (not upright) frame; the same frame where the format fits.

    Args:
        picture: any.
        pixel_format: FFmpeg's name of the frame's format.
        limited: whether YUV of full range becomes limited; the format is then YUV.
    """
    if isinstance(picture, AvPicture):
        frame, tags, siting = picture.frame, picture.tags, picture.chroma_siting
    elif isinstance(picture, ArrayPicture):
        keeps = any(part.is_alpha for part in av.VideoFormat(pixel_format).components)
        frame, tags, siting = _array_frame(picture, alpha=keeps), None, ""
    else:
        raise TypeError(f"{type(picture).__name__} has no samples")
    if frame.format.name == pixel_format and not limited:
        return frame
    return converted(frame, pixel_format, tags, limited=limited, chroma_siting=siting)


def _array_frame(picture: ArrayPicture, *, alpha: bool) -> av.VideoFrame:
    """An RGB array as a frame; light becomes 16-bit sRGB of BT.709, clipped to [0, 1].

    FFmpeg's alpha is straight; without alpha, associated colours are those over black.
    """
    array, tags = picture.array, picture.tags
    if picture.associated:
        array = _straight(array) if alpha else array[..., :3]
    if array.dtype == np.float32:
        array = _coded(array, tags)
    deep = array.dtype == np.uint16
    if array.ndim == 2:
        name = "gray16le" if deep else "gray"
    else:
        array = array if picture.order == "rgb" else array[..., (2, 1, 0, 3)[: array.shape[2]]]
        kind = "rgba" if array.shape[2] == 4 else "rgb"
        name = {"rgb": ("rgb24", "rgb48le"), "rgba": ("rgba", "rgba64le")}[kind][deep]
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(array), name)
    frame.color_trc, frame.color_primaries, frame.color_range = _SRGB_TRC, 1, 2
    return frame


def _straight(array: Plane) -> Plane:
    cover = np.where(array[..., 3:] > 0, array[..., 3:], 1)
    return np.concatenate([array[..., :3] / cover, array[..., 3:]], axis=2)


def _coded(array: Plane, tags: ColorTags) -> Plane:
    values = array.astype(np.float64)
    colour = values[..., :3] if values.ndim == 3 else values
    if tags.transfer == "linear":
        if tags.primaries != "bt709":
            colour[...] = colour @ np.linalg.inv(primaries_from_bt709(tags.primaries)).T
        colour[...] = transfer("iec61966-2-1").to_coded(colour)
    return np.asarray(np.clip(values, 0.0, 1.0) * 65535.0 + 0.5).astype(np.uint16)
