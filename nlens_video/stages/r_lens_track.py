"""R over time: detects changes of the lens, and smooths its fits over a shot.

Estimating the CoC takes a tenth of a second, the change detector a few milliseconds. It compares
the plate's blur with that at the last fit: patches on a grid are split in octaves of detail. Blur
removes detail octave by octave, whatever the light and the contrast, so the ratio of neighbouring
octaves is compared: by rows of patches, since the depth of a ground, and so its blur, goes by rows;
and by medians, so that moving things do not count.

A file is fitted in a pass of its own (`FitTrack`). On a live stream a change is detected only after
it occurred; the lens then moves towards the newest fit by a fixed share per frame (`LiveLens`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Box, Float32, Float64, Picture
from nlens_video.core.lens_fit import LensFit

CHANGED = 0.1
"""Change of the log-ratio of two octaves that calls for another fit: a focus that moves by 7 %
gives as much, or an aperture that opens by a fifth; noise and a panning camera seldom do."""

CUT = 0.12  # mean change of the patches' brightness from one frame to the next [1]
EVERY = 3  # frames from one change detection of a live stream to the next
_ROWS, _COLUMNS = 6, 8
_PATCH_SHARE = 1 / 16  # of the frame's width
_SMALLEST_PX, _LARGEST_PX = 24, 64
_BLURS_PX = (0.8, 1.6, 3.2, 6.4)  # between which the octaves lie
_FLOOR = 1.5e-3  # detail of less than this is noise (root of scene-linear light) [1]
_LEAST_ERROR = 1e-3  # of a fit [px]
_MOST_FRAMES = 1 << 40  # limit of frame numbers in a file
_SPACING_S = 0.2  # least time between two fits of a live stream
_SMOOTHING_S = 0.15  # time constant of its smoothing


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
    patches = np.empty((side, side, _ROWS * _COLUMNS), np.float32)
    for at in range(_ROWS * _COLUMNS):
        row, column = divmod(at, _COLUMNS)
        y = (picture.height - side) * (2 * row + 1) // (2 * _ROWS)
        x = (picture.width - side) * (2 * column + 1) // (2 * _COLUMNS)
        patches[..., at] = picture.linear(Box(x, y, x + side, y + side))[..., 1]
    root = np.sqrt(np.maximum(patches, 0.0))
    grid = (_ROWS, _COLUMNS)
    return Signature(_octaves(root).reshape(*grid, -1), root.mean(axis=(0, 1)).reshape(grid))


def _octaves(patches: Float32) -> Float64:
    """Log-ratios of adjacent octaves (N, octaves - 1) of patches (side, side, N), nan in noise."""
    soft = [
        cv2.GaussianBlur(patches, (0, 0), blur, borderType=cv2.BORDER_REFLECT) for blur in _BLURS_PX
    ]
    bands = zip(soft[:-1], soft[1:], strict=True)
    detail = np.stack([(fine - coarse).std(axis=(0, 1)) for fine, coarse in bands], axis=1)
    ratios = np.diff(np.log(np.maximum(detail, _FLOOR)).astype(np.float64), axis=1)
    ratios[detail[:, 1:] <= _FLOOR] = np.nan
    return np.asarray(ratios)


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


def is_cut(before: Signature, now: Signature) -> bool:
    """Whether another shot begins between two neighbouring frames."""
    return float(np.abs(now.light - before.light).mean()) > CUT


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
        focus = [key.fit.focus_disparity for key in self.keys]
        ends = [1.0 / d if d > 0.0 else float("inf") for d in (focus[0], focus[-1])]
        cuts = f" over {len(self.cuts) + 1} shots" if self.cuts else ""
        found = len({key.fit.frame for key in self.keys})
        return (
            f"the lens changes: followed by {found} fits{cuts}, in focus at depth "
            f"{ends[0]:.3g} at first, {ends[1]:.3g} at last"
        )


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
        self._reference, self._since = seen, 0
        return True

    def found(self, fit: LensFit) -> None:
        """Smooth towards this fit from now on; jump to it if it is the first or after a cut."""
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
