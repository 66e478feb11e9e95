"""Exposure drift: exposure and white balance of the plate over the shot, applied to the object.

The object is lit for the first frame that tells the light: not for a black or a white one, nor for
one of a fade, with which recordings begin. Until then the ratio of the mean light is the change of
the exposure, where that frame is known beforehand. Each later frame is compared with an earlier one
(`light_change`). A black frame makes the object as dark as its mean light. Where pictures cannot be
compared (a cut, a whip pan), the last known change holds.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import BlurredLayer, Float64, Picture
from nlens_video.effects.beginning import Beginning
from nlens_video.effects.light_change import SmallPicture

NEGLIGIBLE_LEVELS = 1.0  # of 255, at mid grey; from twice that on it is applied in full
_MID_GREY, _GAMMA = 118.0, 2.2


class Exposure(Struct, frozen=True, kw_only=True):
    """Light of a frame relative to the first one that tells it.

    Attributes:
        gains: of red, green and blue [1].
    """

    gains: tuple[float, float, float]

    @property
    def levels(self) -> float:
        """Largest change of mid grey in any channel [8-bit levels]."""
        return max(abs(_levels(math.log2(gain))) for gain in self.gains)


class _Keyframe(Struct, frozen=True):
    """A small picture and the change of the exposure at it.

    Attributes:
        picture: what it shows.
        change: since the first frame that tells the light (3,) [stops].
    """

    picture: SmallPicture
    change: Float64


class MeasureExposure:
    """Measures each frame of a shot against those before it; frames come in order.

    Args:
        told: the first picture that tells the light of a shot whose first one does not; None where
            that does, and where the shot cannot be read ahead.
    """

    def __init__(self, told: Picture | None = None) -> None:
        self._told = None if told is None else SmallPicture.of(told)
        self._beginning, self._began = Beginning(), False
        self._anchor: _Keyframe | None = None
        self._last: _Keyframe | None = None
        self._black = False

    def __call__(self, picture: Picture) -> Exposure:
        """Measure one frame."""
        small = SmallPicture.of(picture)
        begins = not self._began and self._begins(small)
        if begins or self._anchor is None or self._last is None:
            told = self._told
            change = np.zeros(3) if told is None else small.change_of_mean(told, (0, 1))
            seen = self._anchor = _Keyframe(small, change)
        elif small.shows_nothing:
            self._black = True
            change = self._last.change + small.change_of_mean(self._last.picture)
            return Exposure(gains=_gains(change))
        else:
            seen = self._follow(self._anchor, self._last, small)
        self._last, self._black = seen, False
        return Exposure(gains=_gains(seen.change))

    def _begins(self, small: SmallPicture) -> bool:
        """Whether a frame belongs to the beginning, or is the first one after it."""
        first, ends = self._anchor is None, self._beginning.ends_with(small)
        self._began = ends and not (first and self._told is not None)
        # a plate that stays dark never tells its light, but changes of it are followed
        return self._began or self._told is not None or not self._beginning.rests

    def _follow(self, anchor: _Keyframe, last: _Keyframe, small: SmallPicture) -> _Keyframe:
        change = small.change_since(anchor.picture)
        if change is not None:
            return _Keyframe(small, anchor.change + change)
        # the anchor is out of view: compare with the last picture
        change = small.change_since(last.picture)
        if change is None:
            # of what comes after a dip to black, only the mean light is known
            change = small.change_of_mean(last.picture) if self._black else np.zeros(3)
        self._anchor = _Keyframe(small, last.change + change)
        return self._anchor


def match_exposure(layer: BlurredLayer, exposure: Exposure) -> BlurredLayer:
    """A layer in the light of its frame.

    Args:
        layer: premultiplied, lit for the first frame.
        exposure: of this frame.
    """
    if exposure.gains == (1.0, 1.0, 1.0) or layer.box.empty:
        return layer
    gains = np.array([*exposure.gains, 1.0], np.float32)
    return BlurredLayer(box=layer.box, rgba=layer.rgba * gains)


def _gains(change: Float64) -> tuple[float, float, float]:
    """Gains for a change [stops]: none for a small one, and no jump between the two."""
    parts = change.tolist()
    levels = max(abs(_levels(part)) for part in parts)
    share = min(max(levels / NEGLIGIBLE_LEVELS - 1.0, 0.0), 1.0)
    share *= share * (3.0 - 2.0 * share)
    red, green, blue = (2.0 ** (share * part) for part in parts)
    return red, green, blue


def _levels(stops: float) -> float:
    return float(_MID_GREY * (2.0 ** (stops / _GAMMA) - 1.0))
