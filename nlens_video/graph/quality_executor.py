"""A stream whose quality is held to a budget: each frame runs the graph of its level."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from nlens_video.core.errors import UsageError
from nlens_video.effects.planner import Decision
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.base.node import Lane
from nlens_video.graph.base.profiler import FrameTiming
from nlens_video.graph.base.values import FrameValues
from nlens_video.graph.builder import Built, Graph, build
from nlens_video.graph.executor import FrameState, GraphExecutor
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.graph.quality_control import LEVELS, BudgetControl

CROSSFADE_FRAMES = 8
"""Frames over which one level's pictures become the next one's."""


def check_level(preset: str) -> None:
    """See that a preset has levels to step down to.

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
        twin = state.crossfade
        if twin is not None and lane == "composite":  # nothing is composited before this lane
            twin.values.picture = state.frame.picture.copy()
        self._executor.run(state, self.graphs[state.level].lane(lane))
        if twin is None:
            return
        if not twin.started:
            twin.values.fit = state.values.fit
            twin.started = True
        self._executor.run(twin, self.graphs[twin.level].lane(lane))
        if lane == "composite":
            state.frame.picture.mix(twin.picture, twin.blend_weight)

    def wrote(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame is written: learn from its time."""
        self._frames[state.level] += 1
        if state.crossfade is None and not state.carried_fit:
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
