"""Pictures in memory that belongs to another program, composited where they lie."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from nlens_video.core.color import ColorTags
from nlens_video.core.errors import InputError
from nlens_video.video.pixels.picture import SamplesPicture
from nlens_video.video.pixels.pixel_formats import WORKING_FORMATS, PixelLayout, layout
from nlens_video.video.pixels.samples import Plane, Samples, memory_samples

Memory = npt.NDArray[Any]
"""A plane (H, W) or (H, bytes of a row), padding included; C-contiguous along its rows."""


class _Place(NamedTuple):
    """Where a component's samples lie in the rows of a plane, counted in samples."""

    plane: int
    first: int
    step: int


_INTERLEAVED = {
    "nv12": ((0, 0, 1), (1, 0, 2), (1, 1, 2)),
    "nv21": ((0, 0, 1), (1, 1, 2), (1, 0, 2)),
    "nv16": ((0, 0, 1), (1, 0, 2), (1, 1, 2)),
    "nv24": ((0, 0, 1), (1, 0, 2), (1, 1, 2)),
    "yuyv422": ((0, 0, 2), (0, 1, 4), (0, 3, 4)),
    "yvyu422": ((0, 0, 2), (0, 3, 4), (0, 1, 4)),
    "uyvy422": ((0, 1, 2), (0, 0, 4), (0, 2, 4)),
}
"""Formats whose components share planes: plane, first sample and step of Y, Cb, Cr."""


class MemoryPicture(SamplesPicture):
    """A picture in another program's memory; composited in place, without a copy.

    Args:
        planes: as the pixel format has them, writable, rows from the top.
        pixel_format: FFmpeg's name.
        size: columns and rows [px].
        tags: meaning of the codes.
        centred_chroma: whether chroma at half the width lies between two luma columns.

    Raises:
        InputError: the format has no such samples, or the planes are too small for it.
    """

    def __init__(
        self, planes: Sequence[Memory], pixel_format: str, size: tuple[int, int], tags: ColorTags,
        *, centred_chroma: bool = False,
    ) -> None:  # fmt: skip
        self.width, self.height = size
        kind, places = _format(pixel_format)
        views = [
            self._view(planes, place, kind, is_chroma=kind.family == "yuv" and number in (1, 2))
            for number, place in enumerate(places)
        ]
        self._given = (tuple(planes), pixel_format, size, tags)
        self._centred = centred_chroma
        self._samples = memory_samples(views, kind, tags, centred_chroma=centred_chroma)

    def _view(
        self, planes: Sequence[Memory], place: _Place, kind: PixelLayout, *, is_chroma: bool
    ) -> Plane:
        across, down = (kind.step_x, kind.step_y) if is_chroma else (1, 1)
        columns, rows = -(-self.width // across), -(-self.height // down)
        least = place.first + place.step * (columns - 1) + 1
        wanted = np.dtype(kind.dtype)
        if place.plane < len(planes):
            plane = planes[place.plane].view(wanted)
            if plane.ndim == 2 and plane.shape[0] >= rows and plane.shape[1] >= least:
                return plane[:rows, place.first : least : place.step]
        raise InputError(
            f"plane {place.plane} is too small or missing; expected {rows} rows of at least "
            f"{least * wanted.itemsize} bytes"
        )

    def samples(self) -> Samples:
        """Views of the memory."""
        return self._samples

    def copy(self) -> MemoryPicture:
        """The same picture with samples of its own."""
        planes, pixel_format, size, tags = self._given
        own = [plane.copy() for plane in planes]
        return MemoryPicture(own, pixel_format, size, tags, centred_chroma=self._centred)


def picture_layout(pixel_format: str) -> PixelLayout:
    """Layout of the samples of a format that can be composited in where it lies.

    Raises:
        InputError: it cannot.
    """
    return _format(pixel_format)[0]


@lru_cache(maxsize=256)
def _format(name: str) -> tuple[PixelLayout, tuple[_Place, ...]]:
    if name in _INTERLEAVED:
        kind = layout(WORKING_FORMATS[name])
        places = tuple(_Place(*place) for place in _INTERLEAVED[name])
    else:
        kind = None if re.search(r"be$", name) else layout(name)
        places = () if kind is None else tuple(
            _Place(plane, first, kind.channels) for plane, first in kind.components
        )  # fmt: skip
    if kind is None:
        raise InputError(
            f"pixel format {name} cannot be composited in where it lies; convert it first, "
            "to yuv420p or gbrp for example"
        )
    return kind, places
