"""A lens that changes over a shot: fits at some frames, smooth between them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Float64
from nlens_video.core.lens_fit import LensFit

_LEAST_ERROR = 1e-3  # of a fit [px]
_MOST_FRAMES = 1 << 40  # of a film that a file may speak of


@dataclass(frozen=True, slots=True)
class Keyframe:
    """The lens at one frame.

    Attributes:
        index: of the frame [1].
        shot: number of the shot; nothing is carried over a cut.
        fit: the lens.
    """

    index: int
    shot: int
    fit: LensFit


@dataclass(frozen=True, slots=True)
class FitTrack:
    """The lens at every frame of a file.

    Local lines through the fits within a stretch of time, each weighted by its standard error: no
    jump from frame to frame, no lag, and cuts are kept.

    Attributes:
        keys: in order, at least one.
        stretch: deviation of the Gaussian window, > 0 [frames].
        cuts: first frame of every shot but the first [1].
    """

    keys: tuple[Keyframe, ...]
    stretch: float
    cuts: tuple[int, ...] = ()

    def at(self, index: int) -> LensFit:
        """The lens at a frame."""
        shot = int(np.searchsorted(self.cuts, index, side="right"))
        own = [key for key in self.keys if key.shot == shot] or [self._nearest(index)]
        if len(own) == 1:
            return own[0].fit
        fits = [key.fit for key in own]
        away = np.array([key.index - index for key in own], np.float64)
        nearest = fits[int(np.argmin(np.abs(away)))]
        # farther than the window reaches the nearest keys still count
        width = max(self.stretch, float(np.sort(np.abs(away))[1]) / 2.0)
        window = np.exp(-0.5 * np.square(away / width))
        values = {
            name: _line_at_zero(
                away,
                np.array([getattr(fit, name) for fit in fits]),
                window / _variances([getattr(fit, f"{name}_stderr") for fit in fits]),
            )
            for name in ("slope", "intercept")
        }
        slope = max(values["slope"], 0.0)
        return replace(nearest, slope=slope, intercept=values["intercept"], frame=index)

    def _nearest(self, index: int) -> Keyframe:
        return min(self.keys, key=lambda key: abs(key.index - index))

    def for_width(self, width: int, height: int) -> FitTrack:
        """The same lens on frames of another size."""
        keys = (replace(key, fit=key.fit.for_width(width, height)) for key in self.keys)
        return replace(self, keys=tuple(keys))

    def to_json(self) -> str:
        """A `fit.json` that holds all of it; who knows no tracks reads the first frame's lens."""
        track = {"stretch": self.stretch, "cuts": self.cuts, "keys": [asdict(k) for k in self.keys]}
        return json.dumps({**json.loads(self.at(0).to_json()), "track": track}, indent=2) + "\n"

    @classmethod
    def load(cls, path: Path) -> FitTrack | None:
        """Read it back; None where the file holds one lens only.

        Raises:
            LensFitError: the file cannot be read, or its track makes no sense.
        """
        LensFit.load(path)
        track = json.loads(path.read_text(encoding="utf-8")).get("track")
        if track is None:
            return None
        try:
            keys = tuple(
                Keyframe(
                    int(key["index"]), int(key["shot"]),
                    LensFit.from_json(json.dumps(key["fit"]), str(path)),
                )
                for key in track["keys"]
            )  # fmt: skip
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
        """What a person should know of it."""
        focus = [key.fit.focus_disparity for key in self.keys]
        ends = [1.0 / d if d > 0.0 else float("inf") for d in (focus[0], focus[-1])]
        cuts = f" over {len(self.cuts) + 1} shots" if self.cuts else ""
        found = len({key.fit.frame for key in self.keys})
        return (
            f"the lens changes: followed by {found} fits{cuts}, in focus at depth "
            f"{ends[0]:.3g} at first, {ends[1]:.3g} at last"
        )


def hold_segments(keys: Sequence[Keyframe], spacing: int, end: int) -> tuple[Keyframe, ...]:
    """Keys, and where the watch saw no change for a while, the same lens again and again.

    Args:
        keys: in order.
        spacing: least distance of two keys [frames].
        end: number of frames in all [1].
    """
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
