"""R over time: smooths the fits of a lens that changes over a shot of a file.

A file is fitted in a pass of its own; streams are followed by `graph.base.live_lens`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict, replace

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Float64
from nlens_video.core.lens_fit import LensFit

_LEAST_ERROR = 1e-3  # of a fit [px]
_SAME_SLOPE = 1.0  # mean square of what slopes differ by, in their errors: 0.1 to 0.5 in pulls
_UNSEEN_PX = 0.25  # by which smoothing over time may change a CoC
_MOST_FRAMES = 1 << 40  # limit of frame numbers in a file
_ROUNDING = 1e-4  # by which values that are the same may differ in a file


class Keyframe(Struct, frozen=True):
    """The lens at one frame.

    Attributes:
        index: of the frame [1].
        shot: number of the shot; nothing is interpolated across a cut.
        fit: the lens.
    """

    index: int
    shot: int
    fit: LensFit


class FitTrack(Struct, frozen=True):
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
        """The lens at a frame; before the first key of its shot and after the last, that key's."""
        shot = int(np.searchsorted(self.cuts, index, side="right"))
        nearest_key = min(self.keys, key=lambda key: abs(key.index - index))
        own = [key for key in self.keys if key.shot == shot] or [nearest_key]
        if len(own) == 1:
            return own[0].fit
        fits = [key.fit for key in own]
        there = min(max(index, own[0].index), own[-1].index)
        away = np.array([key.index - there for key in own], np.float64)
        nearest = fits[int(np.argmin(np.abs(away)))]
        width = min(self.stretch, _widest_window(away, fits))
        # the window is at least as wide as the nearest keys are far
        width = max(width, float(np.sort(np.abs(away))[1]) / 2.0)
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

    def to_json(self, first: int = 0) -> str:
        """A `fit.json` with the track; readers without tracks get the lens of frame `first`."""
        keys = [{**asdict(key), "fit": asdict(key.fit)} for key in self.keys]
        track = {"stretch": self.stretch, "cuts": self.cuts, "keys": keys}
        return json.dumps({**json.loads(self.at(first).to_json()), "track": track}, indent=2) + "\n"

    @classmethod
    def load(cls, path: Path) -> FitTrack | None:
        """Read a `fit.json`; None where the file holds one lens only.

        Raises:
            LensFitError: the file cannot be read, its track makes no sense, or tells another lens
                than the file's first values, which readers without tracks take.
        """
        alone = LensFit.load(path)
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
            loaded = cls(keys, stretch, cuts)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise LensFitError(
                f"{path}: its track of a lens that changes makes no sense ({error}); fit again"
            ) from error
        there = loaded.at(alone.frame)
        if not any(_alike(alone, one) for one in (there, *fits)):
            raise LensFitError(
                f'{path}: {_values(alone)} are not those of its "track" ({_values(there)}), which '
                'tells the lens of each frame; delete "track" for one lens on all, or fit again'
            )
        return loaded

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


def read_fit(path: Path) -> LensFit | FitTrack:
    """Read a `fit.json`: the track where it has one, else its one lens.

    Raises:
        LensFitError: as `FitTrack.load`.
    """
    return FitTrack.load(path) or LensFit.load(path)


def _values(fit: LensFit) -> str:
    return f"slope {fit.slope:g} and intercept {fit.intercept:g} at {fit.width}x{fit.height}"


def _alike(fit: LensFit, other: LensFit) -> bool:
    """Whether two fits are one lens, but for what text and another machine round."""
    return (fit.width, fit.height) == (other.width, other.height) and all(
        math.isclose(value, there, rel_tol=_ROUNDING, abs_tol=_ROUNDING)
        for value, there in ((fit.slope, other.slope), (fit.intercept, other.intercept))
    )


def _focus_depth(fit: LensFit) -> str:
    return f"depth {1.0 / fit.focus_disparity:.3g}" if fit.focus_disparity > 0.0 else "infinity"


def share_slope(keys: Sequence[Keyframe]) -> tuple[Keyframe, ...]:
    """Keys of one shot with one slope, where their slopes agree within their errors.

    The slope is f A / (1 - f / s) of focal length f, aperture A and focused distance s: a pull of
    the focus hardly changes it, for s is many times f. Each intercept becomes the one expected
    where its own slope is corrected, by the correlation of their errors.
    """
    slopes = np.array([key.fit.slope for key in keys])
    errors = np.array([key.fit.slope_stderr for key in keys])
    if len(keys) < 2 or not (errors > 0.0).all():
        return tuple(keys)
    mean = float(np.average(slopes, weights=errors**-2.0))
    if float(np.mean(np.square((slopes - mean) / errors))) > _SAME_SLOPE:
        return tuple(keys)
    return tuple(replace(key, fit=_with_slope(key.fit, mean)) for key in keys)


def _with_slope(fit: LensFit, slope: float) -> LensFit:
    """The fit with another slope, and the intercept expected with it."""
    change = fit.correlation * fit.intercept_stderr / fit.slope_stderr * (slope - fit.slope)
    return replace(fit, slope=slope, intercept=fit.intercept + change)


def hold_segments(
    keys: Sequence[Keyframe], spacing: int, held: Mapping[int, int]
) -> tuple[Keyframe, ...]:
    """Keys in order, repeated where the lens stays.

    Args:
        keys: in order.
        spacing: from one repetition to the next, >= 1 [frames].
        held: by index of a key: frame up to which the lens stays [1].
    """
    repeated: list[Keyframe] = []
    for key in keys:
        repeated.append(key)
        last = held.get(key.index, key.index)
        there = (*range(key.index + spacing, last, spacing), *([last] * (last > key.index)))
        repeated += [replace(key, index=index) for index in there]
    return tuple(repeated)


def _widest_window(away: Float64, fits: Sequence[LensFit]) -> float:
    """Deviation of a window that bends the way of the lens by no more than is seen [frames].

    A line through a window of deviation w misses a curve of second derivative c by c w^2 / 2. It is
    taken from the keys beside the frame: where the focus is racked, the window has to be short.

    Args:
        away: frames of the keys from the frame in question, rising (N,).
        fits: the lens there (N,).
    """
    there = fits[0].object_disparity
    coc_px = np.array([fit.slope * there + fit.intercept for fit in fits])
    after = int(np.searchsorted(away, 0.0))
    sharpest = 0.0
    for middle in (after - 1, after):
        if 0 < middle < len(fits) - 1:
            steps = np.diff(away[middle - 1 : middle + 2])
            rates = np.diff(coc_px[middle - 1 : middle + 2]) / steps
            sharpest = max(sharpest, 2.0 * abs(float(rates[1] - rates[0])) / float(steps.sum()))
    return math.sqrt(2.0 * _UNSEEN_PX / max(sharpest, 1e-12))


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
