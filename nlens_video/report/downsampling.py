"""What keeps a report small however long the clip is: even picks, and timings in bins."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from nlens_video.graph.base.profiler import FrameTiming

T = TypeVar("T")


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
        slowest_ms: the most that one of them cost [ms].
    """

    first: int
    frames: int = 0
    total_ms: dict[str, float] = field(default_factory=dict)
    slowest_ms: float = 0.0

    def mean_ms(self, node: str) -> float:
        """Mean cost of a node over all frames of the bin [ms]."""
        return self.total_ms.get(node, 0.0) / max(self.frames, 1)

    def merge(self, other: TimingBin) -> None:
        """Take in the bin that follows."""
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
