"""Data of the report in bounded memory: pictures of a few frames, timings in bins, the session."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import DefocusedLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.profiler import FrameTiming, Summary
from nlens_video.graph.base.values import ShotValues
from nlens_video.graph.session import Session
from nlens_video.report.html import Image
from nlens_video.stages.r_regression import Regression
from nlens_video.video.info import SourceInfo

T = TypeVar("T")
NEVER_SEEN = "No frame was composited: the object was never in view."


class MainFrame(Struct, frozen=True, kw_only=True):
    """The frame of the large pictures: the one that carried the fit, if there is one.

    Attributes:
        index: position in the source [1].
        time_s: time of the animation [s].
        before: the plate.
        after: the composite, None where nothing was composited.
        defocused: the object and its CoC, None where it was left sharp or not drawn.
    """

    index: int
    time_s: float
    before: Image
    after: Image | None
    defocused: DefocusedLayer | None


class StripFrame(Struct, frozen=True, kw_only=True):
    """The thumbnail of a composited frame.

    Attributes:
        index: position in the source [1].
        time_s: time of the animation [s].
        jpeg: the picture.
        size: columns and rows of the frame itself [px].
        largest_coc_px: of the object, None where it was left sharp [px].
    """

    index: int
    time_s: float
    jpeg: bytes
    size: tuple[int, int]
    largest_coc_px: float | None


@dataclass(slots=True)
class EvenPick(Generic[T]):
    """Keeps every 2^k-th of a stream of unknown length; when full, drops every second.

    Attributes:
        room: how many are kept at most, even [1].
    """

    room: int = 24
    _kept: list[T] = field(default_factory=list)
    _every: int = 1
    _seen: int = 0

    def next_is_wanted(self) -> bool:
        """Count one more of the stream; whether it should be `keep`t."""
        wanted = self._seen % self._every == 0
        self._seen += 1
        return wanted

    def keep(self, item: T) -> None:
        """Keep the one that was just wanted."""
        if len(self._kept) == self.room:
            # with an even room, the newcomer falls on the coarser grid as well
            del self._kept[1::2]
            self._every *= 2
        self._kept.append(item)

    def picked(self, count: int) -> list[T]:
        """At most `count` of them, spread evenly, first and last kept ones included."""
        if len(self._kept) <= count:
            return list(self._kept)
        places = np.linspace(0, len(self._kept) - 1, count).round().astype(int)
        return [self._kept[at] for at in places]


@dataclass(slots=True)
class TimingBin:
    """Timings of some neighbouring frames.

    Attributes:
        first: index of its first frame [1].
        frames: how many [1].
        total_ms: sum of each node over them [ms].
        slowest_ms: time of the slowest of them [ms].
    """

    first: int
    frames: int = 0
    total_ms: dict[str, float] = field(default_factory=dict)
    slowest_ms: float = 0.0

    def mean_ms(self, node: str) -> float:
        """Mean time of a node over all frames of the bin [ms]."""
        return self.total_ms.get(node, 0.0) / max(self.frames, 1)

    def merge(self, other: TimingBin) -> None:
        """Add the bin that follows."""
        self.frames += other.frames
        for node, elapsed_ms in other.total_ms.items():
            self.total_ms[node] = self.total_ms.get(node, 0.0) + elapsed_ms
        self.slowest_ms = max(self.slowest_ms, other.slowest_ms)


@dataclass(slots=True)
class TimingBins:
    """Timings of a clip in at most `room` bins, one frame each as long as that suffices.

    Attributes:
        bins: in order.
        width: frames per full bin [1].
        room: how many bins at most, even [1].
    """

    room: int = 600
    bins: list[TimingBin] = field(default_factory=list)
    width: int = 1

    def add(self, timing: FrameTiming) -> None:
        """Count one frame."""
        row = TimingBin(timing.index, 1, dict(timing.nodes), timing.total_ms)
        if self.bins and self.bins[-1].frames < self.width:
            self.bins[-1].merge(row)
            return
        if len(self.bins) == self.room:
            for left, right in zip(self.bins[::2], self.bins[1::2], strict=True):
                left.merge(right)
            del self.bins[1::2]
            self.width *= 2
        self.bins.append(row)


class Findings(Struct, frozen=True, kw_only=True):
    """All that the page is made from.

    Attributes:
        info: the source.
        output: what was written, as the user gave it.
        session: graph, decisions and what the fit was made from.
        main: the frame of the large pictures, None where the object was never in view.
        strip: composited frames, spread evenly.
        timings: of the frames, without `warm_up`.
        warm_up: the frame that carried the fit.
        summary: the run in a few numbers.
        notes: what the user should know.
    """

    info: SourceInfo
    output: str
    session: Session
    main: MainFrame | None
    strip: list[StripFrame]
    timings: TimingBins
    warm_up: FrameTiming | None
    summary: Summary
    notes: tuple[str, ...]

    @property
    def fit(self) -> LensFit | None:
        """The lens, once found or given."""
        return self.session.executor.fit

    @property
    def shot(self) -> ShotValues:
        """What the fit was made from."""
        return self.session.executor.shot

    @property
    def regression(self) -> Regression | None:
        """The fit with its samples, where it was made on this plate."""
        found = self.shot.found_lens
        return None if found is None else found.regression

    @property
    def doubt(self) -> str:
        """Warning about the fit; empty if there is none."""
        found = self.shot.found_lens
        return "" if found is None else found.warning

    @property
    def no_fit_reason(self) -> str:
        """Why sections about the lens are missing; empty where none is."""
        if self.shot.plate_coc is not None:
            return ""
        if self.fit is not None:
            return (
                "The lens was given with --fit, so nothing was measured on this plate. "
                "Leave --fit out to see the measurement."
            )
        for decision in self.session.decisions:
            if decision.effect == "defocus" and not decision.wanted:
                return f"Defocus was not simulated ({decision.reason}), so no lens was measured."
        return (
            "The object was never in view, so no lens was measured. "
            "Check the camera of the GLB (--camera) and --range."
        )
