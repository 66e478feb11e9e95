"""The light of a picture at a small size, and its change from one picture to another.

The median ratio is the change, whatever moves in less than half of the picture. Where the camera
moves, the pictures are registered first. On plates that are dark, of one colour or lit in part,
codes closer to black and to white count too, each channel by itself. White is where the picture
clips: far beyond diffuse white in HDR, and nowhere in light itself.
"""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64, Picture, clips_at
from nlens_video.native import kernels

DARKEST, BRIGHTEST = 0.01, 0.8  # light far enough from noise and, by that of white, from white [1]
LEAST_SHARE = 0.25
"""Of a picture that must lie between these where it tells its light."""
_FAINTEST, _PALEST = 0.0015, 0.95  # the same where less than `LEAST_SHARE` lies between these [1]
_LEAST_SHARE_OF_DARK = 0.08  # of such a picture
_SIZE = (40, 24)  # columns and rows that a picture is compared at [px]
_LARGEST = float(np.finfo(np.float32).max)  # an infinite light tells nothing
_LEAST_LIGHT = 1e-5  # of a picture, which makes the object as black as it is [1]
_LARGEST_SPREAD_STOPS = 0.2  # median deviation of the ratio up to which it is usable


class SmallPicture(Struct, frozen=True):
    """A picture's light at a small size.

    Attributes:
        light: (h, w, 3) [1].
        stops: its logarithm, NaN where a channel is too dark or too bright.
        white: light at which it clips [1].
    """

    light: Float32
    stops: Float32
    white: float

    @classmethod
    def of(cls, picture: Picture) -> SmallPicture:
        """Reduce a picture."""
        light = picture.downsample(*_SIZE)
        stops, white = np.empty_like(light), clips_at(light, picture.peak)
        take_stops(light, stops, white)
        return cls(light, stops, white)

    @property
    def shows_nothing(self) -> bool:
        """Whether it is black."""
        return float((self.light.max(axis=2) > _FAINTEST).mean()) < _LEAST_SHARE_OF_DARK

    def change_since(self, before: SmallPicture) -> Float64 | None:
        """Change of the light (3,) from an earlier picture [stops], None where it is unknown.

        The median over all places that both show; where the camera moves, of the earlier picture
        registered to this one.
        """
        change = np.empty(3)
        if take_change(before.stops, self.stops, LEAST_SHARE, _LARGEST_SPREAD_STOPS, change):
            return change
        if np.isfinite(before.stops[..., 0] + self.stops[..., 0]).mean() < LEAST_SHARE:
            palest = _PALEST * min(before.white, self.white)
            by_channels = _change_of_channels(before.light, self.light, palest)
            if by_channels is not None:
                return by_channels
        moved = _registered(before.stops, self.stops)
        if moved is None:
            return None
        told = take_change(moved, self.stops, LEAST_SHARE, _LARGEST_SPREAD_STOPS, change)
        return change if told else None

    def change_of_mean(self, before: SmallPicture, axis: tuple[int, ...] | None = None) -> Float64:
        """Change of the mean light (3,) since another picture, whatever they show [stops].

        Args:
            before: the other picture.
            axis: (0, 1) for that of each channel, None for that of all channels together.
        """
        means = [one.light.mean(axis, dtype=np.float64) for one in (before, self)]
        then, now = (np.log2(np.maximum(mean, _LEAST_LIGHT)) for mean in means)
        return np.asarray(np.broadcast_to(now - then, 3))


def _change_of_channels(before: Float32, now: Float32, palest: float) -> Float64 | None:
    """Change (3,) between pictures that are dark, of one colour or lit in part [stops].

    A channel that shows too little changes as the others do in the mean. None where none shows
    enough, or where one changes unevenly.
    """
    known = (np.minimum(before, now) > _FAINTEST) & (np.maximum(before, now) < palest)
    change = np.full(3, np.nan)
    for channel in np.flatnonzero(known.mean((0, 1)) >= _LEAST_SHARE_OF_DARK):
        there = known[..., channel]
        ratios = np.log2(now[there, channel] / before[there, channel], dtype=np.float64)
        change[channel] = np.median(ratios)
        if np.median(np.abs(ratios - change[channel])) >= _LARGEST_SPREAD_STOPS:
            return None
    told = change[np.isfinite(change)]
    return np.where(np.isfinite(change), change, told.mean()) if told.size else None


def _registered(before: Float32, now: Float32) -> Float32 | None:
    """The earlier small picture registered to the later one; NaN beyond it."""
    if min(np.isfinite(part).mean() for part in (before, now)) < LEAST_SHARE:
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


def take_stops(light: Float32, stops: Float32, white: float = 1.0) -> None:
    """Fill in logarithmic light (h, w, 3), NaN where a channel is too dark or too bright.

    Args:
        light: of a picture.
        stops: the result.
        white: light at which it clips, infinite where it does not.
    """
    kernels.take_stops(light, (DARKEST, min(BRIGHTEST * white, _LARGEST)), stops)


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
