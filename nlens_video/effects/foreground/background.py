"""Background model of a shot: what each pixel shows where nothing moves.

Pixels are compared by the square root of their light (`roots`), in which noise is about as strong
in dark pixels as in bright ones. Frames are brought to the exposure of the first one by the median
ratio of their light, which holds as long as less than half of the picture moves. Frames may be
warped into a reference view that is larger than they are; what a frame does not show of it is NaN.
A frame that is nearly black, or lit by a flash, tells nothing: `tells_nothing`.

The model is kept at low resolution for the whole view (`BackgroundModel`), and at full resolution
around the object (`CleanPlate`).
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.frame_sampler import MIN_CHANGE
from nlens_video.kernels.channels import channel_max, divided_channels

LOWRES_WIDTH = 384
"""Largest width of the low resolution, at which motion is detected [px]."""
_MIN_GAIN_ROOT, _MAX_GAIN_ROOT = 0.1, 0.97  # range of roots from which the gain is measured [1]
_GAIN_STRIDE = 29  # every so many pixels are compared for the gain
_MIN_GAIN = 0.25
"""Gain of roots of light below which a frame is too dark, four stops below the background [1]."""
_NOISE_OF_BLACK = 7.0 / 255.0  # error of a root of light near black, by a code of 8 bits [1]
_FLASH_ROWS = 4  # every so many rows are looked at for a flash
_MIN_BRIGHTER = 0.8  # share of brighter pixels among those that a flash changes [1]
_MIN_UNEVEN = 0.33  # share of the pixels that a flash lights by another gain, or clips [1]
MAX_AT_ONCE = 0.5
"""Largest share of the pixels that what moves changes on one frame [1]."""


def lowres_size(width: int, height: int) -> tuple[int, int]:
    """Columns and rows of a frame at low resolution [px]."""
    scale = min(1.0, LOWRES_WIDTH / width)
    return max(1, round(width * scale)), max(1, round(height * scale))


def sqrt_light(light: Float32) -> Float32:
    """Square root of light, 0 for negative light."""
    made = np.maximum(light, np.float32(0.0))
    return np.asarray(np.sqrt(made, out=made), np.float32)


def exposure_gain(roots: Float32, background: Float32) -> Float32:
    """Ratio of the roots of light (3,) of a frame (h, w, 3) to those of the background.

    At least that of the darkest frame that tells anything, so that it can be divided by.
    """
    return np.maximum(_median_ratio(roots, background), np.float32(_MIN_GAIN))


def _median_ratio(roots: Float32, background: Float32) -> Float32:
    now, then = (
        np.ascontiguousarray(one.reshape(-1, 3)[::_GAIN_STRIDE].T) for one in (roots, background)
    )
    each = (then > _MIN_GAIN_ROOT) & (then < _MAX_GAIN_ROOT) & (now < _MAX_GAIN_ROOT)
    known = each[0] & each[1] & each[2]
    if np.count_nonzero(known) < 0.02 * known.size:
        return np.ones(3, np.float32)
    return np.asarray(np.median(now[:, known] / then[:, known], axis=1), np.float32)


def in_exposure_of(roots: Float32, background: Float32) -> Float32:
    """The roots of light of a frame (h, w, 3), divided by its `exposure_gain`."""
    return divided_channels(roots, exposure_gain(roots, background))


def tells_nothing(roots: Float32, background: Float32) -> bool:
    """Whether a frame (h, w, 3) is too dark to show what moves, or lit by a flash."""
    return is_dark(roots, background) or is_flash(roots, background)


def is_dark(roots: Float32, background: Float32) -> bool:
    """Whether a frame (h, w, 3) is black, or a fade of the background that noise hides."""
    gain = _median_ratio(roots, background)
    if gain.max() >= _MIN_GAIN:
        return False
    return _differing(roots, gain * background, _NOISE_OF_BLACK) <= MAX_AT_ONCE


def is_flash(roots: Float32, background: Float32) -> bool:
    """Whether most of a frame (h, w, 3) is brighter, and not by one gain: a flash lights it."""
    roots, background = roots[::_FLASH_ROWS], background[::_FLASH_ROWS]
    brighter = channel_max(roots - background) > np.float32(MIN_CHANGE)
    darker = channel_max(background - roots) > np.float32(MIN_CHANGE)
    changed = np.count_nonzero(brighter | darker)
    if (
        changed <= MAX_AT_ONCE * brighter.size
        or np.count_nonzero(brighter & ~darker) < _MIN_BRIGHTER * changed
    ):
        return False
    return _differing(in_exposure_of(roots, background), background, MIN_CHANGE) > _MIN_UNEVEN


def _differing(roots: Float32, background: Float32, limit: float) -> float:
    """Share of the pixels of a frame (h, w, 3) that differ by a limit from the background [1]."""
    return float((channel_max(np.abs(roots - background)) > np.float32(limit)).mean())


class CleanPlate(Struct, frozen=True, kw_only=True):
    """Background of a region at full resolution, in the exposure of the first frame.

    Attributes:
        box: the region.
        roots: square root of its scene-linear light (h, w, 3).
        noise: standard deviation of a frame's roots of light (h, w) [1].
    """

    box: Box
    roots: Float32
    noise: Float32


class BackgroundModel(Struct, frozen=True, kw_only=True):
    """Background of a whole shot at low resolution.

    Attributes:
        size: columns and rows of the frame or of its reference view, at full resolution [px].
        roots: square root of its scene-linear light (h, w, 3).
        noise: standard deviation of a frame's roots of light (h, w) [1].
        changed: where anything changes over the shot (h, w).
        travelled: where the changes are those of a target that travels (h, w).
        agreement: fraction of the frames that show the background (h, w) [1].
        seen: where enough frames show the pixel (h, w).
    """

    size: tuple[int, int]
    roots: Float32
    noise: Float32
    changed: Bool
    travelled: Bool
    agreement: Float32
    seen: Bool

    def normalised(self, roots: Float32, gain: Float32) -> Float32:
        """A frame (h, w, 3) in the background's exposure; unknown pixels show the background.

        Args:
            roots: square root of its light (h, w, 3).
            gain: its `exposure_gain` (3,).
        """
        roots = divided_channels(roots, gain)
        unknown = np.isnan(roots[..., 0]) | ~self.seen
        if unknown.any():
            roots[unknown] = self.roots[unknown]
        return roots

    def lowres_box(self, box: Box) -> Box:
        """The box at low resolution around a box at full resolution, inside the picture."""
        height, width = self.noise.shape
        return lowres_box(box, self.size, (width, height))

    def has_motion(self, box: Box) -> bool:
        """Whether a target travels through a box at full resolution."""
        lowres = self.lowres_box(box)
        if lowres.empty:
            return False
        return bool(self.travelled[lowres.slices_in(Box(0, 0, *self.noise.shape[::-1]))].any())

    def certainty(self, box: Box) -> float:
        """Fraction of a box at full resolution whose background most frames show [1]."""
        lowres = self.lowres_box(box)
        if lowres.empty:
            return 0.0
        part = self.agreement[lowres.slices_in(Box(0, 0, *self.noise.shape[::-1]))]
        return float((part >= 0.5).mean())


def lowres_box(box: Box, size: tuple[int, int], lowres: tuple[int, int]) -> Box:
    """The box at low resolution around a box at full resolution, inside the picture."""
    x, y = lowres[0] / size[0], lowres[1] / size[1]
    return Box(
        math.floor(box.x0 * x), math.floor(box.y0 * y),
        math.ceil(box.x1 * x), math.ceil(box.y1 * y),
    ).intersection(Box(0, 0, *lowres))  # fmt: skip
