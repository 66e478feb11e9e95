"""A stream whose quality is held to a budget: each frame runs the graph of its rung."""

from __future__ import annotations

from collections import Counter

from nlens_video.graph.builder import Graph
from nlens_video.graph.executor import FrameState, FrameSteps
from nlens_video.graph.node import LaneName
from nlens_video.graph.profiler import FrameTiming
from nlens_video.graph.quality_control import BudgetControl

FADE_FRAMES = 8
"""Frames over which one rung's pictures become the next one's."""


class HeldBudget:
    """Chooses the rung of each frame and runs its graph, two of them while one fades into the next.

    Fit, renderer and networks are those of all rungs; what two graphs have in common is computed
    once. Frames that fade cost more than their rung and are not held against it.

    Args:
        steps: runs nodes, and keeps what the shot has found out.
        graphs: of each rung, the best one first.
        control: decides.
    """

    def __init__(self, steps: FrameSteps, graphs: dict[str, Graph], control: BudgetControl) -> None:
        self.graphs = graphs
        self._steps = steps
        self._control = control
        self._shown = self._before = control.rung
        self._fade = 0
        self._frames: Counter[str] = Counter()

    def run(self, state: FrameState, lane: LaneName) -> None:
        """Run one lane's nodes of a frame's rung, and of the rung that it comes from."""
        if not state.rung:
            self._choose(state)
        if state.twin is not None and lane == "lens":  # nothing is composited before this lane
            state.twin.values["picture"] = state.frame.picture.copy()
        self._steps.run(state, self.graphs[state.rung].lane(lane))
        if state.twin is None:
            return
        if not state.twin.started:
            state.twin.values = {
                name: state.values[name]
                for name in ("frame", "picture", "frame_box", "fit")
                if name in state.values
            }
            state.twin.started = True
        self._steps.run(state.twin, self.graphs[state.twin.rung].lane(lane))
        if lane == "lens":
            state.frame.picture.mix(state.twin.picture, state.twin.share)

    def wrote(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame is written: learn from its time."""
        self._frames[state.rung] += 1
        if state.twin is None and not state.carried_fit:
            self._control.observe(timing.index, state.rung, timing.total_ms)

    def words(self) -> tuple[str, ...]:
        """What was done to hold the budget, for the summary."""
        made = ", ".join(f"{self._frames[name]} {name}" for name in self.graphs)
        steps = "; ".join(
            f"after frame {step.frame} to {step.rung} ({step.reason})"
            for step in self._control.steps
        )
        return (f"budget of {self._control.budget_ms:g} ms held: {made}; {steps or 'no step'}",)

    def _choose(self, state: FrameState) -> None:
        wanted = self._control.rung
        if not self._fade and wanted != self._shown:
            self._before, self._shown, self._fade = self._shown, wanted, FADE_FRAMES
        state.rung = self._shown
        if self._fade:
            share = self._fade / (FADE_FRAMES + 1)
            state.twin = FrameState(state.frame, rung=self._before, share=share, reused=state.ran)
            self._fade -= 1
