"""What travels through the lanes, and the lanes themselves."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from typing import cast

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Box, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.builder import Graph
from nlens_video.graph.node import LaneName, Node, Values
from nlens_video.graph.nodes.stream_frame import StreamFrame
from nlens_video.graph.profiler import Profiler
from nlens_video.graph.scheduler import Lane
from nlens_video.stages.r_lens_track import FitTrack
from nlens_video.stages.r_live_lens import LiveLens


@dataclass(frozen=True, slots=True)
class Ran:
    """A stage that has run on a frame: what another graph need not compute again."""

    run: Callable[..., object]
    arguments: list[object]
    value: object


@dataclass(slots=True)
class FrameState:
    """One frame on its way, with the values its nodes have written.

    Attributes:
        frame: as the source gave it.
        values: port to value.
        carried_fit: whether the lens was fitted on this frame.
        started: whether the first lane has given it what the shot knew at that moment.
        rung: name of its graph where quality is held to a budget, else empty.
        share: of its picture in the frame that is written, 0 to 1 [1].
        twin: the same frame by the rung before, while one fades into the other.
        ran: what its nodes have computed, kept where there is a twin.
        reused: what the nodes of its twin have computed.
    """

    frame: StreamFrame
    values: Values = field(default_factory=dict)
    carried_fit: bool = False
    started: bool = False
    rung: str = ""
    share: float = 1.0
    twin: FrameState | None = None
    ran: list[Ran] = field(default_factory=list)
    reused: list[Ran] = field(default_factory=list)

    @property
    def picture(self) -> Picture:
        """The picture as its nodes have made it."""
        return cast("Picture", self.values["picture"])


class FrameSteps:
    """Runs a graph's nodes frame by frame and keeps what a shot has found out.

    Args:
        graph: the nodes.
        profiler: times them.
        fit: the lens, when it is known beforehand, in the pixels of this stream; or all along it.
        live: follows a lens that changes, None to keep the first.
    """

    def __init__(
        self,
        graph: Graph,
        profiler: Profiler,
        fit: LensFit | FitTrack | None = None,
        live: LiveLens | None = None,
    ) -> None:
        self.graph = graph
        self.profiler = profiler
        self._track = fit if isinstance(fit, FitTrack) else None
        self._live = live
        known = fit.at(0) if isinstance(fit, FitTrack) else fit
        self._shot: Values = {} if known is None else {"fit": known}

    @property
    def fit(self) -> LensFit | None:
        """The lens, once found or given."""
        fit = self._shot.get("fit")
        return fit if isinstance(fit, LensFit) else None

    @fit.setter
    def fit(self, fit: LensFit) -> None:
        self._shot["fit"] = fit

    def hold(self, fit: LensFit) -> None:
        """Take a lens, in the pixels of this stream, and follow no change of it any more."""
        self._track = self._live = None
        self.fit = fit

    def enter(self, frame: StreamFrame, following: tuple[Picture, ...] = ()) -> FrameState:
        """Start a frame: the ports that are given.

        Args:
            frame: the frame.
            following: pictures of the frames after it, as far as they are known yet.
        """
        picture = frame.picture
        box = Box(0, 0, picture.width, picture.height)
        values: Values = {"frame": frame, "picture": picture, "frame_box": box}
        if following:
            values["following"] = following
        return FrameState(frame, values)

    def pass_over(self, frame: StreamFrame) -> None:
        """Show a frame before the range to the nodes that remember: a part is as in the whole."""
        for node in self.graph.remembering:
            node.run(frame.picture)

    def run(self, state: FrameState, nodes: tuple[Node, ...]) -> FrameState:
        """Run some nodes on one frame."""
        if not state.started:  # later lanes must not see what later frames have found out
            state.values.update(self._shot)
            if self._track is not None:
                state.values["fit"] = self._track.at(state.frame.index)
            elif self._live is not None and self.fit is not None:
                self._follow(state, self._live)
            state.started = True
        for node in nodes:
            if node.cadence == "shot":
                self._run_once(state, node)
            elif node.called_for(state.values):
                state.values[node.output] = self._value(state, node)
        return state

    def _value(self, state: FrameState, node: Node) -> object:
        arguments = node.arguments(state.values)
        for ran in state.reused:
            if ran.run is node.run and all(map(operator.is_, ran.arguments, arguments)):
                return ran.value
        with self.profiler.timed(state.frame.index, node.name):
            value = node.run(*arguments)
        if state.twin is not None:
            state.ran.append(Ran(node.run, arguments, value))
        return value

    def find(self, state: FrameState, nodes: tuple[Node, ...]) -> LensFit | None:
        """The lens of one frame, whatever is known already; None where the object is out of view.

        Args:
            state: the frame.
            nodes: those that find a lens, in order.

        Raises:
            LensFitError: the frame does not tell.
        """
        for node in nodes:
            if node.called_for(state.values):
                with self.profiler.timed(state.frame.index, node.name):
                    state.values[node.output] = node.run(*node.arguments(state.values))
        fit = state.values.get("fit")
        return fit if isinstance(fit, LensFit) else None

    def _follow(self, state: FrameState, live: LiveLens) -> None:
        """See whether the lens has changed, and take it a step on its way."""
        index = state.frame.index
        with self.profiler.timed(index, "watch"):
            asked = live.asks(index, state.frame.picture)
        if asked:
            probe = self.enter(state.frame)
            with suppress(LensFitError):  # this frame does not tell: the lens stays as it is
                fit = self.find(probe, self.finding)
                if fit is not None:
                    live.found(fit)
        moved = live.step()
        if moved is not None:
            state.values["fit"] = self.fit = moved

    @property
    def finding(self) -> tuple[Node, ...]:
        """The nodes that find a lens, in order."""
        return tuple(
            node for node in self.graph.nodes if node.stage == "locate" or node.cadence == "shot"
        )

    def _run_once(self, state: FrameState, node: Node) -> None:
        if self.fit is None and node.called_for(state.values):
            with self.profiler.timed(state.frame.index, node.name):
                value = node.run(*node.arguments(state.values))
            state.values[node.output] = value
            if isinstance(value, LensFit):
                self.fit = value
                state.carried_fit = True
                if self._live is not None:
                    self._live.found(value)

    def lanes(
        self,
        render_context: Callable[[], AbstractContextManager[object]],
        step: Callable[[FrameState, LaneName], object] | None = None,
    ) -> list[Lane[object]]:
        """The graph's lanes for `run_lanes`; items that are no `FrameState` pass through.

        Args:
            render_context: entered on the render lane's thread, where OpenGL lives.
            step: runs one lane's nodes on a frame; default: those of the one graph.
        """
        run = step or (lambda state, name: self.run(state, self.graph.lane(name)))

        def lane(name: LaneName) -> Callable[[object], object]:
            def passing(item: object) -> object:
                if isinstance(item, FrameState):
                    run(item, name)
                return item

            return passing

        @contextmanager
        def render() -> Iterator[Callable[[object], object]]:
            with render_context():
                yield lane("render")

        @contextmanager
        def lens() -> Iterator[Callable[[object], object]]:
            yield lane("lens")

        return [Lane("render", render), Lane("lens", lens)]
