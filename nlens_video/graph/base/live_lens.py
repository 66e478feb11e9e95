"""The lens of a live stream, which follows fits as they are found.

A change is detected only after it occurred (`stages.r_lens_change`); the lens then moves towards
the newest fit by a fixed share per frame.
"""

from __future__ import annotations

import math
from collections import deque

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.stages.r_lens_change import (
    AT_REST,
    CHANGED,
    SETTLED_CHANGE,
    SETTLED_S,
    Signature,
    changed,
    differs,
    is_cut,
    signature,
    stands_still,
)

EVERY = 3
"""Frames from one change detection to the next."""
_SPACING_S = 0.1  # least time between two fits [s]
_SMOOTHING_S = 0.12  # time constant of the smoothing [s]
_AHEAD_S = 0.1  # by which it aims ahead while the lens moves, most of what the smoothing lags [s]
_GOES_ON_S = 0.2  # without a new fit after which a change may be over [s]
_LONGER = 1.25  # the same, by the time between the last two fits [1]
_SHOWS = 1.5  # change that would show by now if the lens moved on, by `AT_REST` [1]
_SETTLES = 4  # times `SETTLED_S` for which the end of a change is looked for [1]
_STANDS = 0.25  # progress of the blur, by that of the lens so far, below which it stands [1]
_NOISE = 2.0  # times the largest change at rest that calls for a fit, where it is known [1]
_FEWEST, _MOST = 4, 10  # looks that tell it [1]
_LATEST = 2  # looks that do not, since a change may have begun [1]
_MOST_STEPS = 1000  # frames after which a lens has arrived, however many were left out [1]


class _Moving(Struct, frozen=True):
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

    def frames_of(self, change: float) -> float:
        """Frames after the last fit that show a change of the blur since, if it goes on [1]."""
        return change * self.frames / max(self.change, 1e-6) if self.frames else 0.0

    def fitted(self, change: float, since: int) -> _Moving:
        """Of another fit, on a frame whose blur differs from that of the last."""
        return _Moving(change - self.change_at_rest, since - self.rested, change)

    @property
    def share_in_a_frame(self) -> float:
        """Of the change from fit to fit, what a frame brought [1]."""
        return self.change / self.of / self.frames if self.frames else 0.0


class _Call(Struct, frozen=True, eq=False):
    """A look that called for a fit.

    Attributes:
        index: of the frame.
        change: of its blur since the last fit that moved the lens.
        ends: whether the end of a change was looked for.
        seen: its blur.
    """

    index: int = 0
    change: float = 0.0
    ends: bool = False
    seen: Signature | None = None


class LiveLens:
    """Exponential smoothing of the fits on a live stream; jumps at cuts only.

    Between two fits of a lens that changes the change of the last two goes on, for as long as it
    took and as far as the blur shows it, and a little ahead, so that the lens lags behind neither
    by that time nor by its smoothing. For a while after a change smaller ones call for a fit, so
    that its end is followed, and so they do where the blur at rest shows little noise. Frames
    that are left out, as those that come too late, count as time.

    Args:
        frame_s: from one frame to the next, > 0 [s].

    Attributes:
        spacing: least number of frames between two fits.
        fits: how many fits have moved the lens.
    """

    def __init__(self, frame_s: float) -> None:
        self._share = 1.0 - math.exp(-frame_s / _SMOOTHING_S)
        self.spacing = max(EVERY, round(_SPACING_S / frame_s))
        self._goes_on = max(EVERY, round(_GOES_ON_S / frame_s))
        self._ahead = _AHEAD_S / frame_s
        self._reference: Signature | None = None
        self._before: Signature | None = None
        self._looked = self._stepped = 0  # indices of the last frames that were
        self._cut = False
        self._still = True
        self._target: LensFit | None = None
        self._now: LensFit | None = None
        self._age = 0  # frames since the last fit
        self._rate = (0.0, 0.0)  # change of slope and intercept in a frame
        self._moving = _Moving()
        self._settled = max(2, round(SETTLED_S / frame_s))
        self._call = _Call()  # the last one
        self._asked = 0.0  # its change, where its fit did not move the lens
        self._at_rest: deque[float] = deque(maxlen=_MOST + _LATEST)  # changes that called for none
        self._fitted = 0  # index of the frame whose fit has moved the lens last
        self._moved = -math.inf  # and of the last one that was no end of a change
        self._follows = False  # whether that was lately
        self._shown = 0.0  # frames of the last change that the blur has gone on since, as it shows
        self._stands = False  # whether it no longer does
        self.fits = 0

    def begin(self, fit: LensFit, index: int, picture: Picture) -> None:
        """Start with the lens that was found on a frame; `picture` is its plate, unchanged."""
        self._before = signature(picture)
        self._looked = self._stepped = index
        self._call = _Call(index, seen=self._before)
        self.found(fit)

    def needs_refit(self, index: int, picture: Picture) -> bool:
        """Whether the lens must be fitted again on a frame; `picture` is its plate, unchanged."""
        if index < self._looked:  # a host went back in the shot: frames count on from here
            self._looked = self._stepped = self._fitted = index
            self._call, self._moved = replace(self._call, index=index), -math.inf
        if index - self._looked < EVERY:
            return False
        assert self._reference is not None and self._before is not None, "it has not begun"
        seen = signature(picture)
        before, self._before = self._before, seen
        self._cut = self._cut or is_cut(before, seen)
        if self._cut:
            self._call, self._looked = _Call(index), index
        elif not self.calls_for_fit(changed(self._reference, seen), index):
            if self._asked and index - self._call.index > _SETTLES * self._settled:
                self._moving = _Moving()  # the fit told that the lens rests
                self._rest_on(index, seen)
            return False
        self._still = stands_still(self._reference, seen)
        self._call = replace(self._call, seen=seen)
        return True

    def calls_for_fit(self, change: float, index: int) -> bool:
        """Whether the lens is fitted again on a frame; if not, whether it rests is noted.

        Args:
            change: of the blur since the last fit that moved the lens, as `changed`.
            index: of the frame.
        """
        since, looked = index - self._fitted, index - self._looked
        self._looked = index
        if since > _SETTLES * self._settled:
            self._follows = False
        if min(since, index - self._call.index) < self.spacing:
            return False
        comes_to_rest = since >= self._settled and index - self._moved <= _SETTLES * self._settled
        least = SETTLED_CHANGE if comes_to_rest else self._least()
        if change > max(least, self._asked + SETTLED_CHANGE if self._asked else 0.0):
            self._call, self._asked = _Call(index, change, comes_to_rest), change
            return True
        self._at_rest.append(change)
        shown = self._moving.frames_of(change)
        self._stands = since > self.spacing and shown - self._shown < _STANDS * looked
        self._shown = shown
        if change < AT_REST and self._moving.expected(since) >= _SHOWS * AT_REST:
            self._rate = (0.0, 0.0)
            self._moving = _Moving(rested=since, change_at_rest=change)
        return False

    def found(self, fit: LensFit) -> None:
        """Smooth towards this fit from now on; jump to it if it is the first or after a cut.

        Within a shot, a fit that does not differ from the last by more than its error is left out,
        unless the lens is known to move; the change since the last that was not goes on counting.
        """
        within, call = self._target is not None and not self._cut, self._call
        if within and not self._follows and not self._differs(fit):
            return
        if within:
            self._moving = self._moving.fitted(call.change, call.index - self._fitted)
            self._moved = self._moved if call.ends else call.index
        else:
            self._moving = _Moving()
        self._rate = self._change_to(fit)
        self._target, self._age, self._follows = fit, 0, within
        self._rest_on(call.index, call.seen)
        self.fits += 1
        if self._now is None or self._cut:
            self._now = fit
        self._cut = False

    def step(self, index: int) -> LensFit | None:
        """The lens of a frame; None before the first fit."""
        for _ in range(min(index - self._stepped, _MOST_STEPS)):
            self._advance()
        self._stepped = index
        return self._now

    def _advance(self) -> None:
        now, target = self._now, self._target
        if now is None or target is None or now is target:
            return
        goes_on = self._frames_further()
        self._age += 1
        slope = target.slope + goes_on * self._rate[0]
        intercept = target.intercept + goes_on * self._rate[1]
        slope = now.slope + self._share * (max(slope, 0.0) - now.slope)
        intercept = now.intercept + self._share * (intercept - now.intercept)
        self._now = replace(target, slope=slope, intercept=intercept)

    def _frames_further(self) -> float:
        """For how many frames the last change has gone on since the fit."""
        frames = self._moving.frames
        if self._age > max(self._goes_on, _LONGER * frames):  # no new fit for long: it rests
            return min(self._shown, frames)
        # what the last look did not show yet: the frames until the next, and those it aims ahead
        unseen = 0.0 if self._stands else EVERY + self._ahead
        return min(self._age + self._ahead, frames, self._shown + unseen)

    def _least(self) -> float:
        """Change that calls for a fit: smaller than `CHANGED` where there is little noise."""
        known = list(self._at_rest)[:-_LATEST]
        if len(known) < _FEWEST:
            return CHANGED
        return min(max(_NOISE * max(known), SETTLED_CHANGE), CHANGED)

    def _rest_on(self, index: int, seen: Signature | None) -> None:
        """Measure changes of the blur from a frame on."""
        self._fitted, self._reference = index, seen
        self._asked, self._shown, self._stands = 0.0, 0.0, False
        self._at_rest.clear()

    def _differs(self, fit: LensFit) -> bool:
        return self._target is None or differs(self._target, fit, still=self._still)

    def _change_to(self, fit: LensFit) -> tuple[float, float]:
        """Change of slope and intercept in a frame, as between this fit and the last."""
        before, share = self._target, self._moving.share_in_a_frame
        if before is None or self._cut:
            return 0.0, 0.0
        return share * (fit.slope - before.slope), share * (fit.intercept - before.intercept)

    def describe(self) -> str:
        """A note for the user."""
        return f"the lens changes: followed by {self.fits} fits as they were found"
