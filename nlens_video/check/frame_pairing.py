"""Plate and result read side by side and paired by their times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from nlens_video.check.frame_features import FrameFeatures


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """A frame of the result and the plate's frame of that time.

    Attributes:
        plate: the plate's frame.
        result: the result's frame.
        before: the plate's frame before, None at its beginning.
        after: the plate's frame after, None at its end.
    """

    plate: FrameFeatures
    result: FrameFeatures
    before: FrameFeatures | None
    after: FrameFeatures | None

    @property
    def off_s(self) -> float:
        """How much later the result's frame is shown [s]."""
        return float(self.result.time_s - self.plate.time_s)


@dataclass(frozen=True, slots=True)
class Unpaired:
    """A frame without a partner: the plate's (`dropped`), or one that the result has added."""

    index: int
    time_s: float
    dropped: bool


def pair_frames(
    plate: Iterator[FrameFeatures], result: Iterator[FrameFeatures]
) -> Iterator[Pair | Unpaired]:
    """Pair frames whose times differ by less than half a plate's frame; holds five of them."""
    before: FrameFeatures | None = None
    now, after = next(plate, None), next(plate, None)
    shown = next(result, None)
    step = Fraction(1, 25)
    while now is not None and shown is not None:
        step = after.time_s - now.time_s if after is not None else step
        if abs(shown.time_s - now.time_s) <= step / 2:
            yield Pair(now, shown, before, after)
            shown = next(result, None)
        elif shown.time_s < now.time_s:
            yield Unpaired(shown.index, float(shown.time_s), dropped=False)
            shown = next(result, None)
            continue
        else:
            yield Unpaired(now.index, float(now.time_s), dropped=True)
        before, now, after = now, after, next(plate, None)
    while now is not None:
        yield Unpaired(now.index, float(now.time_s), dropped=True)
        now, after = after, next(plate, None)
    while shown is not None:
        yield Unpaired(shown.index, float(shown.time_s), dropped=False)
        shown = next(result, None)
