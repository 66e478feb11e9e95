"""Surveys of a shot: its background, and where anything moves, by a first pass over it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.beginning import Beginning
from nlens_video.effects.foreground.background import (
    MAX_AT_ONCE,
    BackgroundModel,
    in_exposure_of,
    is_dark,
    is_flash,
    lowres_box,
)
from nlens_video.effects.foreground.detection import MIN_BLOB_AREA
from nlens_video.effects.foreground.frame_sampler import (
    MIN_CHANGE,
    MIN_FRAMES,
    FrameSampler,
)
from nlens_video.effects.foreground.reference_view import StaticView
from nlens_video.kernels.channels import channel_max
from nlens_video.video.info import SourceFrame

SURVEY_INTERVAL_S = 0.2
"""Least time from one frame of the survey to the next [s]."""
_MAX_FLASHES = 0.25  # fraction of the frames beyond which flashes are another light [1]
_MIN_MOTION_WIDTH_PX = 5  # width of a moving target; edges that sway are narrower [lowres px]
_STATIONARY_COVER = 0.625
"""Fraction of all pixels of a changing area that change on one frame, if it stays in place [1]."""
_STATIONARY_FRAMES = 3  # frames on which such an area changes by half that fraction
_MIN_PATH_AREA = 1.6  # area that a moving target sweeps over the shot, by `MIN_BLOB_AREA` [1]
_MAX_STATIC_NOISE = 8.0 / 255.0  # noise of a pixel above which the camera seems to move [1]
_MAX_NOISY, _MAX_CHANGED = 0.25, 0.75  # fractions of the pixels, in a shot of a static camera [1]
_PASSED_BY = 0.7  # fraction of the frames that show the background where something passes [1]
_MIN_PASSED = 0.9  # least share of such pixels among the changing ones, if nearly all change [1]


@dataclass(slots=True)
class BackgroundSurvey:
    """First pass over a shot: estimates the background at low resolution, and where anything moves.

    Attributes:
        size: columns and rows of the frame or of its reference view, at full resolution [px].
        frames: how many were added that may show the background [1].
    """

    size: tuple[int, int]
    _sampler: FrameSampler = field(default_factory=FrameSampler)
    frames: int = 0
    _flashes: int = 0
    _first: Float32 | None = None
    _minimum: Float32 | None = None
    _maximum: Float32 | None = None

    def add(self, roots: Float32) -> bool:
        """Add the shot's next frame, if it may show the background.

        Args:
            roots: square root of its light (h, w, 3), at low resolution.

        Returns:
            Whether it may.
        """
        if self._first is None or self._minimum is None or self._maximum is None:
            shows = bool((channel_max(roots) > MIN_CHANGE).any())
            if shows:
                self._begin(roots)
            return shows
        if is_dark(roots, self._first):
            return False
        if is_flash(roots, self._first):
            self._flashes += 1
            return False
        is_first_lit = self.frames == 1 and is_flash(self._first, roots)
        if is_first_lit or is_dark(self._first, roots):
            self._flashes += is_first_lit
            self._begin(roots)
            return True
        roots = in_exposure_of(roots, self._first)
        np.fmin(self._minimum, roots, out=self._minimum)
        np.fmax(self._maximum, roots, out=self._maximum)
        unknown = np.isnan(self._first[..., 0])
        if unknown.any():
            self._first[unknown] = roots[unknown]
        self._sampler.add(roots)
        self.frames += 1
        return True

    def _begin(self, roots: Float32) -> None:
        """Begin, perhaps anew, with a frame in whose exposure the others are compared."""
        self._first, self._minimum, self._maximum = roots.copy(), roots.copy(), roots.copy()
        self._sampler = FrameSampler()
        self._sampler.add(roots)
        self.frames = 1

    def has_change(self, box: Box) -> bool:
        """Whether an area as wide as a moving target changes in a box of the frame."""
        if self._minimum is None or self._maximum is None:
            return False
        changed = _remove_narrow(channel_max(self._maximum - self._minimum) > MIN_CHANGE)
        height, width = changed.shape
        lowres = lowres_box(box, self.size, (width, height))
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
        if self._flashes > _MAX_FLASHES * (self._flashes + self.frames):
            return False
        if float((model.noise > _MAX_STATIC_NOISE)[model.seen].mean()) >= _MAX_NOISY:
            return False
        changed = _opening(model.changed, 2) & model.seen
        if changed.sum() < _MAX_CHANGED * model.seen.sum():
            return True
        if float((model.agreement[changed] >= _PASSED_BY).mean()) < _MIN_PASSED:
            return False
        limit = np.maximum(np.float32(MIN_CHANGE), 4.0 * model.noise)
        deviations = self._sampler.deviations(model.roots)
        return max(float((one >= limit)[model.seen].mean()) for one in deviations) < MAX_AT_ONCE

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


class StaticCameraSurvey:
    """Background survey that is made while the frames of a shot are read, for a static camera.

    A beginning that is black, white or a fade is left out.

    Args:
        size: columns and rows of the frames [px].

    Attributes:
        reference: the reference view, which is the frame itself.
        survey: the background survey.
        times: times of all frames that were read [s].
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.reference = StaticView(size)
        self.survey = BackgroundSurvey(size)
        self.times: list[float] = []
        self._due = -math.inf
        self._beginning, self._began = Beginning(), False

    def see(self, frame: SourceFrame) -> None:
        """Read the next frame, and survey it if the interval since the last one has passed."""
        self.times.append(frame.time_s)
        self._began = self._began or self._beginning.ends(frame.picture)
        if self._began and frame.time_s >= self._due:
            self.survey.add(self.reference.downsampled(frame.picture))
            self._due = frame.time_s + SURVEY_INTERVAL_S


def _remove_narrow(changed: Bool) -> Bool:
    return _opening(changed, _MIN_MOTION_WIDTH_PX)


def _opening(mask: Bool, side: int) -> Bool:
    """Morphological opening by a square of a side [px]."""
    element = np.ones((side, side), np.uint8)
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, element) > 0
