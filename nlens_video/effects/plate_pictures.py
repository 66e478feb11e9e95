"""A shot's first pictures, with what several effects read off them computed once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar, overload

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Picture
from nlens_video.scene.illumination import LUMINANCE
from nlens_video.stages.f_coc import still_run

_MOST_STILL = 5  # pictures of a still camera that are decoded
_MOST_COLUMNS, _MOST_ROWS = 1280, 720
_LUMINANCE = LUMINANCE.astype(np.float32)
T = TypeVar("T")


class _Once(Generic[T]):
    """A value that the first thread to ask for it computes, while others wait for it."""

    def __init__(self, compute: Callable[[], T]) -> None:
        self._compute = compute
        self._lock = threading.Lock()
        self._value: tuple[T] | None = None

    def __call__(self) -> T:
        with self._lock:
            if self._value is None:
                self._value = (self._compute(),)
            return self._value[0]


class PlatePictures(Sequence[Picture]):
    """Pictures that are measured, at least one.

    Attributes:
        codes: gives the first one, display-coded sRGB (H, W, 3).
        light: gives the luminance of the first one, scene-linear (H, W).
        still: gives those at the beginning during which the camera stands still, display-coded
            sRGB of their middle (h, w, 3), and the pixels (h, w) on which nothing moves.
    """

    def __init__(self, pictures: Sequence[Picture]) -> None:
        self._pictures = pictures
        self.codes = _Once(pictures[0].srgb)
        self.light = _Once(self._light)
        self.still = _Once(self._still)

    @classmethod
    def of(cls, pictures: Sequence[Picture]) -> PlatePictures:
        """The pictures themselves where they are of this class already."""
        return pictures if isinstance(pictures, cls) else cls(pictures)

    def __len__(self) -> int:
        return len(self._pictures)

    @overload
    def __getitem__(self, at: int) -> Picture: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[Picture]: ...
    def __getitem__(self, at: int | slice) -> Picture | Sequence[Picture]:
        return self._pictures[at]

    def _light(self) -> Float32:
        first = self[0]
        light = first.linear(Box(0, 0, first.width, first.height)) @ _LUMINANCE
        return np.asarray(light, np.float32)

    def _still(self) -> tuple[list[Float32], Bool]:
        frame = Box(0, 0, self[0].width, self[0].height)
        middle = self._middle.slices_in(frame)
        others = [picture.srgb() for picture in self[1:_MOST_STILL]]
        return still_run([codes[middle] for codes in (self.codes(), *others)])

    def light_of_still(self) -> list[Float32]:
        """Scene-linear light (h, w, 3) of what `still` gives the codes of."""
        return [picture.linear(self._middle) for picture in self[: len(self.still()[0])]]

    @property
    def _middle(self) -> Box:
        """The middle of a large picture: noise and sharpness need not be measured everywhere."""
        width, height = self[0].width, self[0].height
        rows, columns = min(height, _MOST_ROWS), min(width, _MOST_COLUMNS)
        top, left = (height - rows) // 2, (width - columns) // 2
        return Box(left, top, left + columns, top + rows)
