"""Adaptive quality: a controller picks each frame's preset to hold the frame budget.

A frame after a change of level runs two graphs and crossfades their pictures.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from msgspec import Struct

from nlens_video.core.errors import UsageError
from nlens_video.effects.planner import Decision
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.base.node import Lane
from nlens_video.graph.base.profiler import FrameTiming
from nlens_video.graph.base.values import FrameValues
from nlens_video.graph.builder import Built, Graph, build
from nlens_video.graph.executor import FrameState, GraphExecutor
from nlens_video.graph.pipeline_file import load_pipeline

LEVELS = ("reference", "standard", "realtime", "draft")
"""The shipped presets that are levels, the best one first."""
_JUDGED = 8  # frames that decide on a step down
_SHARE = 0.75  # of them within the budget is enough
_COMFORT_S = 3.0  # time within the comfortable part of the budget before a step up
_COMFORT = 0.8  # of the budget: what the level above is expected to need at most
_PATIENCE = 2.0  # factor on that time for a level that was left again soon
_SOON_S = 10.0


class Step(Struct, frozen=True, kw_only=True):
    """A change of level.

    Attributes:
        frame: index of the frame whose time led to it.
        level: the one from then on.
        reason: why.
    """

    frame: int
    level: str
    reason: str


@dataclass(slots=True)
class BudgetControl:
    """Steps down when frames do not fit into the budget, and up when they would with room to spare.

    Time is that of the stream, counted in frames: the same times give the same steps.

    Args:
        budget_ms: what a frame may cost [ms].
        levels: names, the best one first; the run begins there.
        frame_s: from one frame to the next [s].
    """

    budget_ms: float
    levels: Sequence[str]
    frame_s: float
    steps: list[Step] = field(default_factory=list)
    at: int = 0
    _recent: deque[float] = field(default_factory=lambda: deque(maxlen=_JUDGED))
    _calm: deque[float] = field(default_factory=deque)
    _ratio: dict[int, float] = field(default_factory=dict)
    _left_ms: float | None = None
    _wait_s: dict[int, float] = field(default_factory=dict)
    _came_up: int | None = None

    @property
    def level(self) -> str:
        """The one that the next frame gets."""
        return self.levels[self.at]

    def observe(self, frame: int, level: str, total_ms: float) -> None:
        """Account for the time of a frame.

        Args:
            frame: its index.
            level: what it was made with; frames of a level that has been left tell nothing.
            total_ms: what it cost [ms].
        """
        if level != self.level:
            return
        self._recent.append(total_ms)
        self._calm.append(total_ms)
        while len(self._calm) > self._patience(self.at - 1):
            self._calm.popleft()
        self._compare()
        if self._over():
            self._down(frame)
        elif self._may_go_up():
            self._up(frame)

    def _compare(self) -> None:
        """Once a level has been seen, how much more the one above it costs."""
        if self._left_ms is not None and len(self._recent) == _JUDGED:
            self._ratio[self.at - 1] = max(1.0, self._left_ms / _middle(self._recent))
            self._left_ms = None

    def _over(self) -> bool:
        within = sum(time <= self.budget_ms for time in self._recent)
        return len(self._recent) == _JUDGED and within < _SHARE * _JUDGED

    def _may_go_up(self) -> bool:
        above = self.at - 1
        if above < 0 or len(self._calm) < self._patience(above):
            return False
        return _high(self._calm) * self._ratio.get(above, 1.0) <= _COMFORT * self.budget_ms

    def _patience(self, level: int) -> int:
        """Comfortable frames that a step up to a level asks for."""
        return max(_JUDGED, round(self._wait_s.get(level, _COMFORT_S) / self.frame_s))

    def _down(self, frame: int) -> None:
        if self.at + 1 >= len(self.levels):
            return
        if self._came_up is not None and (frame - self._came_up) * self.frame_s < _SOON_S:
            self._wait_s[self.at] = _PATIENCE * self._wait_s.get(self.at, _COMFORT_S)
        slow = _middle([time for time in self._recent if time > self.budget_ms])
        self._go(frame, self.at + 1, f"{slow:.0f} ms a frame, {self.budget_ms:g} allowed")
        self._left_ms = slow

    def _up(self, frame: int) -> None:
        self._came_up = frame
        self._go(frame, self.at - 1, f"{_high(self._calm):.0f} ms a frame for long")

    def _go(self, frame: int, level: int, reason: str) -> None:
        self.at = level
        self._recent.clear()
        self._calm.clear()
        self.steps.append(Step(frame=frame, level=self.level, reason=reason))


def _middle(times: Sequence[float] | deque[float]) -> float:
    return sorted(times)[len(times) // 2]


def _high(times: Sequence[float] | deque[float]) -> float:
    """The time that nine in ten do not exceed [ms]."""
    return sorted(times)[(9 * len(times)) // 10]


CROSSFADE_FRAMES = 8
"""Frames over which one level's pictures become the next one's."""


def check_level(preset: str) -> None:
    """Check that a preset has levels to step down to.

    Raises:
        UsageError: it is none of the levels, or the lowest.
    """
    if preset not in LEVELS[:-1]:
        raise UsageError(
            f"--hold-budget with --preset {preset}: quality steps down from one of "
            f"{', '.join(LEVELS[:-1])}; choose one of them"
        )


def lower_levels(
    best: Graph, decisions: Sequence[Decision], context: NodeContext, built: Built
) -> dict[str, Graph]:
    """The graphs from a level downwards.

    Args:
        best: the graph of the best level.
        decisions: which effects are simulated, where a level has them at all.
        context: that of the best level.
        built: its nodes, which other levels take where they are the same.
    """
    graphs = {best.pipeline: best}
    for name in LEVELS[LEVELS.index(best.pipeline) + 1 :]:
        graphs[name] = build(
            load_pipeline(name), decisions, context, fit_given=not best.has("fit"), built=built
        )
    return graphs


class QualityExecutor:
    """Chooses the level of each frame and runs its graph, two of them during a crossfade.

    Fit, renderer and networks are those of all levels; what two graphs have in common is computed
    once. Frames of a crossfade cost more than their level and are not held against it.

    Args:
        executor: runs nodes, and keeps what the shot has found out.
        graphs: of each level, the best one first.
        control: decides.
    """

    def __init__(
        self, executor: GraphExecutor, graphs: dict[str, Graph], control: BudgetControl
    ) -> None:
        self.graphs = graphs
        self._executor = executor
        self._control = control
        self._shown = self._before = control.level
        self._fade = 0
        self._frames: Counter[str] = Counter()

    def run(self, state: FrameState, lane: Lane) -> None:
        """Run one lane's nodes of a frame's level, and of the level that it comes from."""
        if not state.level:
            self._choose(state)
        previous = state.crossfade
        if previous is not None and lane == "composite":  # nothing is composited before this lane
            previous.values.picture = state.frame.picture.copy()
        self._executor.run(state, self.graphs[state.level].lane(lane))
        if previous is None:
            return
        if not previous.started:
            previous.values.fit = state.values.fit
            previous.started = True
        self._executor.run(previous, self.graphs[previous.level].lane(lane))
        if lane == "composite":
            state.frame.picture.crossfade(previous.picture, previous.blend_weight)

    def on_written(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame is written: learn from its time."""
        self._frames[state.level] += 1
        if state.crossfade is None and not state.fitted_here:
            self._control.observe(timing.index, state.level, timing.total_ms)

    def describe(self) -> tuple[str, ...]:
        """What was done to hold the budget, for the summary."""
        made = ", ".join(f"{self._frames[name]} {name}" for name in self.graphs)
        steps = "; ".join(
            f"after frame {step.frame} to {step.level} ({step.reason})"
            for step in self._control.steps
        )
        return (f"budget of {self._control.budget_ms:g} ms held: {made}; {steps or 'no step'}",)

    def _choose(self, state: FrameState) -> None:
        wanted = self._control.level
        if not self._fade and wanted != self._shown:
            self._before, self._shown, self._fade = self._shown, wanted, CROSSFADE_FRAMES
        state.level = self._shown
        if self._fade:
            given = state.values
            values = FrameValues(
                frame=given.frame, picture=given.picture, frame_box=given.frame_box
            )
            state.crossfade = FrameState(
                state.frame,
                values,
                level=self._before,
                blend_weight=self._fade / (CROSSFADE_FRAMES + 1),
                reusable=state.results,
            )
            self._fade -= 1
