"""How the pictures of a source are turned and mirrored when they are shown."""

from __future__ import annotations

import math
from typing import Any

import av
import numpy as np
import numpy.typing as npt
from av.sidedata.sidedata import Type
from msgspec import Struct

from nlens_video.video.pixels.side_data import side_data

_TOLERANCE_DEG = 1.0
"""Angles this near to a multiple of 90 degrees are taken for it, as by the ffmpeg program."""


class Orientation(Struct, frozen=True):
    """The way from stored to displayed samples.

    Attributes:
        rotation: counter-clockwise turn, a multiple of 90 [deg].
        mirrored: whether left and right change places after the turn.
    """

    rotation: int = 0
    mirrored: bool = False

    @property
    def turns(self) -> int:
        """Quarter turns counter-clockwise, 0 to 3."""
        return self.rotation // 90 % 4

    @property
    def upright(self) -> bool:
        """Whether samples are stored as they are displayed."""
        return not self.turns and not self.mirrored

    @property
    def sideways(self) -> bool:
        """Whether columns are displayed as rows."""
        return self.turns % 2 == 1

    def shown(self, pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """View of stored pixels (H, W, ...) as they are displayed."""
        turned = np.rot90(pixels, self.turns)
        return np.fliplr(turned) if self.mirrored else turned


UPRIGHT = Orientation()


def frame_orientation(frame: av.VideoFrame) -> Orientation:
    """The orientation by a frame's display matrix; upright where it turns by another angle."""
    angle, mirrored = _turn(frame)
    rotation = 90 * round(angle / 90)
    if abs(angle - rotation) > _TOLERANCE_DEG:
        return UPRIGHT
    return Orientation(rotation, mirrored)


def frame_slant(frame: av.VideoFrame) -> float:
    """The angle of a display matrix that turns by no multiple of 90 degrees, else 0 [deg]."""
    angle, _ = _turn(frame)
    return 0.0 if abs(angle - 90 * round(angle / 90)) <= _TOLERANCE_DEG else angle


def _turn(frame: av.VideoFrame) -> tuple[float, bool]:
    """Counter-clockwise turn of a display matrix [deg], and whether it mirrors after that."""
    data = side_data(frame).get(Type.DISPLAYMATRIX)
    if data is None:
        return 0.0, False
    # a stored column x and row y are shown at column a x + c y and row b x + d y
    a, b, _, c, d = (int(value) for value in np.frombuffer(data, np.int32)[:5])
    mirrored = a * d < b * c
    return -math.degrees(math.atan2(b, -a if mirrored else a)), mirrored
