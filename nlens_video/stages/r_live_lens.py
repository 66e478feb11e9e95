"""Exponential smoothing of the lens fit on a live stream.

A live stream has no second pass, so a change is detected only after it occurred. The lens then
moves towards the newest fit by a fixed share per frame, and jumps at cuts only.
"""

from __future__ import annotations

import math
from dataclasses import replace

from nlens_video.core.layers import Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.stages.r_change_detector import CHANGED, Signature, changed, is_cut, signature

EVERY = 3
"""Frames from one change detection to the next."""

_SPACING_S = 0.2  # least time between two fits
_SOFTNESS_S = 0.15  # after so much time two thirds of the way are done


class LiveLens:
    """Watches a stream's plate and moves its lens.

    Args:
        frame_s: from one frame to the next, > 0 [s].
    """

    def __init__(self, frame_s: float) -> None:
        self._share = 1.0 - math.exp(-frame_s / _SOFTNESS_S)
        self._spacing = max(EVERY, round(_SPACING_S / frame_s))
        self._reference: Signature | None = None
        self._before: Signature | None = None
        self._since = 0
        self._cut = False
        self._target: LensFit | None = None
        self._now: LensFit | None = None
        self.fits = 0

    def needs_refit(self, index: int, picture: Picture) -> bool:
        """Whether the lens must be found anew on a frame.

        Args:
            index: of the frame.
            picture: the plate, not composited yet; left as it is.
        """
        self._since += 1
        if self._reference is not None and index % EVERY:
            return False
        seen = signature(picture)
        before, self._before = self._before, seen
        if self._reference is None or before is None:
            self._reference = seen
            return False
        self._cut = self._cut or is_cut(before, seen)
        waited = self._since >= self._spacing
        if not self._cut and not (waited and changed(self._reference, seen) > CHANGED):
            return False
        self._reference, self._since = seen, 0
        return True

    def found(self, fit: LensFit) -> None:
        """Move towards this lens from now on; at once, if it is the first or after a cut."""
        self._target = fit
        self.fits += 1
        if self._now is None or self._cut:
            self._now = fit
        self._cut = False

    def step(self) -> LensFit | None:
        """The lens of the next frame; None before one was found."""
        now, target = self._now, self._target
        if now is None or target is None or now is target:
            return now
        values = {
            name: getattr(now, name) + self._share * (getattr(target, name) - getattr(now, name))
            for name in ("slope", "intercept")
        }
        self._now = replace(target, **values)
        return self._now

    def describe(self) -> str:
        """A note for the user."""
        return f"the lens changes: followed by {self.fits} fits as they were found"
