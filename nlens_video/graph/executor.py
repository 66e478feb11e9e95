"""Executes a graph frame by frame; holds the lens of the shot."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from msgspec import Struct

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Box, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.live_lens import LiveLens
from nlens_video.graph.base.node import LANES, Lane, Node
from nlens_video.graph.base.profiler import FrameTiming, Profiler, Summary
from nlens_video.graph.base.values import FramesFitted, FrameValues, ShotValues
from nlens_video.graph.builder import Graph
from nlens_video.graph.camera_zoom import CameraZoom
from nlens_video.graph.scheduler import Worker
from nlens_video.stages.r_lens_track import FitTrack
from nlens_video.video.info import SourceFrame


class CachedResult(Struct, frozen=True):
    """A node's result with its arguments, for reuse by another graph on the same frame."""

    node: Node
    arguments: list[object]
    value: object


@dataclass(slots=True)
class FrameState:
    """One frame on its way, with the values its nodes have written.

    Attributes:
        frame: as the source gave it.
        values: of the ports.
        fitted_here: whether the lens was fitted on this frame.
        started: whether the first lane has set the lens as it was known at that moment.
        level: name of its graph under adaptive quality, else empty.
        blend_weight: of its picture in the frame that is written, 0 to 1 [1].
        crossfade: the same frame by the level before, while one fades into the other.
        results: what its nodes have computed, kept where there is a crossfade.
        reusable: what the nodes of the other level have computed.
    """

    frame: SourceFrame
    values: FrameValues
    fitted_here: bool = False
    started: bool = False
    level: str = ""
    blend_weight: float = 1.0
    crossfade: FrameState | None = None
    results: list[CachedResult] = field(default_factory=list)
    reusable: list[CachedResult] = field(default_factory=list)

    @property
    def picture(self) -> Picture:
        """The picture as its nodes have made it."""
        return self.values.picture

    @property
    def composited(self) -> bool:
        """Whether the object was composited."""
        return self.values.blurred is not None and not self.values.blurred.box.empty

    @property
    def traced(self) -> bool:
        """Whether the object has a shadow or a reflection on this frame."""
        return self.values.shadow is not None or self.values.reflection is not None


class Observer:
    """Follows the frames of a run and changes nothing; a context manager.

    Attributes:
        what: the option that asks for it and its value, for messages.
    """

    what = ""

    def __init__(self) -> None:
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def on_frame_start(self, state: FrameState) -> None:
        """A frame was decoded and nothing is composited yet; called on the decoding thread."""

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame was written."""

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """The last frame was written."""


class GraphExecutor:
    """Runs a graph's nodes frame by frame.

    Args:
        graph: the nodes.
        profiler: times them.
        fit: the lens, when it is known beforehand, in the pixels of this stream; or all along it.
        live: follows a lens that changes, None to keep the first.
        zoom: of the camera, which takes a lens that is kept along; None where it does not zoom.

    Attributes:
        fit, track: the lens, once found or given; all along the file, None where it rests.
        shot: what the lens was found from.
    """

    def __init__(
        self,
        graph: Graph,
        profiler: Profiler,
        fit: LensFit | FitTrack | None = None,
        live: LiveLens | None = None,
        zoom: CameraZoom | None = None,
    ) -> None:
        self.graph, self.profiler = graph, profiler
        self.shot = ShotValues()
        self._take(fit)
        self._live, self._zoom = live, zoom
        self._frame_box = Box(0, 0, 0, 0)
        self._last: dict[Node, tuple[list[object], object]] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, on the lens and of the nodes, as of now."""
        found, live = self.shot.found_lens, self._live
        return (
            *([found.warning] if found is not None and found.warning else []),
            *([self.track.describe()] if self.track is not None else []),
            *([live.describe()] if live is not None and live.fits > 1 else []),
            *(note for node in self.graph.nodes for note in node.notes),
        )

    def pin_fit(self, fit: LensFit | FitTrack) -> None:
        """Use this lens, in pixels of this stream, from now on and ignore its changes."""
        self._live = None
        self._take(fit)
        if self._zoom is not None:
            self._zoom.fitted_s = None

    def _take(self, fit: LensFit | FitTrack | None) -> None:
        self.track = fit if isinstance(fit, FitTrack) else None
        self.fit = fit.at(0) if isinstance(fit, FitTrack) else fit
        self._begins = True

    def begin_frame(self, frame: SourceFrame, following: tuple[Picture, ...] = ()) -> FrameState:
        """Start a frame: its given ports; `following` are the pictures after it, if known."""
        picture = frame.picture
        if (self._frame_box.width, self._frame_box.height) != (picture.width, picture.height):
            self._frame_box = Box(0, 0, picture.width, picture.height)
        values = FrameValues(
            frame=frame, picture=picture, frame_box=self._frame_box, following=following or None
        )
        return FrameState(frame, values)

    def observe_skipped(self, frame: SourceFrame) -> None:
        """Run stateful nodes on a frame before the range, so that a range equals the whole."""
        for node in self.graph.stateful:
            node.run(frame.picture)

    def run(self, state: FrameState, nodes: tuple[Node, ...]) -> FrameState:
        """Run some nodes on one frame."""
        if not state.started:  # later lanes must not see a lens that later frames have changed
            self._give_lens(state)
            state.started = True
        for node in nodes:
            if node.once:
                self._run_once(state, node)
            elif node.runs_on(state.values):
                setattr(state.values, node.writes, self._value(state, node))
        state.values.drop_maps()
        return state

    def find_lens(self, state: FrameState, frames: FramesFitted = "one") -> LensFit | None:
        """Fit the lens on a frame again; None where the object is out of view.

        Raises:
            LensFitError: the frame gives no usable fit.
        """
        state.values.frames_fitted = frames
        for node in self.graph.find_lens:
            if node.runs_on(state.values):
                self._write(state, node, self._timed(state, node))
        found = state.values.found_lens
        return None if found is None else found.fit

    def _give_lens(self, state: FrameState) -> None:
        state.values.fit = self.fit
        if self.track is not None:
            state.values.fit = self.track.at(state.frame.index)
            self.fit, self._begins = (state.values.fit if self._begins else self.fit), False
        elif self._live is not None and self.fit is not None:
            self._follow(state, self._live)
        elif self._zoom is not None and self.fit is not None:
            state.values.fit = self._zoom.follow(self.fit, state.frame.time_s)

    def _value(self, state: FrameState, node: Node) -> object:
        arguments = node.arguments(state.values)
        for one in state.reusable:
            if one.node is node and all(map(operator.is_, one.arguments, arguments)):
                return one.value
        value = self._timed(state, node)
        if state.crossfade is not None:
            state.results.append(CachedResult(node, arguments, value))
        return value

    def _timed(self, state: FrameState, node: Node) -> object:
        arguments = node.arguments(state.values)
        with self.profiler.timed(state.frame.index, node.name):
            if not node.same_with:
                return node.run(*arguments)
            given = [getattr(state.values, port) for port in node.same_with]
            before, value = self._last.get(node, ([], None))
            if len(before) != len(given) or not all(map(operator.is_, before, given)):
                value = node.run(*arguments)
                self._last[node] = given, value
            return value

    def _write(self, state: FrameState, node: Node, value: object) -> None:
        setattr(state.values, node.writes, value)
        self.shot.take(node.writes, value)

    def _follow(self, state: FrameState, live: LiveLens) -> None:
        """Refit where the plate's blur has changed; step towards the newest fit."""
        index = state.frame.index
        with self.profiler.timed(index, "watch"):
            due = live.needs_refit(index, state.frame.picture)
        if due:
            again = self.begin_frame(state.frame)
            again.values.lens_before = self.fit
            with suppress(LensFitError):  # no usable fit on this frame: the lens stays
                if (fit := self.find_lens(again, "several")) is not None:
                    live.found(fit)
        if (moved := live.step(index)) is not None:
            state.values.fit = self.fit = moved

    def _run_once(self, state: FrameState, node: Node) -> None:
        if self.fit is not None or not node.runs_on(state.values):
            return
        value = self._timed(state, node)
        self._write(state, node, value)
        if value is None:  # the picture tells no lens: the object is not shown on it
            state.values.bounds = None
        found = state.values.found_lens
        if found is not None:
            self.fit = state.values.fit = found.fit
            state.fitted_here = True
            if self._zoom is not None:
                self._zoom.fitted_s = state.frame.time_s
            if self._live is not None:
                self._live.begin(found.fit, state.frame.index, state.frame.picture)

    def workers(
        self,
        render_context: Callable[[], AbstractContextManager[object]],
        step: Callable[[FrameState, Lane], object] | None = None,
    ) -> list[Worker[object]]:
        """One worker a lane, for `run_workers`; items that are no `FrameState` pass through.

        Args:
            render_context: entered on the render lane's thread, where OpenGL lives.
            step: runs one lane's nodes on a frame; default: those of the one graph.
        """
        run = step or (lambda state, lane: self.run(state, self.graph.lane(lane)))

        def worker(lane: Lane) -> Worker[object]:
            def process(item: object) -> object:
                if isinstance(item, FrameState):
                    run(item, lane)
                return item

            @contextmanager
            def opened() -> Iterator[Callable[[object], object]]:
                if lane == "render":
                    with render_context():
                        yield process
                else:
                    yield process

            return Worker(lane, opened)

        return [worker(lane) for lane in LANES]
