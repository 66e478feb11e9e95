"""Exposure drift: exposure and white balance of the plate over the shot, applied to the object.

The object is lit for the first frame that tells the light: not for a black or a white one, with
which recordings and fades begin. Until then the ratio of the mean light is the change of the
exposure, where that frame is known beforehand. Each later frame is compared with an earlier one at
a small size: the median ratio of their light is the change, whatever moves in less than half of the
picture. Where the camera moves, the pictures are registered first. Where they cannot be compared
(a cut, a whip pan), the last known change holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Float32, Float64, Picture
from nlens_video.native import kernels

NEGLIGIBLE_LEVELS = 1.0  # of 255, at mid grey; from twice that on it is applied in full
DARKEST, BRIGHTEST = 0.01, 0.8  # light that is far enough from noise and from white [1]
_SIZE = (40, 24)  # columns and rows that a picture is compared at [px]
_LARGEST_SPREAD_STOPS = 0.2  # median deviation of the ratio up to which it is usable
_LEAST_SHARE = 0.25  # of the picture that both must show
_BLACK, _WHITE = 0.02, 0.9  # mean light of pictures that may show nothing [1]
_STEADY = 0.02  # change of the light from frame to frame up to which it rests [1]
_LEAST_LIGHT = 1e-5  # of a picture, which makes the object as black as it is [1]
_MID_GREY, _GAMMA = 118.0, 2.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """Light of a frame relative to the first one that tells it.

    Attributes:
        gains: of red, green and blue [1].
    """

    gains: tuple[float, float, float]

    @property
    def levels(self) -> float:
        """Largest change of mid grey in any channel [8-bit levels]."""
        return max(abs(_levels(math.log2(gain))) for gain in self.gains)


@dataclass(frozen=True, slots=True)
class _Keyframe:
    """A small picture and the change of the exposure at it.

    Attributes:
        stops: logarithmic light (h, w, 3), NaN where it is too dark or too bright.
        change: since the first frame that tells the light (3,) [stops].
    """

    stops: Float32
    change: Float64


class Beginning:
    """Finds the first frame of a shot that tells its light.

    That is the first one, unless it is black or white: then the first that is neither and at which
    the light has come to rest, so that a fade is over.

    Attributes:
        steady: whether the last frame is as bright as the one before it; not on the first frame.
        fades_in: whether it is brighter.
    """

    def __init__(self) -> None:
        self._level: float | None = None
        self.steady = self.fades_in = False

    def ends(self, picture: Picture) -> bool:
        """Whether the next frame of the shot tells its light."""
        light = picture.downsample(*_SIZE)
        stops = np.empty_like(light)
        take_stops(light, stops)
        return self.ends_with(light, stops)

    def ends_with(self, light: Float32, stops: Float32) -> bool:
        """`ends`, for the small picture (h, w, 3) and its logarithm as of `take_stops`."""
        first, level = self._level is None, float(light.mean())
        before, self._level = self._level or 0.0, level
        self.steady = not first and abs(level - before) <= _STEADY * before
        self.fades_in = not first and not self.steady and level > before
        known = np.isfinite(stops).all(axis=2).mean()
        tells = bool(known >= _LEAST_SHARE) or _BLACK < level < _WHITE
        return tells and (first or self.steady)


class MeasureExposure:
    """Measures each frame of a shot against those before it; frames come in order.

    Args:
        first_telling: reads the first picture that tells the light of a shot whose first one does
            not; None where the shot cannot be read ahead.
    """

    def __init__(self, first_telling: Callable[[], Picture | None] = lambda: None) -> None:
        self._first_telling = first_telling
        self._beginning, self._began = Beginning(), False
        self._anchor: _Keyframe | None = None
        self._last: _Keyframe | None = None

    def __call__(self, picture: Picture) -> Exposure:
        """Measure one frame."""
        light = picture.downsample(*_SIZE)
        stops = np.empty_like(light)
        take_stops(light, stops)
        if not self._began or self._anchor is None or self._last is None:
            self._began = self._beginning.ends_with(light, stops)
            told = None if self._began else self._first_telling()
            since = np.zeros(3) if told is None else _change_of_means(told, light)
            seen = _Keyframe(stops, since)
            self._anchor = seen
        else:
            change = _change(self._anchor, stops)
            if change is not None:
                seen = _Keyframe(stops, change)
            else:  # the anchor is out of view: compare with the last picture
                change = _change(self._last, stops)
                seen = _Keyframe(stops, self._last.change if change is None else change)
                self._anchor = seen
        self._last = seen
        return Exposure(gains=_gains(seen.change))


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


def _change(before: _Keyframe, stops: Float32) -> Float64 | None:
    """Change of the exposure since the first frame (3,) [stops]; None where it is unknown."""
    there = np.empty(3)
    told = take_change(before.stops, stops, _LEAST_SHARE, _LARGEST_SPREAD_STOPS, there)
    if not told:
        moved = _registered(before.stops, stops)
        if moved is None:
            return None
        told = take_change(moved, stops, _LEAST_SHARE, _LARGEST_SPREAD_STOPS, there)
    return before.change + there if told else None


def _change_of_means(told: Picture, light: Float32) -> Float64:
    """Change of the mean light (3,) from a picture to a small one (h, w, 3) [stops]."""
    means = [one.mean((0, 1), dtype=np.float64) for one in (told.downsample(*_SIZE), light)]
    before, now = (np.log2(np.maximum(mean, _LEAST_LIGHT)) for mean in means)
    return np.asarray(now - before)


def _registered(before: Float32, now: Float32) -> Float32 | None:
    """The earlier small picture registered to the later one; NaN beyond it."""
    if min(np.isfinite(part).mean() for part in (before, now)) < _LEAST_SHARE:
        return None
    window = cv2.createHanningWindow(_SIZE, cv2.CV_32F)
    flat = [np.nan_to_num(part[..., 1] - np.nanmean(part[..., 1])) for part in (before, now)]
    (across, down), response = cv2.phaseCorrelate(flat[0], flat[1], window)
    if response < 0.1:
        return None
    shift = np.array([[1.0, 0.0, across], [0.0, 1.0, down]])
    return np.asarray(
        cv2.warpAffine(
            before, shift, _SIZE, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,) * 3
        )
    )


def take_stops(light: Float32, stops: Float32) -> None:
    """Fill in logarithmic light (h, w, 3), NaN where a channel is too dark or too bright."""
    kernels.take_stops(light, (DARKEST, BRIGHTEST), stops)


def take_change(
    before: Float32, now: Float32, least_share: float, most_spread: float, change: Float64
) -> bool:
    """Fill in the median (3,) of the change from one picture (h, w, 3) to another [stops].

    Args:
        before: stops of the one.
        now: stops of the other.
        least_share: of the picture that must be known in both [1].
        most_spread: median deviation up to which it is the same in most places.
        change: the result.

    Returns:
        Whether it is usable.
    """
    return kernels.take_change(before, now, least_share, most_spread, change)


def stops_reference(light: Float32) -> Float64:
    """NumPy reference of `take_stops`."""
    lost = (light.min(axis=2) < DARKEST) | (light.max(axis=2) > BRIGHTEST)
    return np.where(lost[..., None], np.nan, np.log2(np.maximum(light, 1e-6, dtype=np.float64)))


def change_reference(
    before: Float32, now: Float32, least_share: float, most_spread: float
) -> Float64 | None:
    """NumPy reference of `take_change`; None where it is not usable."""
    ratio = (now - before).reshape(-1, 3)
    known = ratio[np.isfinite(ratio).all(axis=1)]
    if len(known) < least_share * len(ratio):
        return None
    middle = np.sort(known, axis=0)[len(known) // 2]
    spread = np.sort(np.abs(known - middle), axis=0)[len(known) // 2]
    return middle.astype(np.float64) if spread.max() < most_spread else None
