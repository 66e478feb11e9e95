"""The commands `render`, `plan` and `fit`: source, graph, sink and observers joined."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, cast

from msgspec import Struct
from msgspec.structs import asdict, replace

from nlens_video.core import signals
from nlens_video.core.errors import UsageError
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import Settings
from nlens_video.effects.planner import SHADOW, Decision
from nlens_video.graph.base.profiler import Profiler, Summary
from nlens_video.graph.executor import FrameState
from nlens_video.graph.nodes.plate_light import EstimateLight
from nlens_video.graph.nodes.warm_up import WarmUp
from nlens_video.graph.scheduler import run_workers
from nlens_video.graph.session import Session, describe
from nlens_video.run.checks.lens_told import check_lens_told
from nlens_video.run.checks.plate_checks import PlateChecks, notes_beforehand
from nlens_video.run.first_look import FirstLook, begun_look
from nlens_video.run.observers import SidecarOutputs, note_on_complete_result, observers
from nlens_video.run.open_run import build_run_input, open_run
from nlens_video.run.plate_source import frame_s, opened
from nlens_video.run.pooled_samples import passes
from nlens_video.run.preflight import (
    check_settings,
    check_shot,
    check_written,
    notes_on_result,
    open_result,
)
from nlens_video.video.chunk_queue import ChunkFeed
from nlens_video.video.info import SourceInfo
from nlens_video.video.input.reconnect import Reconnecting
from nlens_video.video.interfaces import Sink, Source
from nlens_video.video.times.part import part_of

if TYPE_CHECKING:
    import av

    Packet = av.Packet[Any]

OnProgress = Callable[[int, int | None], None]


class RunResult(Struct, frozen=True, kw_only=True):
    """The result of `render`.

    Attributes:
        output: what was written.
        fit: the lens fit, None where the object was never in view.
        decisions: of each effect, whether it was simulated and why.
        timing: statistics of the frame times.
        composited: frames on which the object was in view [1].
        damaged: packets and frames of the source that were damaged [1].
        notes: for the user.
        missing: sidecar outputs that could not be written, and why.
    """

    output: str
    fit: LensFit | None
    decisions: tuple[Decision, ...]
    timing: Summary
    composited: int
    damaged: int
    notes: tuple[str, ...]
    missing: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            **asdict(self),
            "fit": self.fit and asdict(self.fit),
            "decisions": [asdict(one) for one in self.decisions],
            "timing": {**asdict(self.timing), "fps": self.timing.fps},
        }


def plan(
    settings: Settings, *, all_reasons: bool = True, as_chunks: bool = False
) -> tuple[str, ...]:
    """The resolved graph in words; reads the GLB and the source's first frames, renders nothing.

    Args:
        settings: the run.
        all_reasons: as of `graph.session.describe`.
        as_chunks: whether the output is a folder of chunks, which lose nothing.

    Raises:
        NlensError: as `render`.
    """
    check_settings(settings, as_chunks=as_chunks)
    with open_run(settings, Profiler(settings.budget_ms)) as run_input:
        info, session = run_input.info, run_input.session
        part = part_of(info, settings.source.frames)
        lost = () if as_chunks else notes_on_result(settings.output, part, settings.source)
        notes = (*info.notes, *notes_beforehand(settings, info, session), *lost)
        return (
            *_describe_source(info),
            *(f"note: {note}" for note in notes),
            *describe(session, all_reasons=all_reasons),
        )


def render(
    settings: Settings,
    on_progress: OnProgress = lambda done, total: None,
    chunks: ChunkFeed | None = None,
    look: Callable[[], FirstLook | None] | None = None,
) -> RunResult:
    """Composite a whole source, or chunks of it.

    Args:
        settings: the run.
        on_progress: called after each frame with (frames written, frames expected or None).
        chunks: frame ranges to render in place of the settings' range, as lossless chunks for
            `merge`; the output is then their folder.
        look: waits for a first look at the file that has begun already, from `begun_look`;
            default: it begins here.

    Raises:
        UsageError: settings do not go together.
        InputError: the plate or the layers cannot be read.
        SceneError: the GLB cannot be used.
        LensFitError: no usable lens fit, none given, no fallback allowed.
        OutputError: the result cannot be written.
    """
    if settings.output is None:
        raise UsageError("no output was named")
    output = settings.output
    check_settings(settings, as_chunks=chunks is not None)
    composited = written = 0
    changed = complete = False
    with ExitStack() as stack:
        stack.enter_context(note_on_complete_result(output.spec, lambda: complete))
        source = stack.enter_context(opened(settings.source))
        scene, unseen = check_shot(settings, source.info) if chunks is None else (None, ())
        part = part_of(source.info, settings.source.frames)
        sink = open_result(output, part, settings.source, chunks)
        live = source.info.kind == "stream"
        stack.enter_context(
            note_on_what_is_left(sink, output.spec, lambda: live and written > 0 and not complete)
        )
        stack.enter_context(sink)
        profiler = Profiler(settings.budget_ms)
        known = passes(settings, look or stack.enter_context(begun_look(settings)))
        run_input = build_run_input(source, settings, profiler, known, chunks=chunks, scene=scene)
        session = run_input.session
        stack.enter_context(WarmUp(session.nodes))
        checks = PlateChecks(settings, source.info, session, frame_s(source.info))
        found = observers(settings, source.info, session, output)
        sidecars = stack.enter_context(SidecarOutputs(found))
        observing = (sidecars, *checks.observers)
        total = _expected(source.info, settings)
        workers = session.workers()
        may_drop = run_input.may_drop if settings.late == "drop" else None
        items = run_workers(run_input.items(observing), workers, may_drop=may_drop)
        stack.callback(_close, items, chunks)
        for item in items:
            signals.check()
            if not isinstance(item, FrameState):
                sink.write_packet(cast("Packet", item))
                continue
            frame = item.frame
            with profiler.timed(frame.index, "encode"):
                sink.write(frame)
            timing = profiler.close_frame(frame.index, frame.pts, warm_up=item.fitted_here)
            session.on_written(item, timing)
            written += 1
            composited += item.composited
            changed = changed or item.composited or item.traced
            for observer in observing:
                observer.frame(item, timing)
            on_progress(written, total)
        check_lens_told(session, live=source.info.kind == "stream")
        check_written(settings, source.info, written, changed=changed or chunks is not None)
        sink.commit()
        complete = True
        result = RunResult(
            output=output.spec, fit=session.executor.fit, decisions=session.decisions,
            timing=profiler.summary(), composited=composited, damaged=source.damaged,
            notes=(
                *source.info.notes,
                *notes_beforehand(settings, source.info, session),
                *unseen,
                *source.warnings(),
                *_session_notes(session),
                *session.device.notes,
                *sink.notes,
                *_reconnections(source),
                *checks.notes,
            ),
        )  # fmt: skip
        sidecars.finish(result.timing, result.notes)
    return replace(result, missing=sidecars.missing)


def _close(items: Generator[object], chunks: ChunkFeed | None) -> None:
    if chunks is not None:
        chunks.end()  # a reader that waits for the next chunk could not be closed
    items.close()


@contextmanager
def note_on_what_is_left(
    sink: Sink, output: str, lost: Callable[[], bool] = lambda: False
) -> Iterator[None]:
    """Add to the error of a run what it leaves of its result.

    Args:
        sink: the result.
        output: its name.
        lost: whether frames are lost that cannot be made again, those of a live source.
    """
    try:
        yield
    except BaseException as error:
        if sink.kept is not None:
            error.add_note(f"the part written so far is {sink.kept}")
        elif sink.keeps_nothing:
            error.add_note("nothing that plays was written, so --keep-partial keeps nothing")
        elif isinstance(error, KeyboardInterrupt) and sink.cut_off:
            stream = "standard output" if output == "-" else output
            error.add_note(f"the stream to {stream} ends here")
        elif isinstance(error, KeyboardInterrupt) and lost():
            error.add_note("no output written (--keep-partial keeps what was recorded)")
        raise


def _describe_source(info: SourceInfo) -> Iterator[str]:
    yield (
        f"plate {info.name}: {info.kind}, {info.codec} {info.width}x{info.height} "
        f"{info.pixel_format}{' interlaced' if info.interlaced else ''}"
        f"{_rate(info)}"
    )
    tags = info.tags
    assumed = f" (assumed: {', '.join(tags.assumed)})" if tags.assumed else ""
    yield (
        f"colour: matrix {tags.matrix}, transfer {tags.transfer}, primaries {tags.primaries}, "
        f"{'full' if tags.full_range else 'limited'} range{assumed}"
    )


def _rate(info: SourceInfo) -> str:
    if info.kind == "still":
        return ""
    if info.average_rate is None:
        return ", unknown rate"
    rate = f"{float(info.average_rate):.3f} fps"
    varies = info.kind == "video" and not info.steady  # of others the header's rates are guesses
    return f", variable rate, {rate} on average" if varies else f", {rate}"


def _session_notes(session: Session) -> Iterator[str]:
    """Its notes, without those on the sun where no shadow is drawn."""
    casts = any(one.effect == SHADOW and one.wanted for one in session.decisions)
    lights = () if casts else (one for one in session.nodes if isinstance(one, EstimateLight))
    of_sun = {note for light in lights for note in light.notes}
    return (note for note in session.notes if note not in of_sun)


def _reconnections(source: Source) -> tuple[str, ...]:
    if not isinstance(source, Reconnecting) or not source.lost:
        return ()
    often = "once" if source.lost == 1 else f"{source.lost} times"
    return (f"the source was lost and opened again {often}; frames are missing there",)


def _expected(info: SourceInfo, settings: Settings) -> int | None:
    first, end = settings.source.frames
    if info.frame_count is None:
        return None if end is None else end - first
    return max(0, min(info.frame_count, end or info.frame_count) - first)
