"""One run of the command line: source, graph and sink joined, results kept."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from nlens_video.effects.planner import Decision
from nlens_video.errors import LensFitError, OutputError, UsageError
from nlens_video.graph.assemble import Assembly, Lens, assemble
from nlens_video.graph.lanes import run_lanes
from nlens_video.graph.objects import View
from nlens_video.graph.plan import describe
from nlens_video.graph.profiler import Profiler, Summary
from nlens_video.graph.stream import FrameState, StreamFrame
from nlens_video.lens import LensFit
from nlens_video.observers import Observer, Started, observers
from nlens_video.settings import Settings
from nlens_video.video.atomic import replacing
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.sink import open_sink
from nlens_video.video.source import Source, open_source

if TYPE_CHECKING:
    import av

    Packet = av.Packet[Any]

OnProgress = Callable[[int, int | None], None]
_ENOUGH_FOR_A_FIT = 240  # frames that `fit` looks through for the object


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a run went.

    Attributes:
        output: what was written.
        fit: the lens, None where the object was never in view.
        decisions: which effects were simulated, and why.
        timing: the frames in a few numbers.
        composited: frames on which the object was in view [1].
        damaged: packets and frames of the source that were damaged [1].
        notes: what a person should know.
    """

    output: str
    fit: LensFit | None
    decisions: tuple[Decision, ...]
    timing: Summary
    composited: int
    damaged: int
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """For scripts."""
        return {**asdict(self), "timing": {**asdict(self.timing), "fps": self.timing.fps}}


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOutcome:
    """A lens fit, where it was saved, and what a person should know."""

    fit: LensFit
    path: Path
    notes: tuple[str, ...]


def plan(settings: Settings) -> tuple[str, ...]:
    """The resolved graph in words; reads the source's head and the GLB, renders nothing.

    Raises:
        NlensError: as `render`.
    """
    with _opened(settings) as source:
        assembly = _assembled(settings, source.info, Profiler(settings.budget_ms))
        return (*_describe_source(source.info), *describe(assembly))


def find_fit(settings: Settings) -> FitOutcome:
    """Find the lens on the first frame with the object in view, and save it.

    Raises:
        NlensError: as `render`; LensFitError when the object does not come into view.
    """
    if settings.save_fit is None:
        raise UsageError("no file for the fit was named")
    profiler = Profiler(settings.budget_ms)
    with ExitStack() as stack:
        source = stack.enter_context(_opened(settings))
        assembly = _assembled(settings, source.info, profiler)
        watching = observers(settings, Started(source.info, assembly, profiler), None)
        for observer in watching:
            stack.enter_context(observer)
        shot = tuple(
            node for node in assembly.graph.nodes if node.name == "locate" or node.cadence == "shot"
        )
        for number, frame in enumerate(_chosen(source, settings)):
            state = assembly.steps.enter(frame)
            for observer in watching:
                observer.entering(state)
            assembly.steps.run(state, shot)
            timing = profiler.close_frame(frame.index, frame.pts, warm_up=state.carried_fit)
            for observer in watching:
                observer.frame(state, timing)
            if assembly.steps.fit is not None or number + 1 >= _ENOUGH_FOR_A_FIT:
                break
        fit = assembly.steps.fit
        if fit is None:
            raise LensFitError(
                f"{settings.scene.glb}: the object does not come into view within "
                f"{_ENOUGH_FOR_A_FIT} frames, so there is nothing to fit; check the camera or "
                "--range"
            )
        for observer in watching:
            observer.finish(profiler.summary(), assembly.notes())
        _save(fit, settings.save_fit)
    return FitOutcome(fit=fit, path=settings.save_fit, notes=assembly.notes())


def render(settings: Settings, on_progress: OnProgress = lambda done, total: None) -> Outcome:
    """Composite a whole source.

    Args:
        settings: the run.
        on_progress: called after each frame with (frames written, frames expected or None).

    Raises:
        UsageError: settings that make no sense.
        InputError: the plate or the layers cannot be read.
        SceneError: the GLB cannot be used.
        LensFitError: no usable lens fit, none given, no fallback allowed.
        OutputError: the result cannot be written.
    """
    if settings.output is None:
        raise UsageError("no output was named")
    output = settings.output
    composited = written = 0
    with ExitStack() as stack:
        source = stack.enter_context(_opened(settings))
        profiler = Profiler(settings.budget_ms)
        assembly = _assembled(settings, source.info, profiler)
        watching = observers(settings, Started(source.info, assembly, profiler), settings.output)
        for observer in watching:
            stack.enter_context(observer)
        sink = stack.enter_context(
            open_sink(
                output.spec, source.info, codec=output.codec, crf=output.crf,
                pix_fmt=output.pix_fmt, keep_partial=output.keep_partial,
            )
        )  # fmt: skip
        shift = _Shift()
        total = _expected(source.info, settings)
        lanes = assembly.steps.lanes(assembly.render_context)
        items = run_lanes(_items(source, settings, assembly, profiler, watching), lanes)
        stack.callback(items.close)
        for item in items:
            if not isinstance(item, FrameState):
                if (packet := shift.packet(cast("Packet", item), settings)) is not None:
                    sink.write_packet(packet)
                continue
            frame = shift.frame(item.frame, settings)
            with profiler.timed(frame.index, "encode"):
                sink.write(frame)
            timing = profiler.close_frame(frame.index, frame.pts, warm_up=item.carried_fit)
            written += 1
            composited += "blurred" in item.values
            for observer in watching:
                observer.frame(item, timing)
            on_progress(written, total)
        if not written:
            raise OutputError(
                f"no frame lies in the range {settings.source.frames}; nothing written"
            )
        outcome = Outcome(
            output=output.spec, fit=assembly.steps.fit, decisions=assembly.decisions,
            timing=profiler.summary(), composited=composited, damaged=source.damaged,
            notes=(*source.info.notes, *assembly.notes(), *sink.notes),
        )  # fmt: skip
        if settings.save_fit is not None and outcome.fit is not None:
            _save(outcome.fit, settings.save_fit)
        for observer in watching:
            observer.finish(outcome.timing, outcome.notes)
        sink.commit()
    return outcome


def _save(fit: LensFit, path: Path) -> None:
    with replacing(path) as partial:
        partial.write_text(fit.to_json())


def _opened(settings: Settings) -> Source:
    source = settings.source
    size = f"{source.input_size[0]}x{source.input_size[1]}" if source.input_size else None
    return open_source(
        source.spec, input_format=source.input_format, input_size=size, input_rate=source.input_rate
    )


def _assembled(settings: Settings, info: SourceInfo, profiler: Profiler) -> Assembly:
    lens = Lens(
        preset=settings.preset,
        effects=settings.effects,
        fit=LensFit.load(settings.fit) if settings.fit is not None else None,
        fallback=settings.fallback,
        device=settings.device,
    )
    view = View(
        width=info.width,
        height=info.height,
        pixel_aspect=info.pixel_aspect,
        camera=settings.scene.camera,
    )
    return assemble(settings.scene, lens, view, profiler)


def _describe_source(info: SourceInfo) -> Iterator[str]:
    rate = f"{float(info.average_rate):.3f} fps" if info.average_rate else "unknown rate"
    yield (
        f"plate {info.name}: {info.kind}, {info.codec} {info.width}x{info.height} "
        f"{info.pixel_format}, {rate}"
    )
    tags = info.tags
    assumed = f" (assumed: {', '.join(tags.assumed)})" if tags.assumed else ""
    yield (
        f"colour: matrix {tags.matrix}, transfer {tags.transfer}, primaries {tags.primaries}, "
        f"{'full' if tags.full_range else 'limited'} range{assumed}"
    )
    for note in info.notes:
        yield f"note: {note}"


def _chosen(source: Source, settings: Settings) -> Iterator[SourceFrame]:
    """The frames of `--range`; the others are decoded and dropped."""
    first, end = settings.source.frames
    for frame in source:
        if end is not None and frame.index >= end:
            return
        if frame.index >= first:
            yield frame


def _items(
    source: Source,
    settings: Settings,
    assembly: Assembly,
    profiler: Profiler,
    watching: list[Observer],
) -> Iterator[FrameState | Packet]:
    """Frames, each behind the packets that the source holds before it."""
    packets: deque[Packet] = deque()
    source.packet_sink = packets.append
    frames = _chosen(source, settings)
    while True:
        with profiler.clock() as clock:
            frame = next(frames, None)
        while packets:
            yield packets.popleft()
        if frame is None:
            return
        profiler.add(frame.index, "decode", clock.elapsed_ms)
        state = assembly.steps.enter(frame)
        for observer in watching:
            observer.entering(state)
        yield state


class _Shift:
    """With `--range`, the first frame written is the new beginning for all streams."""

    def __init__(self) -> None:
        self._start_s: Fraction | None = None
        self._start_pts = 0

    def frame(self, frame: StreamFrame, settings: Settings) -> SourceFrame:
        """The frame at its time in the output."""
        assert isinstance(frame, SourceFrame)
        if not settings.source.frames[0]:
            return frame
        if self._start_s is None:
            self._start_pts, self._start_s = frame.pts, frame.pts * frame.time_base
        return replace(frame, pts=frame.pts - self._start_pts)

    def packet(self, packet: Packet, settings: Settings) -> Packet | None:
        """The packet at its time in the output, None if it lies before the beginning."""
        if not settings.source.frames[0]:
            return packet
        if self._start_s is None or packet.dts is None:
            return None
        ticks = round(self._start_s / packet.time_base)
        if packet.dts < ticks:
            return None
        packet.dts -= ticks
        if packet.pts is not None:
            packet.pts -= ticks
        return packet


def _expected(info: SourceInfo, settings: Settings) -> int | None:
    first, end = settings.source.frames
    if info.frame_count is None:
        return None if end is None else end - first
    return max(0, min(info.frame_count, end or info.frame_count) - first)
