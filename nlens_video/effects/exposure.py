"""Exposure and white balance of the plate over the shot, which the object follows.

The object was lit for the first frame. Each later frame is compared with one before it, made small:
the median of the ratio of their light is the change of the exposure, whatever moves in less than
half of the picture. Where the camera moves the pictures are laid over each other first. Where they
cannot be compared (a cut, a whip pan) the last known change stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Float32, Float64, Picture
from nlens_video.effects.exposure_kernels import take_change, take_stops

NEGLIGIBLE_LEVELS = 1.0  # of 255, at mid grey; from twice that on it is followed in full
_SIZE = (40, 24)  # columns and rows that a picture is compared at [px]
_LARGEST_SPREAD_STOPS = 0.2  # median deviation of the ratio, above which it tells nothing
_LEAST_SHARE = 0.25  # of the picture that must be there to compare
_MID_GREY, _GAMMA = 118.0, 2.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """Light of a frame by that of the first one.

    Attributes:
        gains: of red, green and blue [1].
    """

    gains: tuple[float, float, float]

    @property
    def levels(self) -> float:
        """By how much mid grey changes, in the channel that changes most [8-bit levels]."""
        return max(abs(_levels(math.log2(gain))) for gain in self.gains)


@dataclass(frozen=True, slots=True)
class _Seen:
    """A small picture and the change of the exposure at it.

    Attributes:
        stops: logarithmic light (h, w, 3), NaN where it is too dark or too bright.
        change: since the first frame (3,) [stops].
    """

    stops: Float32
    change: Float64


class MeasureExposure:
    """Measures each frame of a shot against those before it; frames come in order."""

    def __init__(self) -> None:
        self._anchor: _Seen | None = None
        self._last: _Seen | None = None

    def __call__(self, picture: Picture) -> Exposure:
        """Measure one frame."""
        stops = _stops(picture.reduced(*_SIZE))
        if self._anchor is None or self._last is None:
            seen = _Seen(stops, np.zeros(3))
            self._anchor = seen
        else:
            change = _change(self._anchor, stops)
            if change is not None:
                seen = _Seen(stops, change)
            else:  # what the first picture showed has gone out of view: go on from the last one
                change = _change(self._last, stops)
                seen = _Seen(stops, self._last.change if change is None else change)
                self._anchor = seen
        self._last = seen
        return Exposure(gains=_followed(seen.change))


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


def _stops(light: Float32) -> Float32:
    """Logarithmic light (h, w, 3), NaN where a channel is too dark or too bright."""
    stops = np.empty_like(light)
    take_stops(light, stops)
    return stops


def _followed(change: Float64) -> tuple[float, float, float]:
    """Gains for a change [stops]: none for a small one, and no jump between the two."""
    parts = change.tolist()
    levels = max(abs(_levels(part)) for part in parts)
    share = min(max(levels / NEGLIGIBLE_LEVELS - 1.0, 0.0), 1.0)
    share *= share * (3.0 - 2.0 * share)
    red, green, blue = (2.0 ** (share * part) for part in parts)
    return red, green, blue


def _levels(stops: float) -> float:
    return float(_MID_GREY * (2.0 ** (stops / _GAMMA) - 1.0))


def _change(before: _Seen, stops: Float32) -> Float64 | None:
    """Change of the exposure since the first frame (3,) [stops]; None where nothing tells it."""
    there = np.empty(3)
    told = take_change(before.stops, stops, _LEAST_SHARE, _LARGEST_SPREAD_STOPS, there)
    if not told:
        moved = _laid_over(before.stops, stops)
        if moved is None:
            return None
        told = take_change(moved, stops, _LEAST_SHARE, _LARGEST_SPREAD_STOPS, there)
    return before.change + there if told else None


def _laid_over(before: Float32, now: Float32) -> Float32 | None:
    """The earlier small picture where the later one shows the same; NaN beyond it."""
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
