"""R over time: smooths the fits of a lens that changes over a shot.

A file is fitted in a pass of its own (`FitTrack`). On a live stream a change is detected only after
it occurred; the lens then moves towards the newest fit by a fixed share per frame (`LiveLens`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Float64, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.stages.r_lens_change import (
    CHANGED,
    Signature,
    changed,
    differs,
    is_cut,
    signature,
    stands_still,
)

EVERY = 3  # frames from one change detection of a live stream to the next
_LEAST_ERROR = 1e-3  # of a fit [px]
_MOST_FRAMES = 1 << 40  # limit of frame numbers in a file
_SPACING_S = 0.2  # least time between two fits of a live stream
_SMOOTHING_S = 0.15  # time constant of its smoothing


@dataclass(frozen=True, slots=True)
class Keyframe:
    """The lens at one frame.

    Attributes:
        index: of the frame [1].
        shot: number of the shot; nothing is interpolated across a cut.
        fit: the lens.
    """

    index: int
    shot: int
    fit: LensFit


@dataclass(frozen=True, slots=True)
class FitTrack:
    """The lens at every frame of a file: local linear regression through the fits of a shot.

    Fits are weighted by a Gaussian window and their standard errors: no jumps, no lag.

    Attributes:
        keys: in order, at least one.
        stretch: standard deviation of the window, > 0 [frames].
        cuts: first frame of every shot but the first [1].
    """

    keys: tuple[Keyframe, ...]
    stretch: float
    cuts: tuple[int, ...] = ()

    def at(self, index: int) -> LensFit:
        """The lens at a frame."""
        shot = int(np.searchsorted(self.cuts, index, side="right"))
        nearest_key = min(self.keys, key=lambda key: abs(key.index - index))
        own = [key for key in self.keys if key.shot == shot] or [nearest_key]
        if len(own) == 1:
            return own[0].fit
        fits = [key.fit for key in own]
        away = np.array([key.index - index for key in own], np.float64)
        nearest = fits[int(np.argmin(np.abs(away)))]
        # the window is at least as wide as the nearest keys are far
        width = max(self.stretch, float(np.sort(np.abs(away))[1]) / 2.0)
        window = np.exp(-0.5 * np.square(away / width))

        def smoothed(name: str) -> float:
            values = np.array([getattr(fit, name) for fit in fits])
            weights = window / _variances([getattr(fit, f"{name}_stderr") for fit in fits])
            return _line_at_zero(away, values, weights)

        slope, intercept = max(smoothed("slope"), 0.0), smoothed("intercept")
        return replace(nearest, slope=slope, intercept=intercept, frame=index)

    def for_width(self, width: int, height: int) -> FitTrack:
        """The same lens on frames of another size."""
        keys = (replace(key, fit=key.fit.for_width(width, height)) for key in self.keys)
        return replace(self, keys=tuple(keys))

    def to_json(self) -> str:
        """A `fit.json` with the track; readers without tracks get the first frame's lens."""
        track = {"stretch": self.stretch, "cuts": self.cuts, "keys": [asdict(k) for k in self.keys]}
        return json.dumps({**json.loads(self.at(0).to_json()), "track": track}, indent=2) + "\n"

    @classmethod
    def load(cls, path: Path) -> FitTrack | None:
        """Read a `fit.json`; None where the file holds one lens only.

        Raises:
            LensFitError: the file cannot be read, or its track makes no sense.
        """
        LensFit.load(path)
        track = json.loads(path.read_text(encoding="utf-8")).get("track")
        if track is None:
            return None
        try:
            fits = [LensFit.from_json(json.dumps(key["fit"]), str(path)) for key in track["keys"]]
            keys = tuple(
                Keyframe(int(key["index"]), int(key["shot"]), fit)
                for key, fit in zip(track["keys"], fits, strict=True)
            )
            if not keys:
                raise ValueError("no keys")
            stretch, cuts = float(track["stretch"]), tuple(int(cut) for cut in track["cuts"])
            frames = (*(key.index for key in keys), *cuts)
            if not 1e-3 < stretch < _MOST_FRAMES or max(map(abs, frames)) > _MOST_FRAMES:
                raise ValueError(f"a stretch of {stretch:g} frames, or numbers beyond any film")
            if list(cuts) != sorted(cuts):
                raise ValueError("cuts that are not in order")
            return cls(keys, stretch, cuts)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise LensFitError(
                f"{path}: its track of a lens that changes makes no sense ({error}); fit again"
            ) from error

    def describe(self) -> str:
        """A note for the user."""
        own: dict[int, set[int]] = {}
        for key in self.keys:
            own.setdefault(key.shot, set()).add(key.fit.frame)
        found = sum(map(len, own.values()))
        if found == len(own):
            return f"the lens is fitted once in each of {found} shots"
        shots = f" over {len(self.cuts) + 1} shots" if self.cuts else ""
        first, last = self.keys[0].fit, self.keys[-1].fit
        ends = [_focus_depth(first), _focus_depth(last)]
        return (
            f"the lens changes: followed by {found} fits{shots}, in focus at {ends[0]} at first, "
            f"{ends[1]} at last"
        )


def _focus_depth(fit: LensFit) -> str:
    return f"depth {1.0 / fit.focus_disparity:.3g}" if fit.focus_disparity > 0.0 else "infinity"


def hold_segments(keys: Sequence[Keyframe], spacing: int, end: int) -> tuple[Keyframe, ...]:
    """Keys in order, repeated every `spacing` frames up to frame `end` where nothing changed."""
    held: list[Keyframe] = []
    for at, key in enumerate(keys):
        held.append(key)
        last = at + 1 == len(keys)
        if not last and keys[at + 1].shot != key.shot:
            continue
        until = end + spacing if last else keys[at + 1].index - spacing // 2
        held += [replace(key, index=index) for index in range(key.index + spacing, until, spacing)]
    return tuple(held)


def _variances(errors: Sequence[float]) -> Float64:
    squared = np.square(np.array(errors, np.float64))
    usual = float(np.median(squared))
    return np.asarray(np.maximum(squared, max(0.1 * usual, _LEAST_ERROR**2)))


def _line_at_zero(away: Float64, values: Float64, weights: Float64) -> float:
    """Value at 0 of the weighted line through some points."""
    total = weights.sum()
    centre, mean = (weights * away).sum() / total, (weights * values).sum() / total
    spread = (weights * np.square(away - centre)).sum()
    if spread < 1e-9 * total:
        return float(mean)
    slope = (weights * (away - centre) * (values - mean)).sum() / spread
    return float(mean - slope * centre)


class LiveLens:
    """Exponential smoothing of the fits on a live stream; jumps at cuts only.

    Args:
        frame_s: from one frame to the next, > 0 [s].
    """

    def __init__(self, frame_s: float) -> None:
        self._share = 1.0 - math.exp(-frame_s / _SMOOTHING_S)
        self._spacing = max(EVERY, round(_SPACING_S / frame_s))
        self._reference: Signature | None = None
        self._before: Signature | None = None
        self._since = 0
        self._cut = False
        self._still = True
        self._target: LensFit | None = None
        self._now: LensFit | None = None
        self.fits = 0

    def needs_refit(self, index: int, picture: Picture) -> bool:
        """Whether the lens must be fitted again on a frame; `picture` is its plate, unchanged."""
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
        self._still = stands_still(self._reference, seen)
        self._reference, self._since = seen, 0
        return True

    def found(self, fit: LensFit) -> None:
        """Smooth towards this fit from now on; jump to it if it is the first or after a cut.

        Within a shot, a fit that does not differ from the last by more than its error is left out.
        """
        if self._target is not None and not self._cut:
            if not differs(self._target, fit, still=self._still):
                return
        self._target = fit
        self.fits += 1
        if self._now is None or self._cut:
            self._now = fit
        self._cut = False

    def step(self) -> LensFit | None:
        """The lens of the next frame; None before the first fit."""
        now, target = self._now, self._target
        if now is None or target is None or now is target:
            return now
        slope = now.slope + self._share * (target.slope - now.slope)
        intercept = now.intercept + self._share * (target.intercept - now.intercept)
        self._now = replace(target, slope=slope, intercept=intercept)
        return self._now

    def describe(self) -> str:
        """A note for the user."""
        return f"the lens changes: followed by {self.fits} fits as they were found"
