"""Background model of a shot: what each pixel shows where nothing moves.

Pixels are compared by the square root of their light (`roots`), in which noise is about as strong
in dark pixels as in bright ones. Frames are brought to the exposure of the first one by the median
ratio of their light, which holds as long as less than half of the picture moves. Frames may be
warped into a reference view that is larger than they are; what a frame does not show of it is NaN.

The model is kept at low resolution for the whole view (`BackgroundModel`), and at full resolution
around the object (`CleanPlate`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.detection import MIN_BLOB_AREA
from nlens_video.effects.foreground.frame_sampler import (
    MIN_CHANGE,
    MIN_FRAMES,
    FrameSampler,
    channel_max,
)

LOWRES_WIDTH = 384
"""Largest width of the low resolution, at which motion is detected [px]."""
_MIN_GAIN_ROOT, _MAX_GAIN_ROOT = 0.1, 0.97  # range of roots from which the gain is measured [1]
_GAIN_STRIDE = 29  # every so many pixels are compared for the gain
_MIN_MOTION_WIDTH_PX = 5  # width of a moving target; edges that sway are narrower [lowres px]
_STATIONARY_COVER = 0.625
"""Fraction of all pixels of a changing area that change on one frame, if it stays in place [1]."""
_STATIONARY_FRAMES = 3  # frames on which such an area changes by half that fraction
_MIN_PATH_AREA = 1.6  # area that a moving target sweeps over the shot, by `MIN_BLOB_AREA` [1]
_MAX_STATIC_NOISE = 8.0 / 255.0  # noise of a pixel above which the camera seems to move [1]
_MAX_NOISY, _MAX_CHANGED = 0.25, 0.75  # fractions of the pixels, in a shot of a static camera [1]
_PASSED_BY = 0.7  # fraction of the frames that show the background where something passes [1]
_MIN_PASSED = 0.9  # least share of such pixels among the changing ones, if nearly all change [1]
_MAX_AT_ONCE = 0.5  # and largest share of the pixels that change on one frame [1]


def lowres_size(width: int, height: int) -> tuple[int, int]:
    """Columns and rows of a frame at low resolution [px]."""
    scale = min(1.0, LOWRES_WIDTH / width)
    return max(1, round(width * scale)), max(1, round(height * scale))


def sqrt_light(light: Float32) -> Float32:
    """Square root of light, 0 for negative light."""
    made = np.maximum(light, np.float32(0.0))
    return np.asarray(np.sqrt(made, out=made), np.float32)


def exposure_gain(roots: Float32, background: Float32) -> Float32:
    """Ratio of the roots of light (3,) of a frame (h, w, 3) to those of the background."""
    now, then = (
        np.ascontiguousarray(one.reshape(-1, 3)[::_GAIN_STRIDE].T) for one in (roots, background)
    )
    each = (then > _MIN_GAIN_ROOT) & (then < _MAX_GAIN_ROOT) & (now < _MAX_GAIN_ROOT)
    known = each[0] & each[1] & each[2]
    if np.count_nonzero(known) < 0.02 * known.size:
        return np.ones(3, np.float32)
    return np.asarray(np.median(now[:, known] / then[:, known], axis=1), np.float32)


def _in_exposure_of(roots: Float32, background: Float32) -> Float32:
    """The roots of light of a frame (h, w, 3), divided by its `exposure_gain`."""
    # a row at a time: NumPy is slow along an axis of three
    gains = np.tile(exposure_gain(roots, background), roots.shape[1])
    return np.asarray((roots.reshape(len(roots), -1) / gains).reshape(roots.shape), np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class CleanPlate:
    """Background of a region at full resolution, in the exposure of the first frame.

    Attributes:
        box: the region.
        roots: square root of its scene-linear light (h, w, 3).
        noise: standard deviation of a frame's roots of light (h, w) [1].
    """

    box: Box
    roots: Float32
    noise: Float32


@dataclass(slots=True)
class BackgroundSurvey:
    """First pass over a shot: estimates the background at low resolution, and where anything moves.

    Attributes:
        size: columns and rows of the frame or of its reference view, at full resolution [px].
        frames: how many were added [1].
    """

    size: tuple[int, int]
    _sampler: FrameSampler = field(default_factory=FrameSampler)
    frames: int = 0
    _first: Float32 | None = None
    _minimum: Float32 | None = None
    _maximum: Float32 | None = None

    def add(self, roots: Float32) -> None:
        """Add the roots of light (h, w, 3) of the shot's next frame, at low resolution."""
        if self._first is None or self._minimum is None or self._maximum is None:
            self._first, self._minimum, self._maximum = roots.copy(), roots.copy(), roots.copy()
        else:
            roots = _in_exposure_of(roots, self._first)
            np.fmin(self._minimum, roots, out=self._minimum)
            np.fmax(self._maximum, roots, out=self._maximum)
            unknown = np.isnan(self._first[..., 0])
            if unknown.any():
                self._first[unknown] = roots[unknown]
        self._sampler.add(roots)
        self.frames += 1

    def has_change(self, box: Box) -> bool:
        """Whether an area as wide as a moving target changes in a box of the frame."""
        if self._minimum is None or self._maximum is None:
            return False
        changed = _remove_narrow(channel_max(self._maximum - self._minimum) > MIN_CHANGE)
        height, width = changed.shape
        lowres = _lowres_box(box, self.size, (width, height))
        return bool(changed[lowres.slices_in(Box(0, 0, width, height))].any())

    def model(self) -> BackgroundModel | None:
        """The background model, None from too few frames."""
        if self._minimum is None or self._maximum is None or self.frames < MIN_FRAMES:
            return None
        roots, noise = self._sampler.median()
        change = channel_max(np.maximum(self._maximum - roots, roots - self._minimum))
        seen = self._sampler.valid_counts >= MIN_FRAMES
        if not seen.any():
            return None
        limit = max(MIN_CHANGE, 8.0 * float(np.median(noise[seen])))
        return BackgroundModel(
            size=self.size, roots=roots, noise=noise, changed=change > limit,
            travelled=self._travelled(roots, _remove_narrow(change > limit), limit),
            agreement=self._sampler.agreement(roots, noise), seen=seen,
        )  # fmt: skip

    def is_static(self, model: BackgroundModel) -> bool:
        """Whether the camera, and most of the picture at a time, does not move.

        Args:
            model: of this survey.
        """
        if float((model.noise > _MAX_STATIC_NOISE)[model.seen].mean()) >= _MAX_NOISY:
            return False
        changed = _opening(model.changed, 2) & model.seen
        if changed.sum() < _MAX_CHANGED * model.seen.sum():
            return True
        if float((model.agreement[changed] >= _PASSED_BY).mean()) < _MIN_PASSED:
            return False
        limit = np.maximum(np.float32(MIN_CHANGE), 4.0 * model.noise)
        deviations = self._sampler.deviations(model.roots)
        return max(float((one >= limit)[model.seen].mean()) for one in deviations) < _MAX_AT_ONCE

    def _travelled(self, roots: Float32, changed: Bool, limit: float) -> Bool:
        """Where (h, w) the changes are those of a target that travels.

        What stirs in place, like a lamp that flickers, covers most of its connected changed area on
        a single frame, and does so on several frames. A fast target is at each place only once. A
        small changed area is the edge of something that sways: the smallest target sweeps more.
        """
        count, labels = cv2.connectedComponents(changed.astype(np.uint8))
        areas = np.bincount(labels.ravel(), minlength=count)
        covers = [
            np.bincount(labels[deviation > limit], minlength=count) / np.maximum(areas, 1)
            for deviation in self._sampler.deviations(roots)
        ]
        frequent = (np.array(covers) > 0.5 * _STATIONARY_COVER).sum(axis=0) >= _STATIONARY_FRAMES
        stationary = frequent & (np.max(covers, axis=0) > _STATIONARY_COVER)
        stationary |= areas < _MIN_PATH_AREA * MIN_BLOB_AREA * labels.size
        stationary[0] = True
        return np.asarray(~stationary[labels])


@dataclass(frozen=True, slots=True, kw_only=True)
class BackgroundModel:
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

    def normalised(self, roots: Float32) -> Float32:
        """A frame (h, w, 3) in the background's exposure; unknown pixels show the background."""
        roots = _in_exposure_of(roots, self.roots)
        unknown = np.isnan(roots[..., 0]) | ~self.seen
        if unknown.any():
            roots[unknown] = self.roots[unknown]
        return roots

    def lowres_box(self, box: Box) -> Box:
        """The box at low resolution around a box at full resolution, inside the picture."""
        height, width = self.noise.shape
        return _lowres_box(box, self.size, (width, height))

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


def _lowres_box(box: Box, size: tuple[int, int], lowres: tuple[int, int]) -> Box:
    """The box at low resolution around a box at full resolution, inside the picture."""
    x, y = lowres[0] / size[0], lowres[1] / size[1]
    return Box(
        math.floor(box.x0 * x), math.floor(box.y0 * y),
        math.ceil(box.x1 * x), math.ceil(box.y1 * y),
    ).intersection(Box(0, 0, *lowres))  # fmt: skip


def _remove_narrow(changed: Bool) -> Bool:
    return _opening(changed, _MIN_MOTION_WIDTH_PX)


def _opening(mask: Bool, side: int) -> Bool:
    """Morphological opening by a square of a side [px]."""
    element = np.ones((side, side), np.uint8)
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, element) > 0
