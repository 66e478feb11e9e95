"""Pictures that composite on their own samples: FFmpeg's frames and NumPy arrays."""

from __future__ import annotations

from typing import Literal

import av
import numpy as np
import numpy.typing as npt

from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.video.pixels import blend
from nlens_video.video.pixels.pixel_formats import unpacked
from nlens_video.video.pixels.sample_tables import Plane, Samples
from nlens_video.video.pixels.sample_views import array_samples, frame_samples, frame_tags

SRGB = ColorTags(matrix="gbr", transfer="iec61966-2-1", primaries="bt709", full_range=True)
"""Tags of an array that carries none: display-coded sRGB."""


class _Blended:
    """The half of a `Picture` that only needs samples."""

    def _samples(self) -> Samples:
        raise NotImplementedError

    def _mix(self, other: Picture, share: float) -> None:
        if not isinstance(other, _Blended):
            raise TypeError(f"{type(other).__name__} has no samples")
        mine, theirs = self._samples(), other._samples()
        for own, its in zip(
            (*mine.planes, mine.alpha), (*theirs.planes, theirs.alpha), strict=True
        ):
            if own is None or its is None:
                continue
            moved = np.float32(share) * (its.astype(np.float32) - own)
            if own.dtype.kind == "u":
                moved = np.rint(moved)
            own[...] = (own + moved).astype(own.dtype)

    def srgb(self) -> Float32:
        """The whole picture, display-coded sRGB in [0, 1], (H, W, 3)."""
        samples = self._samples()
        height, width = samples.planes[0].shape
        return blend.srgb(samples, Box(0, 0, width, height))

    def linear(self, box: Box) -> Float32:
        """Scene-linear BT.709 RGB (h, w, 3) of a box that lies inside the frame."""
        samples = self._samples()
        _check(samples, box)
        return blend.linear(samples, box)

    def reduced(self, width: int, height: int) -> Float32:
        """Scene-linear BT.709 RGB (height, width, 3) of means of nine codes, for measurements."""
        return blend.reduced(self._samples(), width, height)


def copied(frame: av.VideoFrame) -> av.VideoFrame:
    """A frame with samples of its own."""
    copy = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for mine, theirs in zip(copy.planes, frame.planes, strict=True):
        rows, own = _rows(theirs), _rows(mine)
        height, width = np.minimum(rows.shape, own.shape)
        own[:height, :width] = rows[:height, :width]
    take_tags(copy, frame)
    return copy


def take_tags(made: av.VideoFrame, frame: av.VideoFrame) -> None:
    """Give a frame the time and the colour tags of the one it was made from."""
    made.pts = frame.pts
    if frame.time_base is not None:  # frames that no decoder has made have none
        made.time_base = frame.time_base
    made.colorspace, made.color_range = frame.colorspace, frame.color_range
    made.color_primaries, made.color_trc = frame.color_primaries, frame.color_trc


def _rows(plane: av.video.plane.VideoPlane) -> npt.NDArray[np.uint8]:
    """The bytes of a plane by rows, padding included; a palette, which has no rows, as one."""
    return np.frombuffer(memoryview(plane), np.uint8).reshape(
        -1, plane.line_size or plane.buffer_size
    )


class AvPicture(_Blended):
    """One of FFmpeg's frames, seen upright.

    The frame is unpacked into a working format where it is in none; `frame` is then that copy. It
    is made writable only when something is composited on it.

    Args:
        frame: the frame; composited in place.
        tags: what the samples mean; default: what the frame's own tags say.
        rotation: counter-clockwise turn that makes it upright, a multiple of 90 [deg]; default:
            the frame's display matrix.
        centred_chroma: whether chroma at half the width lies between two luma columns, as in
            JPEG; default: on the left one, as in nearly all video of either range.

    Raises:
        InputError: the pixel format is one that nothing is known about.
    """

    def __init__(
        self, frame: av.VideoFrame, tags: ColorTags | None = None, *, rotation: int | None = None,
        centred_chroma: bool = False,
    ) -> None:  # fmt: skip
        self.frame = unpacked(frame)
        self.tags = frame_tags(self.frame) if tags is None else tags
        self.rotation = frame.rotation if rotation is None else rotation
        self.centred_chroma = centred_chroma

    @property
    def width(self) -> int:
        """Columns as displayed [px]."""
        return self.frame.height if self._lies else self.frame.width

    @property
    def height(self) -> int:
        """Rows as displayed [px]."""
        return self.frame.width if self._lies else self.frame.height

    @property
    def _lies(self) -> bool:
        return round(self.rotation / 90) % 2 == 1

    def _samples(self) -> Samples:
        return frame_samples(
            self.frame, self.tags, round(self.rotation / 90), centred_chroma=self.centred_chroma
        )

    def over(self, box: Box, rgba: Float32, *, of_plate: bool = False) -> None:
        """Composite a premultiplied scene-linear layer (h, w, 4) over a box inside the frame."""
        # The decoder predicts later frames from this buffer: without a copy they would be damaged.
        self.frame.make_writable()
        samples = self._samples()
        _check(samples, box, rgba)
        blend.over(samples, box, rgba, of_plate=of_plate)

    def copy(self) -> AvPicture:
        """The same picture with samples of its own."""
        return AvPicture(
            copied(self.frame), self.tags, rotation=self.rotation,
            centred_chroma=self.centred_chroma,
        )  # fmt: skip

    def mix(self, other: Picture, share: float) -> None:
        """Become a mean of the codes with `share` of another picture of the same form, 0 to 1."""
        self.frame.make_writable()
        self._mix(other, share)


class ArrayPicture(_Blended):
    """A NumPy picture, as OpenCV and image loops hold it; composited in place.

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

    def _samples(self) -> Samples:
        return self._views

    def over(self, box: Box, rgba: Float32, *, of_plate: bool = False) -> None:
        """Composite a premultiplied scene-linear layer (h, w, 4) over a box inside the frame."""
        _check(self._views, box, rgba)
        blend.over(self._views, box, rgba, of_plate=of_plate)

    def copy(self) -> ArrayPicture:
        """The same picture with samples of its own."""
        return ArrayPicture(
            self.array.copy(), self.order, self.tags, associated=self.associated
        )  # fmt: skip

    def mix(self, other: Picture, share: float) -> None:
        """Become a mean of the codes with `share` of another picture of the same form, 0 to 1."""
        self._mix(other, share)


def _check(samples: Samples, box: Box, rgba: Float32 | None = None) -> None:
    """The kernels do not look where they write, so this does."""
    height, width = samples.planes[0].shape
    if box.intersection(Box(0, 0, width, height)) != box and not box.empty:
        raise ValueError(f"{box} does not lie inside the frame of {width}x{height}")
    if rgba is not None and rgba.shape != (box.height, box.width, 4):
        raise ValueError(f"{rgba.shape = } does not fit {box}")
    if rgba is not None and not np.isfinite(rgba).all():
        raise ValueError("the layer holds values that are not finite")
