"""A shot's first pictures, with what several effects read off them computed once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
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
        # None of them refers to this object: pictures in a cycle would outlive it.
        self.codes = _Once(pictures[0].srgb)
        self.light = _Once(partial(_light, pictures[0]))
        self.still = _Once(partial(_still, pictures[:_MOST_STILL], self.codes))

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

    def light_of_still(self) -> list[Float32]:
        """Scene-linear light (h, w, 3) of what `still` gives the codes of."""
        middle = _middle(self[0])
        return [picture.linear(middle) for picture in self[: len(self.still()[0])]]


def _light(first: Picture) -> Float32:
    light = first.linear(Box(0, 0, first.width, first.height)) @ _LUMINANCE
    return np.asarray(light, np.float32)


def _still(
    pictures: Sequence[Picture], first_codes: Callable[[], Float32]
) -> tuple[list[Float32], Bool]:
    first = pictures[0]
    middle = _middle(first).slices_in(Box(0, 0, first.width, first.height))
    others = [picture.srgb() for picture in pictures[1:]]
    return still_run([codes[middle] for codes in (first_codes(), *others)])


def _middle(first: Picture) -> Box:
    """The middle of a large picture: noise and sharpness need not be measured everywhere."""
    width, height = first.width, first.height
    rows, columns = min(height, _MOST_ROWS), min(width, _MOST_COLUMNS)
    top, left = (height - rows) // 2, (width - columns) // 2
    return Box(left, top, left + columns, top + rows)
