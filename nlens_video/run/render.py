"""One run of the command line: source, graph and sink joined, results kept."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from nlens_video.core import signals
from nlens_video.core.errors import OutOfViewError, UsageError
from nlens_video.core.settings import OutputSettings, Settings
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.executor import FrameState
from nlens_video.graph.plan import describe
from nlens_video.graph.scheduler import run_workers
from nlens_video.graph.warmup import KernelWarmup
from nlens_video.run.lens_track_pass import lens_track_pass
from nlens_video.run.observers import RunContext, observers, save_fit
from nlens_video.run.open_run import frame_s, open_run, opened, take_in
from nlens_video.run.preflight import check_shot, check_words, check_written, open_result
from nlens_video.run.result import FitOutcome, RunResult
from nlens_video.run.sidecar_outputs import Beside, telling_what_is_complete
from nlens_video.run.zoom_check import ZoomCheck
from nlens_video.video.atomic_files import check_folder, remove_stale, replacing
from nlens_video.video.chunks.chunk_queue import ChunkFeed
from nlens_video.video.chunks.chunk_writer import ChunkWriter
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.input.reconnect import Reconnecting
from nlens_video.video.input.source import Source
from nlens_video.video.output.sink import Sink
from nlens_video.video.part import part_of

if TYPE_CHECKING:
    import av

    Packet = av.Packet[Any]

OnProgress = Callable[[int, int | None], None]
ENOUGH_FOR_A_FIT = 240
"""Frames that `fit` looks through for the object."""


def plan(settings: Settings, *, all_reasons: bool = True) -> tuple[str, ...]:
    """The resolved graph in words; reads the GLB and the source's first frames, renders nothing.

    Args:
        settings: the run.
        all_reasons: as of `graph.plan.describe`.

    Raises:
        NlensError: as `render`.
    """
    with open_run(settings, Profiler(settings.budget_ms)) as intake:
        return (*_describe_source(intake.info), *describe(intake.session, all_reasons=all_reasons))


def find_fit(
    settings: Settings,
    look_through: float = ENOUGH_FOR_A_FIT,
    on_counted: Callable[[int], None] = lambda frames: None,
) -> FitOutcome:
    """Find the lens on the first frame with the object in view, and save it.

    Where it changes over a file and `track_focus` says so, it is saved as it is all along.

    Args:
        settings: the run; `save_fit` names the file.
        look_through: as many frames at most, infinity for all [1].
        on_counted: as of `follow.follow`.

    Raises:
        NlensError: as `render`; OutOfViewError when the object does not come into view.
    """
    if settings.save_fit is None:
        raise UsageError("no file for the fit was named")
    check_folder(settings.save_fit)
    remove_stale(settings.save_fit)
    track = lens_track_pass(settings, on_counted)
    if track is not None:
        with replacing(settings.save_fit) as partial:
            partial.write_text(track.to_json())
        return FitOutcome(fit=track.at(0), path=settings.save_fit, notes=(track.describe(),))
    profiler = Profiler(settings.budget_ms)
    with ExitStack() as stack:
        intake = stack.enter_context(open_run(settings, profiler))
        session = intake.session
        started = RunContext(intake.info, session, profiler)
        beside = stack.enter_context(Beside(observers(settings, started, None)))
        shot = session.graph.find_lens
        seen = 0
        for state in intake.items([beside]):
            if not isinstance(state, FrameState):
                continue
            seen += 1
            signals.check()
            session.executor.run(state, shot)
            frame = cast("SourceFrame", state.frame)
            timing = profiler.close_frame(frame.index, frame.pts, warm_up=state.carried_fit)
            beside.frame(state, timing)
            if session.executor.fit is not None or seen >= look_through:
                break
        fit = session.executor.fit
        if not seen:
            first, end = settings.source.frames
            raise UsageError(f"--range {first}:{end or ''}: the source has no such frames")
        if fit is None:
            raise OutOfViewError(
                f"{settings.scene.glb}: the object does not come into view within {seen} frames, "
                "so there is nothing to fit; check the camera or --range"
            )
        save_fit(fit, settings.save_fit)
        with telling_what_is_complete(str(settings.save_fit)):
            beside.finish(profiler.summary(), session.notes())
    return FitOutcome(
        fit=fit, path=settings.save_fit, notes=session.notes(), missing=beside.missing
    )


def render(
    settings: Settings,
    on_progress: OnProgress = lambda done, total: None,
    chunks: ChunkFeed | None = None,
) -> RunResult:
    """Composite a whole source, or chunks of it.

    Args:
        settings: the run.
        on_progress: called after each frame with (frames written, frames expected or None).
        chunks: parts of a longer result that are written in place of the settings' range, lossless
            and for `merge`; the output is then their folder.

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
    check_words(settings, as_chunks=chunks is not None)
    composited = written = 0
    changed = False
    with ExitStack() as stack:
        source = stack.enter_context(opened(settings.source))
        if chunks is None:
            check_shot(settings, source.info)
        sink = _open_result(output, part_of(source.info, settings.source.frames), settings, chunks)
        stack.enter_context(telling_what_is_kept(sink))
        stack.enter_context(sink)
        profiler = Profiler(settings.budget_ms)
        intake = take_in(source, settings, profiler, lens_track_pass(settings), chunks)
        session = intake.session
        ahead = stack.enter_context(KernelWarmup(*session.graphs))
        zoom = ZoomCheck(frame_s(source.info))
        started = RunContext(source.info, session, profiler)
        beside = stack.enter_context(Beside(observers(settings, started, settings.output)))
        watching = (beside, zoom)
        total = _expected(source.info, settings)
        lanes = session.workers()
        may_drop = intake.may_drop if settings.late == "drop" else None
        items = run_workers(intake.items(watching), lanes, may_drop=may_drop)
        stack.callback(_close, items, chunks)
        for item in items:
            signals.check()
            if not isinstance(item, FrameState):
                sink.write_packet(cast("Packet", item))
                continue
            frame = cast("SourceFrame", item.frame)
            with profiler.timed(frame.index, "encode"):
                sink.write(frame)
            timing = profiler.close_frame(frame.index, frame.pts, warm_up=item.carried_fit)
            session.wrote(item, timing)
            written += 1
            composited += item.composited
            changed = changed or item.composited or item.traced
            for observer in watching:
                observer.frame(item, timing)
            on_progress(written, total)
        check_written(settings, source.info, written, changed=changed or chunks is not None)
        timing_of_all = profiler.summary()
        outcome = RunResult(
            output=output.spec, fit=session.executor.fit, decisions=session.decisions,
            timing=timing_of_all, composited=composited, damaged=source.damaged,
            notes=(
                *source.info.notes,
                *source.warnings(),
                *session.notes(),
                *session.device.notes,
                *ahead.notes,
                *sink.notes,
                *_lost(source),
                *zoom.notes,
            ),
        )  # fmt: skip
        sink.commit()
        with telling_what_is_complete(output.spec):
            beside.finish(outcome.timing, outcome.notes)
    return replace(outcome, missing=beside.missing)


def _close(items: Generator[object], chunks: ChunkFeed | None) -> None:
    if chunks is not None:
        chunks.end()  # what waits for more of them does not close
    items.close()


def _open_result(
    output: OutputSettings, info: SourceInfo, settings: Settings, chunks: ChunkFeed | None
) -> Sink:
    if chunks is not None:
        return ChunkWriter(Path(output.spec), info, chunks)
    return open_result(output, info, settings.source)


@contextmanager
def telling_what_is_kept(sink: Sink) -> Iterator[None]:
    """Name the partial file to whoever hears of the interruption."""
    try:
        yield
    except BaseException as error:
        if sink.kept is not None:
            error.add_note(f"the part written so far is {sink.kept}")
        raise


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


def _lost(source: Source) -> tuple[str, ...]:
    if not isinstance(source, Reconnecting) or not source.lost:
        return ()
    often = "once" if source.lost == 1 else f"{source.lost} times"
    return (f"the source was lost and opened again {often}; pictures are missing there",)


def _expected(info: SourceInfo, settings: Settings) -> int | None:
    first, end = settings.source.frames
    if info.frame_count is None:
        return None if end is None else end - first
    return max(0, min(info.frame_count, end or info.frame_count) - first)
