"""Times of each node on each frame, streamed row by row in constant memory."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from msgspec import Struct

_FINEST_MS = 1e-3
_BIN = math.log(1.01)  # quantiles are read from bins 1 % wide


class FrameTiming(Struct, frozen=True, kw_only=True):
    """What one frame cost.

    Attributes:
        index: position of the frame in the stream [1].
        pts: its presentation time stamp, in ticks of its stream's time base [1].
        nodes: time of each node that ran [ms].
    """

    index: int
    pts: int
    nodes: dict[str, float]

    @property
    def total_ms(self) -> float:
        """Sum over the nodes: what the frame would take without overlap [ms]."""
        return sum(self.nodes.values())


@dataclass(slots=True)
class Quantiles:
    """Quantiles of a stream of times in constant memory, exact to 1 %."""

    count: int = 0
    _bins: dict[int, int] = field(default_factory=dict)

    def add(self, elapsed_ms: float) -> None:
        """Count one time [ms]."""
        at = math.ceil(math.log(max(elapsed_ms, _FINEST_MS) / _FINEST_MS) / _BIN)
        self._bins[at] = self._bins.get(at, 0) + 1
        self.count += 1

    def quantile(self, share: float) -> float:
        """The time that `share` of those counted do not exceed [ms], 0 where none was."""
        passed = 0
        for at in sorted(self._bins):
            passed += self._bins[at]
            if passed >= share * self.count:
                return _FINEST_MS * math.exp((at - 0.5) * _BIN)
        return 0.0


class Summary(Struct, frozen=True, kw_only=True):
    """A run in a few numbers; the first composited frame, which carries the fit, is told apart.

    Attributes:
        frames: written [1].
        wall_s: from start to end [s].
        first_frame_ms: the frame that carried the fit and all warming up [ms].
        median_ms: of the other frames' node times, summed [ms].
        p95_ms: their 95th percentile [ms].
        budget_ms: what a frame may cost [ms].
        within_budget: share of them within the budget, 0 to 1 [1].
        node_median_ms: median of each node over the frames on which it ran [ms].
        latency_median_ms: from a live source's frame being decoded to it being written [ms].
        latency_p95_ms: its 95th percentile [ms].
        dropped: frames of a live source that were left out because they came too fast [1].
    """

    frames: int
    wall_s: float
    first_frame_ms: float
    median_ms: float
    p95_ms: float
    budget_ms: float
    within_budget: float
    node_median_ms: dict[str, float]
    latency_median_ms: float = 0.0
    latency_p95_ms: float = 0.0
    dropped: int = 0

    @property
    def fps(self) -> float:
        """Frames per second of the whole run, all lanes overlapping [1/s]."""
        return self.frames / self.wall_s if self.wall_s > 0 else 0.0


class Profiler:
    """Times nodes; the lanes' threads write to it side by side.

    Args:
        budget_ms: what a frame may cost [ms].
        on_frame: called with each finished row, in order.
    """

    def __init__(
        self, budget_ms: float = 180.0, on_frame: Callable[[FrameTiming], None] | None = None
    ) -> None:
        self.budget_ms = budget_ms
        self._on_frame = on_frame
        self._open: dict[int, dict[str, float]] = {}
        self._nodes: dict[str, Quantiles] = {}
        self._total = Quantiles()
        self._within = 0
        self._frames = 0
        self._warm_up: FrameTiming | None = None
        self._arrivals: dict[int, float] = {}
        self._latency = Quantiles()
        self._dropped = 0
        self._started = time.perf_counter()
        self._ended = self._started

    @contextmanager
    def timed(self, index: int, node: str) -> Iterator[None]:
        """Time the body as `node` of frame `index`; a node that runs twice adds up."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.add(index, node, 1e3 * (time.perf_counter() - start))

    def add(self, index: int, node: str, elapsed_ms: float) -> None:
        """Add a time measured elsewhere [ms]."""
        row = self._open.setdefault(index, {})
        row[node] = row.get(node, 0.0) + elapsed_ms

    def arrived(self, index: int) -> None:
        """A live source has just given a frame: its latency counts from here."""
        self._arrivals[index] = time.perf_counter()

    def drop(self, index: int) -> None:
        """The frame is left out: its row is forgotten."""
        self._open.pop(index, None)
        self._arrivals.pop(index, None)
        self._dropped += 1

    def close_frame(self, index: int, pts: int, *, warm_up: bool = False) -> FrameTiming:
        """The frame is written: count its row, apart from the rest if it carried the fit."""
        timing = FrameTiming(index=index, pts=pts, nodes=self._open.pop(index, {}))
        self._frames += 1
        self._ended = time.perf_counter()
        arrival = self._arrivals.pop(index, None)
        if arrival is not None and not warm_up:
            self._latency.add(1e3 * (self._ended - arrival))
        if warm_up:
            self._warm_up = timing
        else:
            self._total.add(timing.total_ms)
            self._within += timing.total_ms <= self.budget_ms
            for node, elapsed_ms in timing.nodes.items():
                self._nodes.setdefault(node, Quantiles()).add(elapsed_ms)
        if self._on_frame is not None:
            self._on_frame(timing)
        return timing

    def summary(self) -> Summary:
        """The whole run in a few numbers."""
        nodes = {name: times.quantile(0.5) for name, times in self._nodes.items()}
        if self._warm_up is not None:
            nodes = {**{n: ms for n, ms in self._warm_up.nodes.items() if n not in nodes}, **nodes}
        steady = self._total.count
        warm_up_ms = self._warm_up.total_ms if self._warm_up is not None else 0.0
        return Summary(
            frames=self._frames,
            wall_s=self._ended - self._started,
            first_frame_ms=warm_up_ms,
            median_ms=self._total.quantile(0.5) if steady else warm_up_ms,
            p95_ms=self._total.quantile(0.95) if steady else warm_up_ms,
            budget_ms=self.budget_ms,
            within_budget=self._within / steady if steady else float(warm_up_ms <= self.budget_ms),
            node_median_ms=nodes,
            latency_median_ms=self._latency.quantile(0.5),
            latency_p95_ms=self._latency.quantile(0.95),
            dropped=self._dropped,
        )
