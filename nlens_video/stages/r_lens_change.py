"""R over time: detects changes of the lens, tells them from the errors of two fits, follows them.

Estimating the CoC takes a tenth of a second, the change detector a few milliseconds. It compares
the plate's blur with that at the last fit: patches on a grid are split in octaves of detail. Blur
removes detail octave by octave, whatever the light and the contrast, so the ratio of neighbouring
octaves is compared: by rows of patches, since the depth of a ground, and so its blur, goes by rows;
and by medians, so that moving things do not count.

On a live stream a change is detected only after it occurred; the lens then moves towards the newest
fit by a fixed share per frame (`LiveLens`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from nlens_video.core.layers import Float32, Float64, Picture
from nlens_video.core.lens_fit import IN_FOCUS_PX, LensFit

CHANGED = 0.1
"""Change of the log-ratio of two octaves that calls for another fit: a focus that moves by 7 %
gives as much, or an aperture that opens by a fifth; noise and a panning camera seldom do."""

_SETTLED_CHANGE = 0.4 * CHANGED  # calls for another fit as well, long after the last one
_SETTLED_S = 0.5

SPACING_S = 0.12
"""Least time between two fits of one shot of a file [s]."""

AT_REST = 0.5 * CHANGED
"""A smaller change than this means that the lens has come to rest."""

CUT = 0.12  # mean change of the patches' brightness from one frame to the next [1]
_STILL = 0.03  # median change of it while the camera stands still [1]
_TOLD_STILL, _TOLD_MOVING = 2.0, 4.0
"""Standard errors by which the CoC must change. What the ground's texture does to a fit is the same
on all frames of a still camera, and not where the camera moves."""

_ROWS, _COLUMNS = 6, 8
_PATCH_SHARE = 1 / 16  # of the frame's width
_SMALLEST_PX, _LARGEST_PX = 24, 64
_BLURS_PX = (0.8, 1.6, 3.2, 6.4)  # between which the octaves lie
EVERY = 3  # frames from one change detection of a live stream to the next
_LIVE_SPACING_S = 0.1  # least time between two fits of a live stream
_GOES_ON_S = 0.2  # without a new fit after which a change may be over
_SMOOTHING_S = 0.14  # time constant of its smoothing
_AHEAD_S = 0.1  # by which it aims ahead while the lens moves, most of what the smoothing lags
_SHOWS = 1.5  # change that would show by now if the lens moved on, by `AT_REST` [1]
_SETTLES = 4  # times `_SETTLED_S` for which the end of a change is looked for [1]
_LONGER = 1.25  # the same, by the time between the last two fits [1]
_FLOOR = 1.5e-3  # detail of less than this is noise (root of scene-linear light) [1]


@dataclass(frozen=True, slots=True)
class Signature:
    """Blur and light of a frame on a grid of patches.

    Attributes:
        ratios: log-ratios of neighbouring octaves (rows, columns, octaves - 1), nan where a patch
            has no detail.
        light: mean of each patch (rows, columns), root of scene-linear light [1].
    """

    ratios: Float64
    light: Float64


def signature(picture: Picture) -> Signature:
    """Signature of a frame."""
    side = int(min(max(_PATCH_SHARE * picture.width, _SMALLEST_PX), _LARGEST_PX))
    side = min(side, picture.width, picture.height)
    corners = [
        ((picture.width - side) * (2 * column + 1) // (2 * _COLUMNS),
         (picture.height - side) * (2 * row + 1) // (2 * _ROWS))
        for row in range(_ROWS) for column in range(_COLUMNS)
    ]  # fmt: skip
    root = np.sqrt(np.maximum(picture.patches(corners, side)[..., 1], 0.0))
    grid = (_ROWS, _COLUMNS)
    return Signature(_octaves(root).reshape(*grid, -1), root.mean(axis=(1, 2)).reshape(grid))


def _octaves(patches: Float32) -> Float64:
    """Log-ratios of adjacent octaves (N, octaves - 1) of patches (N, side, side), nan in noise."""
    detail = octave_detail(patches)
    ratios = np.diff(np.log(np.maximum(detail, _FLOOR)).astype(np.float64), axis=1)
    ratios[detail[:, 1:] <= _FLOOR] = np.nan
    return np.asarray(ratios)


def octave_detail(patches: Float32) -> Float32:
    """Standard deviation (N, octaves) of the detail between two blurs of patches (N, side, side).

    A patch that is mirrored at its borders is a sum of cosines, and a Gaussian blur scales each of
    them by itself: the squares of their amplitudes give what blurring the patch would.
    """
    cosines, weights = _cosines(patches.shape[1])
    power = cosines @ patches @ cosines.T
    power *= power
    return np.asarray(np.sqrt(power.reshape(len(patches), -1) @ weights))


@cache
def _cosines(side: int) -> tuple[Float32, Float32]:
    """The cosine transform (side, side), and what each square adds to a variance (side², octaves).

    The variance is of the difference of two blurs, whose constant part is 0.
    """
    number = np.arange(side)
    cosines = np.cos(math.pi / side * (number + 0.5) * number[:, None]) * math.sqrt(2.0 / side)
    cosines[0] *= math.sqrt(0.5)
    sigma = np.array(_BLURS_PX)[:, None]
    passed = np.exp(-0.5 * (math.pi / side * number * sigma) ** 2)
    blurs = passed[:, :, None] * passed[:, None, :]
    weights = ((blurs[:-1] - blurs[1:]) / side) ** 2
    return cosines.astype(np.float32), weights.reshape(len(weights), -1).T.astype(np.float32)


def changed(reference: Signature, now: Signature) -> float:
    """Change of the blur: the second largest of the rows' median changes, in log-ratios [1].

    A change of the lens shows at most depths.
    """
    with np.errstate(all="ignore"):
        difference = now.ratios - reference.ratios
    rows = sorted(
        abs(float(np.median(seen)))
        for octave in difference.swapaxes(1, 2).reshape(-1, _COLUMNS)
        if len(seen := octave[np.isfinite(octave)]) >= _COLUMNS // 2
    )
    return rows[-2] if len(rows) >= 2 else 0.0


def calls_for_fit(reference: Signature, now: Signature, since: int, frame_s: float) -> bool:
    """Whether a file's lens is fitted again.

    Args:
        reference: of the frame of the last fit.
        now: of a later frame of the shot.
        since: frames between them [1].
        frame_s: from one frame to the next, > 0 [s].
    """
    change = changed(reference, now)
    if since >= max(2, round(_SETTLED_S / frame_s)):
        return change > _SETTLED_CHANGE
    return since >= max(1, round(SPACING_S / frame_s)) and change > CHANGED


def is_cut(before: Signature, now: Signature) -> bool:
    """Whether another shot begins between two neighbouring frames."""
    return float(np.abs(now.light - before.light).mean()) > CUT


def stands_still(before: Signature, now: Signature) -> bool:
    """Whether most of the view is the same."""
    return float(np.median(np.abs(now.light - before.light))) < _STILL


def differs(before: LensFit, now: LensFit, *, still: bool) -> bool:
    """Whether the lens has changed by more than the errors of two fits, on the ground in view.

    Where the sign of either is ambiguous, unsigned diameters are compared.

    Args:
        before: of an earlier frame.
        now: of a later one, of a frame of the same size.
        still: whether the camera stands still between them.
    """
    seen = [disparity for disparity, _ in before.ground_seen] or [0.0]
    there = np.array([seen[0], seen[len(seen) // 2], seen[-1]], np.float32)
    was, is_now = before.coc_px(there), now.coc_px(there)
    if "ambiguous" in (before.sign, now.sign):
        was, is_now = np.abs(was), np.abs(is_now)
    change = np.abs(is_now - was)
    errors = [fit.readings_share * fit.coc_stderr_px(there) for fit in (now, before)]
    error = np.hypot(*errors)
    told = change > (_TOLD_STILL if still else _TOLD_MOVING) * error
    return bool(np.any(told & (change > IN_FOCUS_PX)))


@dataclass(frozen=True, slots=True)
class _Moving:
    """How the blur changed before the last fit of a live stream; not at all by default.

    Attributes:
        change: since it rested last, or since the fit before if it did not rest in between.
        frames: in which it changed so [1].
        of: change since the fit before, rest included.
        rested: frames from the last fit to where it rested last [1].
        change_at_rest: from the last fit to there.
    """

    change: float = 0.0
    frames: int = 0
    of: float = 1.0
    rested: int = 0
    change_at_rest: float = 0.0

    def expected(self, since: int) -> float:
        """Change of the blur some frames after the last fit, if it goes on; inf at rest."""
        return self.change / self.frames * since if self.frames else math.inf

    def fitted(self, change: float, since: int) -> _Moving:
        """Of another fit, on a frame whose blur differs from that of the last."""
        return _Moving(change - self.change_at_rest, since - self.rested, change)

    @property
    def share_in_a_frame(self) -> float:
        """Of the change from fit to fit, what a frame brought [1]."""
        return self.change / self.of / self.frames if self.frames else 0.0


class LiveLens:
    """Exponential smoothing of the fits on a live stream; jumps at cuts only.

    Between two fits of a lens that changes the change of the last two goes on, for as long as it
    took, and a little ahead, so that the lens lags behind neither by that time nor by its
    smoothing. For a while after a change smaller ones call for a fit, so that its end is followed.

    Args:
        frame_s: from one frame to the next, > 0 [s].

    Attributes:
        spacing: least number of frames between two fits.
        fits: how many fits have moved the lens.
    """

    def __init__(self, frame_s: float) -> None:
        self._share = 1.0 - math.exp(-frame_s / _SMOOTHING_S)
        self.spacing = max(EVERY, round(_LIVE_SPACING_S / frame_s))
        self._goes_on = max(EVERY, round(_GOES_ON_S / frame_s))
        self._ahead = _AHEAD_S / frame_s
        self._reference: Signature | None = None
        self._before: Signature | None = None
        self._cut = False
        self._still = True
        self._target: LensFit | None = None
        self._now: LensFit | None = None
        self._age = 0  # frames since the last fit
        self._rate = (0.0, 0.0)  # change of slope and intercept in a frame
        self._moving = _Moving()
        self._settled = max(2, round(_SETTLED_S / frame_s))
        self._fitted = 0  # index of the frame that called for the last fit
        self._moved = -math.inf  # and of the last one whose change was more than `CHANGED`
        self.fits = 0

    def needs_refit(self, index: int, picture: Picture) -> bool:
        """Whether the lens must be fitted again on a frame; `picture` is its plate, unchanged."""
        if self._reference is not None and index % EVERY:
            return False
        seen = signature(picture)
        before, self._before = self._before, seen
        if self._reference is None or before is None:
            self._reference, self._fitted = seen, index
            return False
        self._cut = self._cut or is_cut(before, seen)
        if self._cut:
            self._fitted, self._moving = index, _Moving()
        elif not self.calls_for_fit(changed(self._reference, seen), index):
            return False
        self._still = stands_still(self._reference, seen)
        self._reference = seen
        return True

    def calls_for_fit(self, change: float, index: int) -> bool:
        """Whether the lens is fitted again on a frame; if not, whether it rests is noted.

        Args:
            change: of the blur since the frame of the last fit, as `changed`.
            index: of the frame.
        """
        since = index - self._fitted
        if since < self.spacing:
            return False
        comes_to_rest = since >= self._settled and index - self._moved <= _SETTLES * self._settled
        if change > (_SETTLED_CHANGE if comes_to_rest else CHANGED):
            self._moving, self._fitted = self._moving.fitted(change, since), index
            self._moved = self._moved if comes_to_rest else index
            return True
        if change < AT_REST and self._moving.expected(since) >= _SHOWS * AT_REST:
            self._rate = (0.0, 0.0)
            self._moving = _Moving(rested=since, change_at_rest=change)
        return False

    def found(self, fit: LensFit) -> None:
        """Smooth towards this fit from now on; jump to it if it is the first or after a cut.

        Within a shot, a fit that does not differ from the last by more than its error is left out.
        """
        if self._target is not None and not self._cut:
            if not differs(self._target, fit, still=self._still):
                return
        self._rate = self._change_to(fit)
        self._target, self._age = fit, 0
        self.fits += 1
        if self._now is None or self._cut:
            self._now = fit
        self._cut = False

    def step(self) -> LensFit | None:
        """The lens of the next frame; None before the first fit."""
        now, target = self._now, self._target
        if now is None or target is None or now is target:
            return now
        frames = self._moving.frames
        rests = self._age > max(self._goes_on, _LONGER * frames)  # no new fit for long
        goes_on = 0.0 if rests else min(self._age + self._ahead, frames)
        self._age += 1
        slope = target.slope + goes_on * self._rate[0]
        intercept = target.intercept + goes_on * self._rate[1]
        slope = now.slope + self._share * (max(slope, 0.0) - now.slope)
        intercept = now.intercept + self._share * (intercept - now.intercept)
        self._now = replace(target, slope=slope, intercept=intercept)
        return self._now

    def _change_to(self, fit: LensFit) -> tuple[float, float]:
        """Change of slope and intercept in a frame, as between this fit and the last."""
        before, share = self._target, self._moving.share_in_a_frame
        if before is None or self._cut:
            return 0.0, 0.0
        return share * (fit.slope - before.slope), share * (fit.intercept - before.intercept)

    def describe(self) -> str:
        """A note for the user."""
        return f"the lens changes: followed by {self.fits} fits as they were found"
